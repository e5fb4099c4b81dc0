"""A fitted model on recordings that its fit has not seen: they are smoothed by it as a whole, and windows are predicted from there."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from backsight.models import SolveError
from backsight.models.errors import OutOfTime
from backsight.ocp import Options, Solution
from backsight.ocp.follow import Followed
from backsight.ocp.linear import linearise

from ...problem import Problem
from ...recordings.recording import Recording
from ...results import Smoothing
from ...smoothing.begun import Begun
from ...smoothing.prediction import as_found, noise
from ...smoothing.program import Settings
from ...smoothing.rest import friction_laws, left_alone
from ...smoothing.smoother import smoothing
from .windows import Starts, ahead

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = NDArray[np.int64]

# states to a thousandth of their deviation, if that does not take too long
ROUGHLY = Settings(check_mesh=False, seconds=150.0, options=Options(tolerance=1e-3, max_iterations=100))
VAGUE = 1.2  # times the median deviation of a state: windows do not begin where a smoother knows less of it
GENTLY = (30.0, 10.0, 5.0, 2.5, 1.0)  # times the width of what is rounded, on the way of a smoothing that does not arrive at once
SHARPER = 1e-3  # a friction law's width in the windows over that of smoothing
SEEN = 1e-3  # of what other modes do to the outputs
PLACES = 25  # of a trajectory, where modes are looked at


@dataclass(frozen=True, eq=False)
class Predictor:
    """A fitted model with the held-out pieces smoothed by it; each is one of its own."""

    problem: Problem
    smoothed: Smoothing
    solution: Solution

    @classmethod
    def of(cls, problem: Problem, result: Smoothing, recordings: Sequence[Recording], begin: Solution | None, end: float) -> Predictor:
        """With the parameters, W and V of a fit; what every recording has of its own is one more of the values that were found.

        begin: of the same recordings with the other model. end: on the clock of `time.monotonic`.
        """
        seen = []
        for r in recordings:
            stds = {name: noise(problem, result, r, name) for name in r.outputs}
            seen.append(replace(r, role="fit", output_std=stds))
        fixed = as_found(problem, result, seen, {name: k for name, k in problem.start.items() if k.always})
        smoothed = _smoothed(fixed, begin, end)
        if smoothed.solution is None or not smoothed.solver.converged:
            raise SolveError(f"what was held out could not be smoothed: {smoothed.solver.status.rstrip('.')}")
        return cls(fixed, smoothed, smoothed.solution)

    def error(self, number: int, rows: Index, length: int) -> Array:
        """Measured less predicted outputs (ny, M, 1 + length) of the windows that begin at these rows of piece `number`."""
        dae, piece = self.problem.dae, self.problem.fitted[number]
        starts = self._starts(number, rows)
        predicted = ahead(dae, piece, starts, length, self.sizes)
        at = np.minimum(rows[:, None] + np.arange(length + 1), len(piece.time) - 1).astype(np.int64)
        nothing = np.full(len(piece.time), np.nan)
        measured = np.array([piece.outputs.get(q.name, nothing)[at] for q in dae.outputs])
        return np.asarray(measured - predicted, dtype=np.float64)

    def floor(self, number: int) -> Array:
        """What no force takes from errors of a piece, (ny,): rms of samples off the smoothed trajectory, or of noise where that is more."""
        piece, table = self.problem.fitted[number], self._table(number)
        found = np.full(len(self.problem.dae.outputs), np.nan)
        for i, q in enumerate(self.problem.dae.outputs):
            if (y := piece.outputs.get(q.name)) is not None:
                off = float(np.sqrt(np.nanmean((y - table[q.name].to_numpy(float)) ** 2)))
                found[i] = max(off, piece.output_std[q.name] or 0.0)
        return found

    def known(self, number: int) -> NDArray[np.bool_]:
        """Rows of a piece where all states are known as well as usual: not at its ends, nor near rest, where friction is left open."""
        table = self._table(number)
        std = np.array([table[f"{q.name}.std"].to_numpy(float) for q in self.problem.dae.states]).reshape(-1, len(table))
        told = std[np.isfinite(std).all(axis=1)]
        return np.asarray(np.all(told <= VAGUE * np.median(told, axis=1, keepdims=True), axis=0), dtype=bool)

    @property
    def sizes(self) -> Array:
        """Spread of every state over the recordings, (nx,)."""
        tables = self.smoothed.estimates.values()
        spread = [float(np.nanstd(np.concatenate([t[q.name].to_numpy(float) for t in tables]))) for q in self.problem.dae.states]
        return np.array([s if s > 0 else q.nominal for s, q in zip(spread, self.problem.dae.states, strict=True)])

    def values(self, number: int, rows: Index) -> Array:
        """Parameters (np, M) at these rows, what drifts with its value there; friction as sharp as windows can have it."""
        dae, piece, table = self.problem.dae, self.problem.fitted[number], self._table(number)
        own = {name: f"{name} [{piece.name}]" for name in self.problem.varying}
        found = {name: self.smoothed.parameters.get(case, self.smoothed.parameters.get(name)) for name, case in own.items()}
        p = np.array([f.value if (f := found.get(q.name)) else self.smoothed.value(q.name) for q in dae.parameters])
        for law in left_alone(self.problem, friction_laws(self.problem)):
            p[law.width] = max(SHARPER * p[law.width], dae.parameters[law.width].minimum)
        out = np.repeat(p[:, None], len(rows), axis=1)
        for i, q in enumerate(dae.parameters):
            if q.name in table:
                out[i] = table[q.name].to_numpy(float)[rows]
        return out

    def time_constant(self) -> float:
        """-1/Re of the slowest stable mode that measured outputs see [s], median over places of the trajectory; inf where there is none.

        A mode slower than the recording is an integrator for all that it shows.
        """
        slow = [-1.0 / rates[rates < 0] for rates in self._rates]
        slowest = [float(times.max()) for times in slow if times.size]
        return float(np.median(slowest)) if slowest else np.inf

    def growth(self) -> float:
        """Re of the fastest unstable mode that measured outputs see [1/s], median over places of the trajectory; 0 where most have none."""
        return float(np.median([rates.max(initial=0.0) for rates in self._rates])) if self._rates else 0.0

    @cached_property
    def _rates(self) -> list[Array]:
        """Re of the modes that measured outputs see and that are faster than the recording is long [1/s], at places of the trajectory."""
        dae, piece = self.problem.dae, self.problem.fitted[0]
        rows = np.unique(np.linspace(0, len(piece.time) - 1, PLACES + 2).astype(np.int64)[1:-1])
        s = self._starts(0, rows)
        u = np.array([piece.inputs[q.name][rows] for q in dae.inputs]).reshape(-1, len(rows))
        p = np.array([self.smoothed.value(q.name) for q in dae.parameters])
        linear = linearise(dae, s.rates, s.x, s.z, u, piece.time[rows], p, ())
        C = linear.C[:, [i for i, q in enumerate(dae.outputs) if q.name in piece.outputs]] * self.sizes
        A, duration, found = linear.A * self.sizes / self.sizes[:, None], piece.time[-1] - piece.time[0], list[Array]()
        for a, c in zip(A, C, strict=True):
            if not np.isfinite(a).all():
                continue
            rates, modes = np.linalg.eig(a)
            seen = np.linalg.norm(c @ modes / np.maximum(np.linalg.norm(c, axis=1), 1e-300)[:, None], axis=0)
            found.append(rates.real[(np.abs(rates.real) * duration > 1.0) & (seen > SEEN)])
        return found

    def _starts(self, number: int, rows: Index) -> Starts:
        """The smoothed states there; rates and algebraics of the same trajectory are where the search for these begins."""
        t, dae, table = self.solution.transcription, self.problem.dae, self._table(number)
        followed = Followed(transcription=t, horizons=t.horizons, decisions=self.solution.solved.decisions)
        rates, _, algebraics = followed.at(number, t.horizons[number].time[rows])
        of_state = {q.name: row for q, row in zip(t.dae.states, rates, strict=True)}
        of_algebraic = {q.name: row for q, row in zip(t.dae.algebraics, algebraics, strict=True)}
        M = len(rows)
        return Starts(
            rows=rows,
            x=np.array([table[q.name].to_numpy(float)[rows] for q in dae.states]).reshape(-1, M),
            rates=np.array([of_state.get(q.name, np.zeros(M)) for q in dae.states]).reshape(-1, M),
            z=np.array([of_algebraic.get(q.name, np.full(M, q.start)) for q in dae.algebraics]).reshape(-1, M),
            parameters=self.values(number, rows),
        )

    def _table(self, number: int) -> pd.DataFrame:
        piece = self.problem.fitted[number]
        table = self.smoothed.estimates[piece.name]
        return table[table["t_s"].between(piece.time[0], piece.time[-1])].reset_index(drop=True)


def _until(end: float) -> Settings:
    left = end - time.monotonic()
    if left <= 0:
        raise OutOfTime("no time was left for it.")
    return replace(ROUGHLY, seconds=min(ROUGHLY.seconds, left))


def _smoothed(problem: Problem, begin: Solution | None, end: float) -> Smoothing:
    """Smoothed from a solution by another model, from the samples, or at last with corners that are rounded less and less."""
    smoothed = smoothing(problem, settings=_until(end), begin=None if begin is None else Begun.of(begin, problem))
    if begin is not None and not smoothed.solver.converged:
        smoothed = smoothing(problem, settings=_until(end))
    widths = {
        p.name: float(given) for p in problem.dae.parameters if p.smoothing and isinstance(given := problem.parameters[p.name], float)
    }
    if smoothed.solver.converged or not widths:
        return smoothed
    at: Solution | None = None
    for factor in GENTLY:
        rounded = {name: factor * width for name, width in widths.items()}
        smoothed = smoothing(replace(problem, parameters={**problem.parameters, **rounded}), settings=_until(end), begin=at)
        at = smoothed.solution
    return smoothed
