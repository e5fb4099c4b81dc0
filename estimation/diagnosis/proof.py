"""The proof on recordings that the fit has not seen: the base model, its parameters refitted, against the repaired one.

A smoother bends its residual forces to any recording, so its residuals prove nothing. Windows do: from the state at its first row a window
is predicted with the inputs alone. The state is that of the held-out recording smoothed as a whole, by each model with its own
parameters, W and V; states that only one of them has are that model's own. So both know as much of every start, and what is compared is
what they make of it in the windows: a force that a model does not have is not there to help. (It is no forecast: samples within a window
have had their say on its start.) None begins where either of them knows less of a state than usual: near rest a smoother leaves friction
open, and only that of a model which has friction. Signs of friction stay rounded (`windows.py`).

    rms of the errors per output and horizon, all windows pooled;  improvement = 1 - geometric mean of after/before

What could be gained at best is told by the trajectory that the base model has when forces are free at every place: what the samples are off
it, or their noise, where that is more, instead of the repaired model's errors.

The p-value is of Student's t of d_b = mean over outputs and horizons of log(before/after) of the rms in block b, one-sided against no gain;
blocks are so long that their means may count as independent: three integrated autocorrelation times.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from backsight.models import SolveError
from backsight.models.errors import OutOfTime
from backsight.ocp import Options, Solution
from backsight.ocp.follow import Followed
from backsight.ocp.linear import linearise

from ..problem import Free, Problem
from ..recordings.recording import Recording
from ..results import Smoothing
from ..smoothing.begun import Begun
from ..smoothing.prediction import noise, of_one_more
from ..smoothing.program import Settings
from ..smoothing.rest import friction_laws, left_alone
from ..smoothing.smoother import smoothing
from ..supposed import noisy_inputs
from .blocks import block_gains, chance, mean
from .verdict import Errors, HeldOut
from .windows import Starts, ahead

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = NDArray[np.int64]
Case = tuple[Problem, Smoothing]
Progress = Callable[[str], None]

# states to a thousandth of their deviation, if that does not take too long
ROUGHLY = Settings(check_mesh=False, seconds=150.0, options=Options(tolerance=1e-3, max_iterations=100))
SPANS = (0.05, 0.25)  # s
LONGEST = 0.1  # of the recording: the dominant time constant counts up to there
WHOLE = 0.25  # of the recording: a window longer than that is none
WINDOWS = 100  # of a recording
VAGUE = 1.2  # times the median deviation of a state: windows do not begin where a smoother knows less of it
FEWEST = 0.1  # of the rows of a piece: where fewer are left windows begin anywhere
GENTLY = (30.0, 10.0, 5.0, 2.5, 1.0)  # times the width of what is rounded, on the way of a smoothing that does not arrive at once
SHARPER = 1e-3  # a friction law's width in the windows over that of smoothing
LITTLE = 0.05  # gain of free forces, as a share of the errors: of so little no share is told
SEEN = 1e-3  # of what other modes do to the outputs


def prove(
    before: Case,
    after: Case,
    recordings: Sequence[Recording] | None = None,
    *,
    role: str = "held_out",
    seconds: float = math.inf,
    progress: Progress | None = None,
) -> HeldOut:
    """Compare two fitted models on recordings, by default those of the problem `before` that are held out.

    Raises SolveError where a recording cannot be smoothed with one of the models, in `seconds` for all of them, or no window can be
    predicted with both.
    """
    say, end = progress or (lambda _: None), time.monotonic() + seconds
    given = [r for r in before[0].recordings if r.role == "held_out"] if recordings is None else list(recordings)
    sides = list[_Side]()
    for word, (problem, result) in (("base", before), ("repaired", after)):
        say(f"smoothing what was held out with the {word} model")
        sides.append(_Side.of(problem, result, given, sides[0].solution if sides else None, end))
    spans = horizons(sides[1], given)
    pieces = [piece for r in given for piece in r.pieces]
    windows = [_windows(piece, spans, sides[0].known(n) & sides[1].known(n)) for n, piece in enumerate(pieces)]
    for word, side in zip(("base", "repaired"), sides, strict=True):
        say(f"predicting windows with the {word} model")
        side.errors = [side.error(number, rows, length) for number, (rows, length) in enumerate(windows)]
    return _compared(sides[0], sides[1], pieces, [rows for rows, _ in windows], spans, [r.name for r in given], role)


@dataclass
class _Side:
    """A fitted model with the held-out pieces smoothed by it. errors: per piece (ny, M, rows)."""

    problem: Problem
    smoothed: Smoothing
    solution: Solution
    errors: Sequence[Array] = ()

    @classmethod
    def of(cls, problem: Problem, result: Smoothing, recordings: Sequence[Recording], begin: Solution | None, end: float) -> _Side:
        """With the parameters, W and V of a fit; what every recording has of its own is one more of the values that were found.

        begin: of the same recordings with the other model. end: on the clock of `time.monotonic`.
        """
        seen = []
        for r in recordings:
            stds = {name: noise(problem, result, r, name) for name in r.outputs}
            seen.append(replace(r, role="fit", output_std=stds))
        varying = of_one_more(problem, result)
        parameters: dict[str, Free | float] = {p.name: varying.get(p.name, result.value(p.name)) for p in problem.dae.parameters}
        fixed = Problem(
            model=problem.dae,
            recordings=seen,
            parameters=parameters,
            weights=replace(result.weights, V=noisy_inputs(problem)),
            initial={name: k for name, k in problem.start.items() if k.always},
            bounds=problem.bounds,
        )
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


def horizons(side: _Side, recordings: Sequence[Recording]) -> list[float]:
    """50 ms, 250 ms and the dominant time constant of the repaired model [s], those that fit the recordings."""
    step, whole = max(r.sampling for r in recordings), min(float(r.time[-1] - r.time[0]) for r in recordings)
    slowest = min(time_constant(side), LONGEST * whole)
    found = {span for span in (*SPANS, float(f"{slowest:.3g}")) if step * 0.999 <= span <= WHOLE * whole}
    return sorted(found) or [max(step, LONGEST * whole)]


def time_constant(side: _Side, places: int = 25) -> float:
    """-1/Re of the slowest stable mode that measured outputs see [s], median over places of the trajectory; inf where there is none.

    A mode slower than the recording is an integrator for all that it shows.
    """
    dae, piece = side.problem.dae, side.problem.fitted[0]
    rows = np.unique(np.linspace(0, len(piece.time) - 1, places + 2).astype(np.int64)[1:-1])
    s = side._starts(0, rows)
    u = np.array([piece.inputs[q.name][rows] for q in dae.inputs]).reshape(-1, len(rows))
    p = np.array([side.smoothed.value(q.name) for q in dae.parameters])
    linear = linearise(dae, s.rates, s.x, s.z, u, piece.time[rows], p, ())
    C = linear.C[:, [i for i, q in enumerate(dae.outputs) if q.name in piece.outputs]] * side.sizes
    A, duration, slowest = linear.A * side.sizes / side.sizes[:, None], piece.time[-1] - piece.time[0], []
    for a, c in zip(A, C, strict=True):
        if not np.isfinite(a).all():
            continue
        rates, modes = np.linalg.eig(a)
        seen = np.linalg.norm(c @ modes / np.maximum(np.linalg.norm(c, axis=1), 1e-300)[:, None], axis=0)
        slow = [-1.0 / r.real for r, size in zip(rates, seen, strict=True) if -r.real * duration > 1.0 and size > SEEN]
        slowest += [max(slow)] if slow else []
    return float(np.median(slowest)) if slowest else np.inf


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


def _windows(piece: Recording, spans: Sequence[float], known: NDArray[np.bool_]) -> tuple[Index, int]:
    """Rows where windows of a piece begin, of those where its state is known well, and how many rows the longest has after its first."""
    n, step = len(piece.time), float(np.median(np.diff(piece.time)))
    longest, shortest = min(max(1, round(max(spans) / step)), n - 1), max(1, round(min(spans) / step))
    rows = np.flatnonzero(known[: max(n - shortest, 1)])
    if len(rows) < max(FEWEST * n, 1):
        rows = np.arange(max(n - shortest, 1))
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(WINDOWS, len(rows))).astype(np.int64))], longest


def _compared(
    before: _Side,
    after: _Side,
    pieces: Sequence[Recording],
    rows: Sequence[Index],
    spans: Sequence[float],
    names: Sequence[str],
    role: str,
) -> HeldOut:
    """Errors of both, of the same windows and rows, and what the difference is worth.

    Of an output of which neither tells more, over a span, than that it stays where it was, no error counts.
    """
    outputs = [q for q in before.problem.dae.outputs if any(q.name in piece.outputs for piece in pieces)]
    index = [[q.name for q in side.problem.dae.outputs].index(o.name) for side in (before, after) for o in outputs]
    first, second = index[: len(outputs)], index[len(outputs) :]
    # per piece (4, outputs, spans, M): mean squares over the rows of a window within a span, of both, of what stays where it was and of
    # what is left at best
    squares: list[Array] = []
    for number, piece in enumerate(pieces):
        a, b = before.errors[number][first], after.errors[number][second]
        both = np.isfinite(a) & np.isfinite(b)
        at = np.minimum(rows[number][:, None] + np.arange(a.shape[2]), len(piece.time) - 1)
        y = np.array([piece.outputs.get(q.name, np.full(len(piece.time), np.nan)) for q in outputs])
        since = piece.time[at] - piece.time[at[:, :1]]
        half = float(np.median(np.diff(piece.time))) / 2
        within = np.array([(since > 0) & (since < span + half) for span in spans])
        whole = np.array([piece.time[-1] - piece.time[at[:, 0]] > span - half for span in spans])
        used = both[:, None] & within & whole[:, :, None]
        with np.errstate(invalid="ignore"):
            errors = a, b, y[:, at] - y[:, at[:, :1]], np.broadcast_to(before.floor(number)[first][:, None, None], a.shape)
            squares.append(np.array([mean(np.where(used, e[:, None] ** 2, np.nan)) for e in errors]))
    every = np.concatenate(squares, axis=3)
    if not np.isfinite(every[:2]).any():
        raise SolveError("no window of what was held out could be predicted with both models")
    rms = np.sqrt(mean(every[:2]))
    still, least = np.sqrt(mean(every[2:]))
    told = ~(rms.min(axis=0) >= still)
    told |= not told.any()
    tables = [
        {
            o.name: Errors(unit=o.unit, windows={span: float(v) for span, v in zip(spans, values, strict=True) if np.isfinite(v)})
            for o, values in zip(outputs, side, strict=True)
        }
        for side in rms
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(rms[1] / rms[0])[told]
    improvement = 100.0 * (1.0 - float(np.exp(np.mean(ratio[np.isfinite(ratio)])))) if np.isfinite(ratio).any() else 0.0
    told_squares = [np.where(told[:, :, None], part[:2], np.nan) for part in squares]
    gains = [gain for part in told_squares for gain in block_gains(part, mean(every[:2]))]
    return HeldOut(
        before=tables[0],
        after=tables[1],
        improvement_percent=improvement,
        attainable_percent=_attained(rms[0][told], rms[1][told], least[told]),
        p_value=chance(np.array(gains)),
        blocks=len(gains),
        recordings=tuple(names),
        role=role,
        force=_forces(before.smoothed, after.smoothed),
    )


def _attained(before: Array, after: Array, least: Array) -> float | None:
    """Percent of what errors (n,) could become smaller at best; None where that is next to nothing."""
    there = np.isfinite(before) & np.isfinite(after) & (before > 0)
    gained, possible = (float(np.sum(1.0 - e[there] / before[there])) for e in (after, np.minimum(least, before)))
    return 100.0 * gained / possible if possible > LITTLE * np.count_nonzero(there) else None


def _forces(before: Smoothing, after: Smoothing) -> dict[str, tuple[float, float, str]]:
    """Place -> rms of the residual force with both models, as smoothing tells it, and its unit."""
    pairs = ((name, first, after.residual_places.get(name)) for name, first in before.residual_places.items())
    return {name: (first.rms, second.rms, first.unit) for name, first, second in pairs if second is not None}
