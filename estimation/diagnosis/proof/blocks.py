"""Is a gain more than chance? Paired over blocks of windows, long enough that their means may count as independent."""

from __future__ import annotations

import numpy as np
from scipy import stats

from ...validation.whiteness import effective_samples

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

# autocorrelation times of a block: as a short series tells them they are too short (its mean is taken from it), the more so the longer
MEMORY = 6.0
BLOCKS = (2, 30)


def block_gains(squares: Array, every: Array) -> list[float]:
    """d_b of every block of a piece: mean over outputs and spans of log(before/after) of the rms there.

    squares (2, outputs, spans, M): mean squares of the windows; every (2, outputs, spans): over all. The memory is that of what a window
    adds to the gain of all of them, to first order: half the difference of its two squares, each relative to its mean.
    """
    M = squares.shape[3]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = squares[0] / every[0][:, :, None] - squares[1] / every[1][:, :, None]
    series = mean(relative.reshape(-1, M).T)
    there = series[np.isfinite(series)]
    if not len(there):
        return []
    memory = len(there) / effective_samples(there - there.mean()) if np.ptp(there) > 0 else 1.0
    count = int(np.clip(M / (MEMORY * memory), min(BLOCKS[0], M), BLOCKS[1]))
    gains = []
    for part in np.array_split(np.arange(M), count):
        with np.errstate(divide="ignore", invalid="ignore"):
            own = mean(squares[..., part])
            log = 0.5 * np.log(own[0] / own[1])
        if np.isfinite(log).any():
            gains.append(float(np.mean(log[np.isfinite(log)])))
    return gains


def chance(gains: Array) -> float:
    """One-sided p-value of Student's t that the mean of independent gains is not above zero; 1 for fewer than two."""
    if len(gains) < 2:
        return 1.0
    middle, spread = float(np.mean(gains)), float(np.std(gains, ddof=1))
    if not spread > 1e-12 * max(abs(middle), 1e-300):
        return 0.5 if middle == 0 else float(middle < 0)
    return float(stats.t.sf(middle / (spread / np.sqrt(len(gains))), len(gains) - 1))


def mean(values: Array) -> Array:
    """Mean over the last axis of what is there; NaN where nothing is."""
    there = np.isfinite(values)
    count = there.sum(axis=-1)
    return np.where(count > 0, np.where(there, values, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)
