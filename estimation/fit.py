"""Figures of merit of a fit: rms, percent, and whether what is left over is white."""

from __future__ import annotations

import numpy as np
from scipy import stats

from .results import OutputFit

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def output_fit(measured: Array, modelled: Array) -> OutputFit:
    """Fit of one output, over the samples that are there; shapes (n,)."""
    there = np.isfinite(measured)
    y, e = measured[there], measured[there] - modelled[there]
    spread = float(np.linalg.norm(y - y.mean())) if y.size else 0.0
    return OutputFit(
        rms=float(np.sqrt(np.mean(e**2))) if y.size else float("nan"),
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(e)) / spread) if spread > 0 else None,
        whiteness_p=ljung_box(e),
    )


def ljung_box(e: Array, lags: int = 20) -> float | None:
    """p-value of the hypothesis that e (n,) is white; None for fewer than 50 values.

    Q = n (n + 2) sum_k r_k^2 / (n - k), chi-square with `lags` degrees of freedom (Ljung & Box, Biometrika 65, 1978).
    Smoothed residuals are slightly coloured even when everything is right, so a small p is a hint, not a verdict.
    """
    n = len(e)
    centred = e - e.mean() if n else e
    power = float(centred @ centred)
    if n < 50 or power <= 0:
        return None
    k = np.arange(1, lags + 1)
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    r = np.fft.irfft(spectrum)[k] / power
    return float(stats.chi2.sf(n * (n + 2) * np.sum(r**2 / (n - k)), lags))
