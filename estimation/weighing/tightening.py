"""What it does to the parameters to hold them ever more tightly: from weak weights to strong ones by stages, drift and priors together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..wording import listed
from .words import FELT

if TYPE_CHECKING:
    from .setting import Outcome
    from .weigh import Weighing

HOLDING = ("drift of ", "prior of ")


def stages(found: Weighing) -> list[Outcome]:
    """Those that arrived, the weakest first."""
    return sorted((o for o in found.outcomes if o.setting.group == "stage" and o.converged), key=lambda o: -o.setting.factor)


def tightened(found: Weighing) -> list[str]:
    """A sentence on the way from the weakest stage to the tightest: which parameters move, and by how many of their deviations.

    A deviation is that with the chosen weights; nothing where there are no two stages, or no parameter that has one.
    """
    path = stages(found)
    moves = _moves(found, path)
    if not moves:
        return []
    holding = [label for label in found.best.weights if label.startswith(HOLDING)]
    way = f"{listed(holding)}, tightened from {path[0].setting.factor:g} to {path[-1].setting.factor:g} times the std:"
    (most, size), *others = sorted(moves.items(), key=lambda m: -m[1])
    if size < FELT:
        return [f"{way} no parameter moves by {FELT:g} of its deviation."]
    return [f"{way} {most} moves by {size:.2g} of its deviations{''.join(f', {name} by {m:.2g}' for name, m in others if m >= FELT)}."]


def _moves(found: Weighing, path: list[Outcome]) -> dict[str, float]:
    """Parameter -> |tightest less weakest| / std."""
    if len(path) < 2:
        return {}
    first, last = path[0].parameters, path[-1].parameters
    stds = {name: std for name, (_, std) in found.best.parameters.items() if 0 < std < np.inf}
    moves = {name: abs(last[name][0] - first[name][0]) / std for name, std in stds.items() if name in first and name in last}
    return {name: move for name, move in moves.items() if np.isfinite(move)}
