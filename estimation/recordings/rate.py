"""How fast a signal moves, by its samples alone."""

from __future__ import annotations

import numpy as np

Array = np.ndarray[tuple[int], np.dtype[np.float64]]

BESIDE = 4  # samples on either side


def rate(time: Array, y: Array) -> Array:
    """Rates (n,) of samples y (n,), NaN where missing, at times (n,), from the fourth before to the fourth after; 0 where none are."""
    found, there = np.zeros(len(y)), np.flatnonzero(np.isfinite(y))
    if len(there) > 1:
        k = np.arange(len(there))
        low, high = there[np.maximum(k - BESIDE, 0)], there[np.minimum(k + BESIDE, len(there) - 1)]
        found[there] = (y[high] - y[low]) / (time[high] - time[low])
    return found
