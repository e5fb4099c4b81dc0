"""What a smoothed solution says about itself: prediction errors by recording and output, criteria, and whether forces are white."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from backsight.ocp import Solution

from ..recordings.recording import Recording
from ..results import Companion, Criteria, Memory, OutputFit
from ..smoothing.rest import rows_near_rest
from ..smoothing.robust import RobustSolution
from .autocorrelation import memory
from .criteria import criteria
from .fit import output_fit
from .forces import force_whiteness
from .innovations import innovations
from .patterns import CONSTANT, QUIET, companion, differing, own_states

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = NDArray[np.bool_]

HALF = 0.5  # of a recording's samples: where more are near rest, none is left out
ROWS = 20_000  # enough for a correlation


@dataclass(frozen=True, kw_only=True)
class Validation:
    """errors: recording -> output -> standardised prediction errors (n,), pieces one after the other. force_p: place -> p of whiteness.

    still: recording -> the samples near rest (n,), of which no test is made: a rounded sign creeps there, which makes errors that are
    coloured of every model, be it ever so right; none of a recording where more than half are.
    far: recording -> output -> the samples that a robust loss found far off (n,); empty where all losses are squares. All are empty where
    the solution is no minimum. weighed: whether weights were chosen from the data.
    """

    errors: dict[str, dict[str, Array]] = field(default_factory=dict)
    still: dict[str, Mask] = field(default_factory=dict)
    far: dict[str, dict[str, Mask]] = field(default_factory=dict)
    criteria: Criteria | None = None
    force_p: dict[str, float] = field(default_factory=dict)
    weighed: bool = False

    def fits(self, recording: Recording, table: pd.DataFrame) -> dict[str, OutputFit]:
        """The fit of every output of a recording; table: its rows with the smoothed outputs."""
        out = {}
        for name, y in recording.outputs.items():
            # of smoothed errors nobody knows whether they are as coloured as they should be
            errors = self.errors.get(recording.name, {}).get(name, np.full(len(y), np.nan))
            smoothed, far = table[name].to_numpy(), np.zeros(len(y), dtype=bool)
            if (found := self.far.get(recording.name, {}).get(name)) is not None:
                far[np.flatnonzero(np.isfinite(smoothed))[found]] = True  # a row of no piece has no estimate
            out[name] = output_fit(y, smoothed, errors, int(self.weighed), far, self.still.get(recording.name))
        return out


def validate(solution: Solution, recordings: Sequence[str], *, weighed: bool) -> Validation:
    """Validate a solution; recordings: of every horizon its name. What Huber's loss found far off is left out of all tests."""
    filtered = innovations(solution)
    tested = innovations(solution.without_outliers) if isinstance(solution, RobustSolution) else filtered
    if filtered is None or tested is None:
        return Validation(weighed=weighed)
    dae = solution.transcription.dae
    runs = [run.errors for run in tested.horizons]
    starts = np.cumsum([len(run) for run in runs])[:-1]
    far = np.split(solution.far.T, starts) if isinstance(solution, RobustSolution) else []

    def told(of: Sequence[np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
        """Recording -> output -> one column of all its horizons."""
        tables = {name: np.concatenate([run for n, run in zip(recordings, of, strict=True) if n == name]) for name in recordings}
        return {name: {q.name: table[:, i] for i, q in enumerate(dae.outputs)} for name, table in tables.items()}

    return Validation(
        errors=told(runs),
        still=_still(solution, recordings),
        far=told(far) if far else {},
        criteria=criteria(solution, filtered),
        force_p={dae.places[k].name: p for k, p in force_whiteness(solution, tested).items()},
        weighed=weighed,
    )


def _still(solution: Solution, recordings: Sequence[str]) -> dict[str, Mask]:
    """Recording -> its samples near rest (n,), at any place; none where these are more than half."""
    found: dict[str, list[Mask]] = {name: [] for name in recordings}
    for k, (name, horizon) in enumerate(zip(recordings, solution.transcription.horizons, strict=True)):
        found[name].append(np.any([np.zeros(len(horizon.time), dtype=bool), *rows_near_rest(solution, k).values()], axis=0))
    joined = {name: np.concatenate(parts) for name, parts in found.items()}
    return {name: still & (still.mean() <= HALF) for name, still in joined.items()}


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
    found, residuals = [], dict[str, Array]()
    for name, table in estimates.items():
        w, std = (table[column].to_numpy(float) for column in (f"residual.{place}", f"residual.{place}.std"))
        if np.isfinite(std).any() and np.nanmean(w**2) < QUIET**2 * np.nanmean(std**2):
            continue
        rows = np.unique(np.linspace(0, len(w) - 1, min(len(w), ROWS)).astype(int))
        chosen, _ = own_states(place, unit, states, units)
        friend = companion(w, chosen, table, units, rows, inputs.get(name), unit, rates.get(name))
        found += [friend] if friend is not None else []
        residuals[name] = w[rows]
    best = max(found, key=lambda c: abs(c.correlation), default=None)
    return best if best is None or best.law != CONSTANT else differing(best, residuals, unit)
