"""Autocorrelation of series with gaps: only pairs that were both measured count; by FFT, so that long records cost nothing."""

from __future__ import annotations

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def products(e: Array) -> tuple[Array, Array]:
    """c_k = sum_t e_t e_(t+k) / mean(e^2) and the number of pairs in each sum, k = 0 .. n - 1; e (..., n), NaN is missing."""
    there = np.isfinite(e)
    values, n = np.where(there, e, 0.0), e.shape[-1]
    size = 1 << int(np.ceil(np.log2(max(2 * n, 2))))
    sums, pairs = (np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[..., :n] for x in (values, there.astype(np.float64)))
    power = np.sum(values**2, axis=-1, keepdims=True) / np.maximum(np.count_nonzero(there, axis=-1, keepdims=True), 1)
    return np.divide(sums, power, out=np.zeros(e.shape), where=power > 0), np.round(pairs)


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
