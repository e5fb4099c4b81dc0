"""Parameters at which a solve, with its terms referred to them, finds these parameters again."""

from __future__ import annotations

import numpy as np

from .polynomials import Array

SHORTEST_SECANT = 0.2  # of the step to the answer
DEARER = 10.0  # times the cost before: that was no step towards where both are the same


class FixedPoint:
    """Parameters p = G(p), G a solve with the terms referred to p: where the answers go to and fro, secant steps between them.

    A step that leads to where the solve costs far more is taken back and made shorter. drift: relative change within which an answer is
    where it was sought.
    """

    def __init__(self, drift: float) -> None:
        self._drift, self._history = drift, list[tuple[Array, Array, float]]()

    def reached(self, p: Array, answer: Array, cost: float) -> bool:
        """Whether G(p) = answer, found at this cost, is p; if not, `next` has what to try."""
        self._history.append((p, answer - p, cost))
        return not np.any(np.abs(answer - p) > self._drift * np.abs(answer))

    def dearer(self, cost: float) -> bool:
        """Whether a solve costs far more than the last one that was reported."""
        return bool(self._history) and cost > DEARER * max(self._history[-1][2], 1.0)

    def back(self, p: Array) -> Array:
        """What to try instead of p, from where the solve was dear."""
        before = self._history[-1][0]
        return np.asarray(before + SHORTEST_SECANT * (p - before))

    def next(self) -> Array:
        """Of each parameter the secant of the last two, no shorter than a fifth and no longer than the step from one to the answer."""
        p, f, _ = self._history[-1]
        if len(self._history) == 1:
            return p + f
        before, f_before, _ = self._history[-2]
        turn = f_before - f
        length = np.divide(p - before, turn, out=np.ones_like(f), where=turn * (p - before) > 0)
        return np.asarray(p + np.clip(length, SHORTEST_SECANT, 1.0) * f)
