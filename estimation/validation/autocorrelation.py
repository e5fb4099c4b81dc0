"""Autocorrelation of series with gaps: only pairs that were both measured count; by FFT, so that long records cost nothing."""

from __future__ import annotations

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def products(e: Array) -> tuple[Array, Array]:
    """c_k = sum_t e_t e_(t+k) / mean(e^2) and the number of pairs in each sum, k = 0 .. n - 1; e (n,), NaN is missing."""
    there = np.isfinite(e)
    values = np.where(there, e, 0.0)
    size = 1 << int(np.ceil(np.log2(max(2 * e.size, 2))))
    sums, pairs = (np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: e.size] for x in (values, there.astype(np.float64)))
    power = float(values @ values) / max(int(there.sum()), 1)
    return (sums / power if power > 0 else np.zeros(e.size)), np.round(pairs)


def autocorrelation(values: Array, lags: int) -> Array:
    """r_0 .. r_lags, r_k = mean(e_t e_(t+k)) / mean(e^2), e without its mean; NaN where there is no pair, or nothing that differs."""
    r = np.full(lags + 1, np.nan)
    if np.isfinite(values).sum() < 2:
        return r
    c, pairs = products(np.asarray(values - np.nanmean(values)))
    if c[0] > 0:
        c, pairs = c[: lags + 1], pairs[: lags + 1]
        r[: c.size] = np.where(pairs > 0, c / np.maximum(pairs, 1.0), np.nan)
    return r
