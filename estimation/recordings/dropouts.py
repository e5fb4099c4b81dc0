"""Stretches in which a signal is far off what it is around them, and goes and comes back at once: a counter that misses its marks.

A row stands off by more than GROSS robust deviations of the signal about its running median; or several read one value, though the signal
is no held one, and it is far off from them at both ends. A stretch of such rows is one that drops out where most of the way there, and most
of the way back, is a jump of one row or two. That may be a pulse that somebody meant, too: what the machine did tells
(`diagnosis/start/dropouts.py`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.ndimage import median_filter

from .noise import robust_std
from .outliers import outlying

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Mask = NDArray[np.bool_]

GROSS = 6.0  # robust deviations about the running median
AROUND = 0.1  # of the rows: of the running median
LONGEST = 0.4  # of those: a longer stretch may be the signal, and what is around it not
MOST = 0.25  # of all rows: more are no dropouts but what the signal is like
JUMP = 0.5  # of how far a stretch stands off: by so much it goes and comes back within two rows
OFTEN = 0.3  # of the rows that read what the one before does: such a signal is held
ORDER = 24  # of the autoregression
FEWEST = 9  # rows
ASTRAY = 0.02  # of all that a signal does: single samples that are off by less are noise that has tails
FROZEN = 6  # rows that read the same, before one that is elsewhere at once
APART = 0.9  # of how far a stretch stands off: so far apart may be what is on either side
BESIDE = 1  # rows on either side of a stretch, of which a mean or a filter makes a part of it


def dropped_out(u: Array) -> Mask:
    """Rows of a signal (n,) that drop out, and those beside them."""
    n, out = len(u), np.zeros(len(u), dtype=bool)
    width = 2 * round(AROUND * n / 2) + 1
    if width < FEWEST:
        return out
    off, least = np.abs(u - median_filter(u, size=width, mode="nearest")), GROSS * robust_std(np.diff(u))
    found = stretches(off > GROSS * usual) if (usual := robust_std(off)) > 0 else []
    for first, last in [*found, *_of_one_value(u)]:
        inside = first > BESIDE and last < n - BESIDE - 1 and last - first < LONGEST * width
        if inside and _goes_and_comes(u, first, last, least):
            out[first - BESIDE : last + BESIDE + 1] = True
    return out if out.mean() < MOST else np.zeros(n, dtype=bool)


def _of_one_value(u: Array) -> list[tuple[int, int]]:
    """Runs of a signal that read one value, and are far off from one row to the next on either side; none of one that often does."""
    steps = np.abs(np.diff(u))
    if np.mean(steps == 0) > OFTEN:
        return []
    least = GROSS * robust_std(steps)
    runs = ((first, last + 1) for first, last in stretches(steps == 0))  # of rows, not of what is between them
    return [(a, b) for a, b in runs if b - a >= 2 and a > 0 and b < len(u) - 1 and min(steps[a - 1], steps[b]) > least]


def _goes_and_comes(u: Array, first: int, last: int, least: float) -> bool:
    """Whether a stretch is so far off the line between the rows around it, and most of that is done within two rows at either end."""
    before, after, run = u[first - BESIDE - 1], u[last + BESIDE + 1], u[first : last + 1]
    off = np.abs(run - np.linspace(before, after, len(run) + 2)[1:-1]).max()
    gone, back = (np.abs(run[ends] - there).max() for ends, there in ((np.s_[:2], before), (np.s_[-2:], after)))
    return bool(off > least and min(gone, back) > JUMP * off and abs(after - before) < APART * off)


def blank(time: Array, y: Array, *, single: bool = True) -> Mask:
    """Rows of samples y (n,), NaN where missing, at times (n,) that are none of what was measured.

    They read one value while they drop out, or stay at the last one until what was measured is elsewhere at once. single: single ones that
    stand far off their neighbours, too, by a share of all that the signal does.
    """
    there, out = np.isfinite(y), np.zeros(len(y), dtype=bool)
    if np.count_nonzero(there) < FEWEST:
        return out
    whole = np.interp(time, time[there], y[there])
    if single:
        span = np.ptp(whole[~(off := outlying(time, y))])
        out |= off & (np.abs(whole - median_filter(whole, size=5, mode="nearest")) > ASTRAY * span)
    for first, last in stretches(dropped_out(whole)):
        inside = slice(first + BESIDE, last + 1 - BESIDE)
        out[inside] |= last - first > 2 * BESIDE and np.ptp(whole[inside]) == 0
    steps = np.abs(np.diff(whole))
    usual = GROSS * robust_std(steps[steps > 0]) if steps.any() else np.inf
    for first, last in stretches(steps == 0):  # rows first .. last + 1 read the same
        after = steps[last + 1 : last + 3]
        if last - first + 2 >= FROZEN and len(after) == 2 and after[0] > max(usual, 2 * after[1]):
            out[first + 1 : last + 2] = True
    return out & there


def stretches(rows: Mask) -> list[tuple[int, int]]:
    """First and last row of every run of rows that are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(np.int8)))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]


def likely(u: Array) -> Array:
    """A signal (n,) with what drops out as its other rows foretell it: with the least squares of an autoregression's errors.

    A. Janssen, R. Veldhuis, L. Vries, Adaptive interpolation of discrete-time signals that can be modeled as autoregressive processes,
    IEEE Trans. Acoustics, Speech, Signal Processing 34, 1986. What is regular goes on as it does on either side, and noise has its mean.
    """
    out, rows = dropped_out(u), np.arange(len(u))
    torn = stretches(out)
    if not torn:
        return u
    straight = np.interp(rows, rows[~out], u[~out])
    level, room = u[~out].mean(), np.ptp(u[~out])
    order = min(ORDER, len(u) // 10)
    v = straight - level
    past, whole = (np.lib.stride_tricks.sliding_window_view(x, order + 1) for x in (v, ~out))
    told = whole.all(axis=1)
    a = np.linalg.lstsq(past[told, :-1], past[told, -1], rcond=None)[0]
    for first, last in torn:
        low, high = max(first - order, 0), min(last + order + 1, len(u))
        ahead = np.zeros(high - low - order - 1)
        errors, inside = toeplitz(np.r_[-a[0], ahead], np.r_[-a, 1.0, ahead]), slice(first - low, last + 1 - low)
        known = v[low:high].copy()
        known[inside] = 0.0
        v[first : last + 1] = np.linalg.lstsq(errors[:, inside], -errors @ known, rcond=None)[0]
    v += level
    for first, last in torn:
        there = slice(first, last + 1)
        if not np.all(np.abs(v[there] - straight[there]) < room):  # it has gone astray
            v[there] = straight[there]
    return np.where(out, v, u)
