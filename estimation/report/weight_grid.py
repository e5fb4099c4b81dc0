"""What the data say of weights that were turned together, on the grid of their factors."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..weighing.chosen import grid
from .chart import Chart, heat_map

if TYPE_CHECKING:
    from ..weighing import Outcome, Weighing

__all__ = ["grid_chart"]

DECISIVE = 10.0  # of a log likelihood: colours end there


def grid_chart(found: Weighing) -> Chart | None:
    """Log likelihood less that with the recommended weights on the grid of two or more chosen weights; None where there is no grid.

    Of what was held out where there is such, else of what was fitted. The last weight runs along, the others down.
    """
    if len(found.varied) < 2:
        return None
    solved = {o.setting.name: o for o in found.outcomes if o.converged}
    outcomes = [solved.get(name) for name in grid(found.varied)]
    judged = np.isfinite(found.best.held_out) and any(o is not None and np.isfinite(o.held_out) for o in outcomes)
    whose = "what was held out" if judged else "the fitted recordings"

    def likelihood(o: Outcome | None) -> float:
        return float("nan") if o is None else o.held_out if judged else o.log_likelihood

    *down, (last, factors) = found.varied.items()
    rows = [", ".join(f"{label} x {s:g}" for (label, _), s in zip(down, each, strict=True)) for each in product(*(f for _, f in down))]
    values = np.array([likelihood(o) for o in outcomes]).reshape(len(rows), len(factors)) - likelihood(found.best)
    caption = (
        f"Log likelihood of {whose} less that with the recommended weights: red where they are more probable, blue where less so. Colours "
        f"end at {DECISIVE:g}, the numbers do not; what did not converge is left empty. Factors count from the weights of greatest "
        "likelihood."
    )
    columns = [f"{last} x {s:g}" for s in factors]
    return heat_map(values, columns, rows, caption=caption, label="chosen_weights", most=DECISIVE, numbers=True)
