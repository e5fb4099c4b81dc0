"""A known delay of a sensor, taken out of its samples."""

from __future__ import annotations

import numpy as np

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def advance(time: Array, values: Array, delay: float) -> Array:
    """What a sensor that lags by `delay` would have shown without the lag.

        y(t_k) = recorded(t_k + delay)

    Where t_k + delay falls on a sample the value is that sample; between samples it is the cubic through the four
    nearest (the line through the nearest two where there are no four in a row). Missing where a neighbour is missing,
    beyond the ends, and inside gaps longer than three median sampling intervals.
    """
    wanted = time + delay
    n = len(time)
    left = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, n - 2)
    step = time[left + 1] - time[left]
    s = (wanted - time[left]) / step
    s = np.where(np.abs(s - np.round(s)) < 1e-6, np.round(s), s)

    line = np.where(s == 0.0, values[left], np.where(s == 1.0, values[left + 1], (1 - s) * values[left] + s * values[left + 1]))
    four = np.clip(left[:, None] + np.arange(-1, 3), 0, n - 1)
    whole = (left >= 1) & (left <= n - 3) & np.isfinite(values[four]).all(axis=1) & (np.diff(time[four], axis=1).max(axis=1) < 1.5 * step)
    cubic = np.zeros(n)
    for j in range(4):
        weight = np.ones(n)
        for i in range(4):
            if i != j:
                spread = time[four[:, j]] - time[four[:, i]]
                weight *= (wanted - time[four[:, i]]) / np.where(spread == 0.0, 1.0, spread)
        cubic += weight * np.where(whole, values[four[:, j]], 0.0)

    between = (s != 0.0) & (s != 1.0)
    result = np.where(whole & between, cubic, line)
    beyond = (s < 0.0) | (s > 1.0) | (between & (step > 3 * np.median(np.diff(time))))
    return np.where(beyond, np.nan, result)
