"""Single samples that stand far off their neighbours, found before any model: what a start need not follow.

A sample is compared with cubics through four of its neighbours: one ahead of it, one behind, and the median over seven choices, in
which no neighbour has a part in more than three. It is far off only when it is far from all three: after a step of the signal it agrees
with what follows, and beside an outlier the median does not care (the idea of Hampel's filter: Pearson, IEEE Trans. Control Systems
Technology 10, 2002, with cubics for the constant). At the ends, and where outliers are close, good samples look bad: those found are held
against those that were not, and taken back where they agree.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .noise import noise_std, robust_std
from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

AHEAD, BEHIND = (1, 2, 3, 4), (-4, -3, -2, -1)
AROUND = (AHEAD, BEHIND, (-3, -1, 1, 3), (-4, -2, 2, 4), (-2, -1, 1, 2), (-4, -3, 3, 4), (-6, -5, 5, 6))
GROSS = 10.0  # standard deviations of what is usual
# A sample less the cubic through the four next to it on one side has root(1 + 4^2 + 6^2 + 4^2 + 1) = 8.4 times its noise: four deviations
# of that count as GROSS. Where these are farther away it has more, and from ROUGH times on they do not tell; but no more is forgiven, or
# outliers side by side would excuse each other.
EXTRAPOLATED, NEXT, ROUGH = 0.4, 8.4, 40.0
PASSES = 3  # an outlier may hide its neighbour
MOST = 0.25  # of the samples: more are no outliers but what the signal is like


def outlying(time: Array, y: Array) -> Mask:
    """Which samples of y (n,), NaN where missing, at the times (n,) are gross outliers."""
    bad = np.zeros(len(y), dtype=bool)
    noise, limit = noise_std(time, y), np.inf
    for _ in range(PASSES):
        there = np.flatnonzero(np.isfinite(y) & ~bad)
        distance = _distance(time, y, there, there)
        told = distance[np.isfinite(distance)]
        limit = GROSS * max(robust_std(told), noise) if len(told) else np.inf
        found = there[distance > limit]
        if not 0 < len(found) < MOST * len(there):
            break
        bad[found] = True
    for _ in range(PASSES):
        found = np.flatnonzero(bad)
        bad[found] = ~(_distance(time, y, found, np.flatnonzero(np.isfinite(y) & ~bad)) <= limit)
    return bad


def screened(recording: Recording) -> Recording:
    """The recording without the gross outliers of those outputs whose loss expects some."""
    outputs = {
        name: np.where(outlying(recording.time, y), np.nan, y) if recording.output_loss[name] != "square" else y
        for name, y in recording.outputs.items()
    }
    return replace(recording, outputs=outputs)


def _distance(time: Array, y: Array, rows: Rows, others: Rows) -> Array:
    """Least distance of these rows from the cubics through others, and of those ahead and behind a share; NaN where none tell."""
    if len(others) < 5:
        return np.full(len(rows), np.nan)
    ahead, behind = np.searchsorted(others, rows, side="right"), np.searchsorted(others, rows) - 1
    cubics, rough = list[Array](), list[Array]()
    for offsets in AROUND:
        near = np.stack([ahead + o - 1 if o > 0 else behind + o + 1 for o in offsets], axis=1)
        inside = np.all((near >= 0) & (near < len(others)), axis=1)
        cubic, noise = _cubic(time[rows], time, y, others[np.clip(near, 0, len(others) - 1)])
        cubics.append(np.where(inside & (noise < ROUGH), cubic, np.nan))
        rough.append(EXTRAPOLATED * np.minimum(noise, NEXT))
    some = np.isfinite(cubics).any(axis=0)
    middle = np.full(len(rows), np.nan)
    middle[some] = np.nanmedian(np.array(cubics)[:, some], axis=0)
    distances = np.abs(np.array([cubics[0], cubics[1], middle]) - y[rows]) / np.array([rough[0], rough[1], np.ones(len(rows))])
    return np.asarray(np.where(some, np.min(np.where(np.isfinite(distances), distances, np.inf), axis=0), np.nan))


def _cubic(at: Array, time: Array, y: Array, near: Rows) -> tuple[Array, Array]:
    """At every time (m,) the cubic through four samples, near (m, 4), by Lagrange's formula; and the noise of a sample less that."""
    t, out, squares = time[near], np.zeros(len(at)), np.ones(len(at))
    for j in range(near.shape[1]):
        weight = np.ones(len(at))
        for i in range(near.shape[1]):
            if i != j:
                spread = t[:, j] - t[:, i]
                weight *= (at - t[:, i]) / np.where(spread == 0.0, 1.0, spread)
        out += weight * y[near[:, j]]
        squares += weight**2
    return out, np.sqrt(squares)
