"""When an effect acts: from the start or from some time on, in both directions or in one.

The columns of a candidate are those of its rows. With the rows of one regime only, the score asks what the effect would gain if it acted
there and nowhere else; where that is as much as it gains everywhere, or more, the effect is of that regime.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .score import Columns, Linearised
from .screen import gain
from .supermodel import Look

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ONSETS = 40  # times that are tried
PLAINLY, PART = 10.0, 0.02  # nats, and share of the gain, by which an effect that starts late has to beat one that does not
EDGE = 0.04  # of the recording: what starts before that starts with it


@dataclass(frozen=True, kw_only=True)
class Regime:
    """In words, and the time from which on [s], None from the start."""

    words: str
    onset: float | None


def regime(base: Linearised, look: Look) -> Regime:
    """Of an effect, from its columns at the solution of the model without it."""
    t = base.solution.transcription
    squares, multiplied = _times(base)
    if len(t.horizons) > 1:
        return Regime(words="whole record", onset=None)
    horizon = t.horizons[0]
    span = float(horizon.time[-1] - horizon.time[0])
    times = horizon.time[0] + span * np.linspace(0.0, 1.0, ONSETS + 2)[1:-1]
    parts = [_from(look.columns, squares, multiplied, at) for at in times]
    scores = base.scores(Columns.joined([look.columns, *parts]))
    n = len(look.columns)
    gains = [gain(scores, range(k * n, (k + 1) * n)) for k in range(len(times) + 1)]
    best = int(np.argmax(gains[1:]))
    if gains[1 + best] - gains[0] > max(PLAINLY, PART * gains[0]) and times[best] - horizon.time[0] > EDGE * span:
        at = float(times[best])
        return Regime(words=f"from {at:.4g} s on", onset=at)
    return Regime(words="whole record", onset=None)


def _from(columns: Columns, squares: Array, multiplied: Array, at: float) -> Columns:
    return Columns(squares=columns.squares * (squares >= at)[:, None], multiplied=columns.multiplied * (multiplied >= at)[:, None])


def _times(base: Linearised) -> tuple[Array, Array]:
    """Time of every row of the squares, and of those with multipliers."""
    t = base.solution.transcription
    starts = np.concatenate([h.mesh.knots[:-1] for h in t.horizons])
    squares, multiplied = [np.empty(0)], [np.empty(0)]
    for term in t.nlp.terms:
        at = starts[term.interval]
        if term.tau is not None:
            at = at + term.tau * t.nlp.steps[term.interval]
        elif term.nodes is not None:
            at = at + t.nlp.steps[term.interval] / 2
        (multiplied if term.equality or term.heavy else squares).append(np.repeat(at, term.target.shape[0]))
    return np.concatenate(squares), np.concatenate(multiplied)
