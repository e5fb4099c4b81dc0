"""Figures of merit of a fit: rms, percent, and what its errors say: white, normal, how many independent ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..results import OutputFit, Trimmed
from .whiteness import effective_samples, normality, whiteness

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def output_fit(
    measured: Array,
    modelled: Array,
    errors: Array | None = None,
    chosen: int = 0,
    far: NDArray[np.bool_] | None = None,
    still: NDArray[np.bool_] | None = None,
) -> OutputFit:
    """Fit of one output, over the samples that are there; shapes (n,).

    errors: standardised prediction errors of a smoothed output (`innovations.py`), NaN where there is none, for which `chosen` ratios of
    weights were left to the data; without them measured minus modelled is tested, which is right where no sample was used. far: samples
    that a robust loss found far off; still: errors that are not tested, for which the others speak.
    """
    difference = measured - modelled
    there = np.isfinite(difference)
    tested = difference if errors is None else errors if still is None else np.where(still, np.nan, errors)
    p = whiteness(tested, chosen)
    rms, percent = _met(measured[there], difference[there])
    trimmed = None
    if far is not None and (far & there).any():
        left = there & ~far
        size, share = _met(measured[left], difference[left])
        trimmed = Trimmed(rms=size, fit_percent=share, outliers=int((far & there).sum()))
    return OutputFit(
        rms=rms,
        fit_percent=percent,
        whiteness_p=p,
        normality_p=normality(tested),
        effective_samples=None if p is None else effective_samples(tested) / _share(tested, errors),
        samples=int(there.sum()),
        prediction_rms=None if errors is None or not np.isfinite(errors).any() else float(np.sqrt(np.nanmean(errors**2))),
        trimmed=trimmed,
    )


def _share(tested: Array, errors: Array | None) -> float:
    """Of the errors, those that are tested."""
    return 1.0 if errors is None else float(np.isfinite(tested).sum() / np.isfinite(errors).sum())


def _met(y: Array, e: Array) -> tuple[float, float | None]:
    """rms and fit in percent of samples y (n,) that are met but for e (n,)."""
    if not y.size:
        return float("nan"), None
    spread = float(np.linalg.norm(y - y.mean()))
    return float(np.sqrt(np.mean(e**2))), 100.0 * (1.0 - float(np.linalg.norm(e)) / spread) if spread > 0 else None
