"""Single samples that stand far off their neighbours, found before any model: what a start need not follow.

A sample is compared with cubics through four of its neighbours: one ahead of it, one behind, and the median over seven choices, in
which no neighbour has a part in more than three. It is far off only when it is far from all three: after a step of the signal it agrees
with what follows, and beside an outlier the median does not care (the idea of Hampel's filter: Pearson, IEEE Trans. Control Systems
Technology 10, 2002, with cubics for the constant).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .noise import noise_std
from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Mask = NDArray[np.bool_]

AHEAD, BEHIND = (1, 2, 3, 4), (-4, -3, -2, -1)
AROUND = (AHEAD, BEHIND, (-3, -1, 1, 3), (-4, -2, 2, 4), (-2, -1, 1, 2), (-4, -3, 3, 4), (-6, -5, 5, 6))
GROSS = 10.0  # standard deviations of what is usual
# A sample less the cubic through four on one side has root(1 + 4^2 + 6^2 + 4^2 + 1) = 8.4 times its noise; four deviations of that count
# as GROSS.
EXTRAPOLATED = 3.4
PASSES = 3  # an outlier may hide its neighbour
MOST = 0.25  # of the samples: more are no outliers but what the signal is like


def outlying(time: Array, y: Array) -> Mask:
    """Which samples of y (n,), NaN where missing, at the times (n,) are gross outliers."""
    bad = np.zeros(len(y), dtype=bool)
    noise = noise_std(time, y)
    for _ in range(PASSES):
        there = np.flatnonzero(np.isfinite(y) & ~bad)
        distance = _distance(time[there], y[there])
        usual = max(float(np.median(distance)) / 0.6745, noise) if len(there) else np.inf
        found = there[distance > GROSS * usual]
        if not 0 < len(found) < MOST * len(there):
            break
        bad[found] = True
    return bad


def screened(recording: Recording) -> Recording:
    """The recording without the gross outliers of those outputs whose loss expects some."""
    outputs = {
        name: np.where(outlying(recording.time, y), np.nan, y) if recording.output_loss[name] != "square" else y
        for name, y in recording.outputs.items()
    }
    return replace(recording, outputs=outputs)


def _distance(time: Array, y: Array) -> Array:
    """Least distance of every sample from the cubics around it, and of those ahead and behind a share; zero where no neighbours tell."""
    if len(y) < 5:
        return np.zeros(len(y))
    values = np.array([_cubic(time, y, offsets) for offsets in AROUND])
    known = np.isfinite(values)
    middle = np.full(len(y), np.nan)
    some = known.any(axis=0)
    middle[some] = np.nanmedian(values[:, some], axis=0)
    distances = np.abs(np.array([values[0], values[1], middle]) - y) / np.array([[EXTRAPOLATED], [EXTRAPOLATED], [1.0]])
    return np.asarray(np.where(some, np.min(np.where(np.isfinite(distances), distances, np.inf), axis=0), 0.0))


def _cubic(time: Array, y: Array, offsets: tuple[int, ...]) -> Array:
    """At every sample the cubic through the samples at these offsets from it, by Lagrange's formula; NaN beyond the ends."""
    n = len(y)
    rows = np.arange(n)[:, None] + np.array(offsets)
    inside = np.all((rows >= 0) & (rows < n), axis=1)
    rows = np.clip(rows, 0, n - 1)
    t, out = time[rows], np.zeros(n)
    for j in range(len(offsets)):
        weight = np.ones(n)
        for i in range(len(offsets)):
            if i != j:
                spread = t[:, j] - t[:, i]
                weight *= (time - t[:, i]) / np.where(spread == 0.0, 1.0, spread)
        out += weight * y[rows[:, j]]
    return np.where(inside, out, np.nan)
