"""Where a stage ends when no residual force acts in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..called import Called
from ..polynomials import Array
from .stage import Stage

STEPS = 10  # Newton steps
PRECISE = 1e-9  # relative size of the last one


class Prediction:
    """(state at the start (nx,), p (np,), numbers of the stage (nd,), unknowns inside at first) -> state at the end, unknowns inside.

    balances: the stage's, in another form.
    """

    def __init__(self, stage: Stage, balances: Any = None) -> None:
        self._interpolation, self.balances = stage.interpolation, Called(stage.balances if balances is None else balances)

    def __call__(self, start: Array, p: Array, d: Array, inner: Array) -> tuple[Array, Array]:
        ip = self._interpolation
        y = self.solved(np.concatenate([start, inner, start, p]), p, d, np.zeros(ip.local - ip.states))
        return y[ip.states + ip.interior : ip.local], y[ip.states : ip.states + ip.interior]

    def solved(self, y: Array, p_ref: Array, d: Array, wanted: Array) -> Array:
        """Unknowns (local + np,) from these, the state at the start and p as they are, with which the balances' moments are as wanted."""
        ip = self._interpolation
        own, y = slice(ip.states, ip.local), y.copy()
        for _ in range(STEPS):
            e, J = self.balances(y, p_ref, d)
            try:
                step = np.linalg.solve(J[:, own], wanted - e[:, 0])
            except np.linalg.LinAlgError:
                break
            if not np.all(np.isfinite(step)):
                break
            y[own] += step
            if np.all(np.abs(step) <= PRECISE * (1.0 + np.abs(y[own]))):
                break
        return y
