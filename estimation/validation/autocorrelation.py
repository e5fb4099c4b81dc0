"""Autocorrelation of series with gaps: only pairs that were both measured count; by FFT, so that long records cost nothing."""

from __future__ import annotations

import numpy as np

from ..results import Memory

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

WINDOW = 3.0  # correlation times: shorter, and chance counts less; longer, and other noise does
SURE = 4.0  # deviations of what is no chance


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


def memory(time: Array, values: Array) -> Memory | None:
    """The Ornstein-Uhlenbeck process in values (n,) at times (n,) [s], which may have noise of a shorter memory besides; None without one.

    Of its autocorrelation a exp(-t/tau) the mean lag within WINDOW tau is g tau and the sum a (1 - exp(-WINDOW)) tau, whatever else
    there is at short lags without a spectrum at zero: what a smoother leaves of noise has none. The window is the least that is WINDOW
    times the tau it gives (Sokal, Functional Integration, 1997, section 3), of a sampling step at least, and beyond chance. Uneven times
    count as if apart by their median distance.
    """
    r = np.nan_to_num(autocorrelation(values, len(values) - 1))
    lag, rest = np.arange(len(r)), np.exp(-WINDOW)
    total, moment = np.cumsum(r) - r[0] / 2, np.cumsum(lag * r)
    chance = np.sqrt(np.cumsum(lag**2) / max(np.isfinite(values).sum(), 1))  # standard deviation of the moment of white noise
    scale = (1 - rest) / (1 - (1 + WINDOW) * rest)
    tau = scale * np.divide(moment, total, out=np.zeros(len(r)), where=total > 0)
    enough = np.flatnonzero((lag >= WINDOW * tau) & (tau >= 1) & (moment > SURE * chance))
    if not enough.size:
        return None
    k = int(enough[0])
    share = min(total[k] / tau[k] / (1 - rest), 1.0)
    return Memory(tau=float(tau[k] * np.median(np.diff(time))), rms=float(np.sqrt(share) * np.nanstd(values)))
