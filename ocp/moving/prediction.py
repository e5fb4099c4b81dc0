"""Where a stage ends when no residual force acts in it."""

from __future__ import annotations

import numpy as np

from ..polynomials import Array
from .called import Called
from .stage import Stage

STEPS = 10  # Newton steps
PRECISE = 1e-9  # relative size of the last one


class Prediction:
    """(state at the start (nx,), p (np,), numbers of the stage (nd,)) -> state at the end, unknowns inside."""

    def __init__(self, stage: Stage) -> None:
        self._interpolation, self._balances = stage.interpolation, Called(stage.balances)

    def __call__(self, start: Array, p: Array, d: Array) -> tuple[Array, Array]:
        ip = self._interpolation
        own = slice(ip.states, ip.local)
        y = np.concatenate([start, np.zeros(ip.interior), start, p])
        for _ in range(STEPS):
            e, J = self._balances(y, p, d)
            try:
                step = np.linalg.solve(J[:, own], -e[:, 0])
            except np.linalg.LinAlgError:
                break
            if not np.all(np.isfinite(step)):
                break
            y[own] += step
            if np.all(np.abs(step) <= PRECISE * (1.0 + np.abs(y[own]))):
                break
        return y[ip.states + ip.interior : ip.local], y[ip.states : ip.states + ip.interior]
