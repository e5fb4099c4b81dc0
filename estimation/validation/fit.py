"""Figures of merit of a fit: rms, percent, and what its errors say: white, normal, how many independent ones."""

from __future__ import annotations

import numpy as np

from ..results import OutputFit
from .whiteness import effective_samples, normality, whiteness

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def output_fit(measured: Array, modelled: Array, errors: Array | None = None, chosen: int = 0) -> OutputFit:
    """Fit of one output, over the samples that are there; shapes (n,).

    errors: standardised prediction errors of a smoothed output (`innovations.py`), NaN where there is none, for which `chosen` ratios of
    weights were left to the data; without them measured minus modelled is tested, which is right where no sample was used.
    """
    difference = measured - modelled
    there = np.isfinite(difference)
    y, e = measured[there], difference[there]
    spread = float(np.linalg.norm(y - y.mean())) if y.size else 0.0
    tested = difference if errors is None else errors
    p = whiteness(tested, chosen)
    return OutputFit(
        rms=float(np.sqrt(np.mean(e**2))) if y.size else float("nan"),
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(e)) / spread) if spread > 0 else None,
        whiteness_p=p,
        normality_p=normality(tested),
        effective_samples=None if p is None else effective_samples(tested),
        samples=int(y.size),
        prediction_rms=None if errors is None or not np.isfinite(errors).any() else float(np.sqrt(np.nanmean(errors**2))),
    )
