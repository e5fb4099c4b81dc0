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
blocks are so long that their means may count as independent: six integrated autocorrelation times as the windows tell them, which
tell too few of them where they remember long.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backsight.models import SolveError

from ...problem import Problem
from ...recordings.recording import Recording
from ...results import Smoothing
from ..answer.verdict import Errors, HeldOut
from .blocks import block_gains, chance, mean
from .predictor import Predictor

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = NDArray[np.int64]
Case = tuple[Problem, Smoothing]
Progress = Callable[[str], None]

SPANS = (0.05, 0.25)  # s
LONGEST = 0.1  # of the recording: the dominant time constant counts up to there
GROWN = 100.0  # times an error of the start: a window that lets it grow so far is none
WHOLE = 0.25  # of the recording: a window longer than that is none
WINDOWS = 100  # of a recording
FEWEST = 0.1  # of the rows of a piece: where fewer are left windows begin anywhere
LITTLE = 0.05  # gain of free forces, as a share of the errors: of so little no share is told


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What was held out: recordings, and what role they have ("held_out", or "last third" of the only one).

    end: on the clock of `time.monotonic`, for all that is smoothed.
    """

    recordings: Sequence[Recording]
    role: str = "held_out"
    end: float = math.inf
    say: Progress = lambda _: None

    @property
    def left(self) -> float:
        """Time until the end [s]."""
        return self.end - time.monotonic()

    def predictor(self, case: Case, word: str, beside: Predictor | None = None) -> Predictor:
        """A fitted model on what was held out. word: what it is called; beside: another one, where its smoothing begins.

        Raises SolveError where a recording cannot be smoothed with it in time.
        """
        self.say(f"smoothing what was held out with {word}")
        return Predictor.of(*case, self.recordings, beside.solution if beside else None, self.end)

    def compared(self, before: Predictor, after: Predictor) -> HeldOut:
        """What the windows' errors of two models are, and how much the difference is worth.

        Of an output of which neither tells more, over a span, than that it stays where it was, no error counts. Raises SolveError where no
        window can be predicted with both.
        """
        self.say("predicting windows of what was held out")
        spans = horizons(after, self.recordings)
        pieces = [piece for r in self.recordings for piece in r.pieces]
        outputs = [q for q in before.problem.dae.outputs if any(q.name in piece.outputs for piece in pieces)]
        squares = [_squares(before, after, number, piece, spans, [q.name for q in outputs]) for number, piece in enumerate(pieces)]
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
            recordings=tuple(r.name for r in self.recordings),
            role=self.role,
            force=_forces(before.smoothed, after.smoothed),
        )


def prove(before: Case, after: Case, recordings: Sequence[Recording]) -> HeldOut:
    """Compare two fitted models on recordings: smoothed with both of them, windows predicted from there."""
    proof = Proof(recordings=recordings)
    base = proof.predictor(before, "the base model")
    return proof.compared(base, proof.predictor(after, "the repaired model", base))


def horizons(side: Predictor, recordings: Sequence[Recording]) -> list[float]:
    """50 ms, 250 ms and the dominant time constant of a model [s], those that fit the recordings.

    Of an unstable machine what is longer than its errors need to grow a hundredfold is none: it tells of the start.
    """
    step, whole = max(r.sampling for r in recordings), min(float(r.time[-1] - r.time[0]) for r in recordings)
    slowest, growth = min(side.time_constant(), LONGEST * whole), side.growth()
    longest = min(WHOLE * whole, np.log(GROWN) / growth if growth > 0 else np.inf)
    found = {span for span in (*SPANS, float(f"{slowest:.3g}")) if step * 0.999 <= span <= longest}
    return sorted(found) or [max(step, min(LONGEST * whole, longest))]


def _windows(piece: Recording, spans: Sequence[float], known: NDArray[np.bool_]) -> tuple[Index, int]:
    """Rows where windows of a piece begin, of those where its state is known well, and how many rows the longest has after its first."""
    n, step = len(piece.time), float(np.median(np.diff(piece.time)))
    longest, shortest = min(max(1, round(max(spans) / step)), n - 1), max(1, round(min(spans) / step))
    rows = np.flatnonzero(known[: max(n - shortest, 1)])
    if len(rows) < max(FEWEST * n, 1):
        rows = np.arange(max(n - shortest, 1))
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(WINDOWS, len(rows))).astype(np.int64))], longest


def _squares(before: Predictor, after: Predictor, number: int, piece: Recording, spans: Sequence[float], outputs: Sequence[str]) -> Array:
    """Mean squares of a piece's windows, over the rows within a span: (4, outputs, spans, M).

    Of the errors of both models, of what stays where it was, and of what is left at best.
    """
    rows, length = _windows(piece, spans, before.known(number) & after.known(number))
    errors_of = {
        side: side.error(number, rows, length)[[[q.name for q in side.problem.dae.outputs].index(name) for name in outputs]]
        for side in {before, after}
    }
    a, b = errors_of[before], errors_of[after]  # one model may be both
    both = np.isfinite(a) & np.isfinite(b)
    at = np.minimum(rows[:, None] + np.arange(a.shape[2]), len(piece.time) - 1)
    y = np.array([piece.outputs.get(name, np.full(len(piece.time), np.nan)) for name in outputs])
    since = piece.time[at] - piece.time[at[:, :1]]
    half = float(np.median(np.diff(piece.time))) / 2
    within = np.array([(since > 0) & (since < span + half) for span in spans])
    whole = np.array([piece.time[-1] - piece.time[at[:, 0]] > span - half for span in spans])
    used = both[:, None] & within & whole[:, :, None]
    floor = before.floor(number)[[[q.name for q in before.problem.dae.outputs].index(name) for name in outputs]]
    with np.errstate(invalid="ignore"):
        errors = a, b, y[:, at] - y[:, at[:, :1]], np.broadcast_to(floor[:, None, None], a.shape)
        return np.array([mean(np.where(used, e[:, None] ** 2, np.nan)) for e in errors])


def _attained(before: Array, after: Array, least: Array) -> float | None:
    """Percent of what errors (n,) could become smaller at best, 100 at most; None where that is next to nothing.

    Forces that are free at every place follow some of the noise, so that a right model may leave less than they do.
    """
    there = np.isfinite(before) & np.isfinite(after) & (before > 0)
    gained, possible = (float(np.sum(1.0 - e[there] / before[there])) for e in (after, np.minimum(least, before)))
    return min(100.0 * gained / possible, 100.0) if possible > LITTLE * np.count_nonzero(there) else None


def _forces(before: Smoothing, after: Smoothing) -> dict[str, tuple[float, float, str]]:
    """Place -> rms of the residual force with both models, as smoothing tells it, and its unit."""
    pairs = ((name, first, after.residual_places.get(name)) for name, first in before.residual_places.items())
    return {name: (first.rms, second.rms, first.unit) for name, first, second in pairs if second is not None}
