"""One step of the Runge-Kutta formula of fifth order of Dormand and Prince, at any length: events are found by shortening it.

J. R. Dormand, P. J. Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6 (1980), table 2, RK5(4)7M.
The local error is of sixth order in the step; there is no control of the step, the caller halves it to see the error.
"""

from collections.abc import Callable

import numpy as np

__all__ = ["advance", "step"]

Rates = Callable[[float, np.ndarray], np.ndarray]

C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0)
A = (
    np.array([]),
    np.array([1 / 5]),
    np.array([3 / 40, 9 / 40]),
    np.array([44 / 45, -56 / 15, 32 / 9]),
    np.array([19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]),
    np.array([9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]),
)
B = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])


def step(rates: Rates, t: float, y: np.ndarray, h: float) -> np.ndarray:
    """y (n,) at t + h, from y at t and y' = rates(t, y)."""
    slopes = np.empty((len(B), y.size))
    for i, (c, a) in enumerate(zip(C, A, strict=True)):
        slopes[i] = rates(t + c * h, y + h * (a @ slopes[:i]) if i else y)
    return y + h * (B @ slopes)


def advance(rates: Rates, t: float, y: np.ndarray, duration: float, steps: int) -> np.ndarray:
    """y (n,) at t + duration after equal steps."""
    h = duration / steps
    for i in range(steps):
        y = step(rates, t + i * h, y, h)
    return y
