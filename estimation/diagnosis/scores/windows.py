"""What acts for a while: between any two of the times from which on an effect was looked at.

Its columns are those of what acts from the first time on, less those from the second on. So are its scores, which makes all pairs of times
cost next to nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .score import Scores
from .supermodel import Look

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """The look at what acts for a while that gains most, its scores, of how many, and what these gain by every draw at most (draws,)."""

    look: Look
    scores: Scores
    count: int
    gained: Array


def best_window(looks: Sequence[Look], scores: Scores, drawn: Array, told: float) -> Window | None:
    """Of looks, with their scores, at one effect of one strength from several times on. None where there are no two of them.

    drawn (n, draws): scores of the same by chance. told: of a strength's squares before all that is free is projected out, that tells it.
    """
    steps = [k for k, look in enumerate(looks) if look.candidate.onset is not None]
    if len(steps) < 2:
        return None
    first, last = (np.array(steps)[side] for side in np.triu_indices(len(steps), 1))
    b, plain = scores.b[first] - scores.b[last], scores.plain[first] - scores.plain[last]
    G = scores.G[first, first] - 2 * scores.G[first, last] + scores.G[last, last]
    seen = np.flatnonzero(told * np.maximum(plain, np.finfo(float).tiny) < G)
    if not len(seen):
        return None
    by_chance = drawn[first[seen]] - drawn[last[seen]]
    gains, chance = b[seen] ** 2 / (2 * G[seen]), by_chance**2 / (2 * G[seen, None])
    if looks[0].candidate.one_sided:
        gains, chance = np.where(b[seen] < 0, gains, 0.0), np.where(by_chance < 0, chance, 0.0)
    k = seen[int(np.argmax(gains))]
    begun, ended = looks[first[k]], looks[last[k]]
    whole, since = begun.whole, ended.candidate.onset
    candidate = None if whole is None else whole.candidate.since(begun.candidate.onset, since)
    if candidate is None:
        return None
    look = Look(candidate=candidate, shape=begun.shape, columns=begun.columns.less(ended.columns), whole=whole)
    one = Scores(b=b[[k]], G=G[[k], None], plain=plain[[k]])
    return Window(look=look, scores=one, count=len(seen), gained=chance.max(axis=0))
