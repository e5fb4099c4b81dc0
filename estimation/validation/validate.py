"""What a smoothed solution says about itself: prediction errors by recording and output, criteria, and whether forces are white."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from backsight.ocp import Solution

from ..recordings.recording import Recording
from ..results import Companion, Criteria, Memory, OutputFit
from ..smoothing.robust import RobustSolution
from .autocorrelation import memory
from .criteria import criteria
from .fit import output_fit
from .forces import force_whiteness
from .innovations import innovations
from .patterns import QUIET, companion, own_states

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ROWS = 20_000  # enough for a correlation


@dataclass(frozen=True, kw_only=True)
class Validation:
    """errors: recording -> output -> standardised prediction errors (n,), pieces one after the other. force_p: place -> p of whiteness.

    Empty where the solution is no minimum. weighed: whether weights were chosen from the data.
    """

    errors: dict[str, dict[str, Array]] = field(default_factory=dict)
    criteria: Criteria | None = None
    force_p: dict[str, float] = field(default_factory=dict)
    weighed: bool = False

    def fits(self, recording: Recording, table: pd.DataFrame) -> dict[str, OutputFit]:
        """The fit of every output of a recording; table: its rows with the smoothed outputs."""
        out = {}
        for name, y in recording.outputs.items():
            # of smoothed errors nobody knows whether they are as coloured as they should be
            errors = self.errors.get(recording.name, {}).get(name, np.full(len(y), np.nan))
            out[name] = output_fit(y, table[name].to_numpy(), errors, int(self.weighed))
        return out


def validate(solution: Solution, recordings: Sequence[str], *, weighed: bool) -> Validation:
    """Validate a solution; recordings: of every horizon its name. What Huber's loss found far off is left out of all tests."""
    filtered = innovations(solution)
    tested = innovations(solution.without_outliers) if isinstance(solution, RobustSolution) else filtered
    if filtered is None or tested is None:
        return Validation(weighed=weighed)
    dae = solution.transcription.dae
    errors: dict[str, dict[str, list[Array]]] = {name: {q.name: [] for q in dae.outputs} for name in recordings}
    for name, run in zip(recordings, tested.horizons, strict=True):
        for i, q in enumerate(dae.outputs):
            errors[name][q.name].append(run.errors[:, i])
    return Validation(
        errors={name: {output: np.concatenate(parts) for output, parts in table.items()} for name, table in errors.items()},
        criteria=criteria(solution, filtered),
        force_p={dae.places[k].name: p for k, p in force_whiteness(solution, tested).items()},
        weighed=weighed,
    )


def remembered(place: str, estimates: Mapping[str, pd.DataFrame]) -> Memory | None:
    """What the residual force of a place remembers, in the recording where it does longest."""
    found = [memory(t["t_s"].to_numpy(float), t[f"residual.{place}"].to_numpy(float)) for t in estimates.values()]
    return max((m for m in found if m is not None), key=lambda m: m.tau, default=None)


def followed(
    place: str,
    unit: str,
    estimates: dict[str, pd.DataFrame],
    inputs: dict[str, dict[str, Array]],
    states: tuple[str, ...],
    units: dict[str, str],
    rates: Mapping[str, pd.DataFrame],
) -> Companion | None:
    """What the residual of a place goes with most, in the recording where that is plainest."""
    found = []
    for name, table in estimates.items():
        w, std = (table[column].to_numpy(float) for column in (f"residual.{place}", f"residual.{place}.std"))
        if np.isfinite(std).any() and np.nanmean(w**2) < QUIET**2 * np.nanmean(std**2):
            continue
        rows = np.unique(np.linspace(0, len(w) - 1, min(len(w), ROWS)).astype(int))
        chosen, _ = own_states(place, unit, states, units)
        friend = companion(w, chosen, table, units, rows, inputs.get(name), unit, rates.get(name))
        found += [friend] if friend is not None else []
    return max(found, key=lambda c: abs(c.correlation), default=None)
