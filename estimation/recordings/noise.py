"""How noisy is a signal? Answered from the samples alone, before any model.

The d-th difference of a smooth signal is tiny, that of white noise is not: its variance is binom(2d, d) times the noise's.
"""

from __future__ import annotations

from math import comb

import numpy as np

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def noise_std(y: Array, supposed: float | None = None) -> float:
    """Standard deviation of the white noise in y (n,), NaN where missing; never below quantisation, step/sqrt(12).

    The least over differences of order 2 to 6: too low an order sees the signal, and all see the noise.
    Runs without missing samples are used; robust against jumps (median of absolute differences) unless most differences are zero.
    supposed: what is said where no run is long enough to tell (by itself a thousandth of the signal's variation).
    """
    estimates = []
    for order in range(2, 7):
        d = np.diff(y, order)
        d = d[np.isfinite(d)]
        if d.size < 8:
            break
        rms, robust = float(np.sqrt(np.mean(d**2))), float(np.median(np.abs(d))) / 0.6745
        estimates.append((robust if np.mean(d == 0.0) < 0.3 else rms) / np.sqrt(comb(2 * order, order)))
    finite = y[np.isfinite(y)]
    floor = _step(finite) / np.sqrt(12.0)
    size = float(np.std(finite)) or float(np.max(np.abs(finite), initial=0.0)) or 1.0
    return float(max(min(estimates, default=supposed or 1e-3 * size), floor, 1e-9 * size))


def _step(y: Array) -> float:
    """The least significant step of a quantised signal; 0 when the values are not on a grid."""
    values = np.unique(y)
    if values.size < 3 or values.size > 0.5 * y.size:
        return 0.0
    return float(np.diff(values).min())
