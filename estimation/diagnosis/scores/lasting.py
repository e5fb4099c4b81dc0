"""How much of a residual force lasts. What a model lacks goes with the motion, or comes and goes; noise is forgotten, and W tells of it.

A smoother sees a white force through its own resolution, so that of one the estimate has a memory, too: its autocorrelation is drawn from
the linearised problem. With r_k that of the residual force, in units of its own deviation, s_k that of the draws, and n intervals each,

    lasting^2 = sum of n max_(l >= K) |r_l| / sum of n        K: the least, from LEAST on, at which the mean |s_k| is below FORGOTTEN

of intervals where that is more than the same maximum of every draw: over hundreds of lags that of white noise is not nothing.
"""

from __future__ import annotations

import numpy as np

from ...validation.autocorrelation import autocorrelation
from .score import Array, Linearised

DRAWS = 16
FORGOTTEN = 0.1
LEAST = 5  # intervals of the mesh
LAGS = 4  # of a recording: lags up to its length over this


def lasting(base: Linearised, place: str, seed: int = 0) -> float:
    """The share, from 0 to 1, of the residual force of a place that is there when white noise would be forgotten."""
    t = base.solution.transcription
    rows, n = base.force_rows, len(t.soft)
    at = rows[[t.dae.places[k].name for k in t.soft].index(place) :: n]
    now, drawn = base.left[at].mean(axis=0), base.drawn(seed, DRAWS).left[at].mean(axis=0)
    ends = np.cumsum([h.mesh.count for h in t.horizons])[:-1]
    whole = kept = 0.0
    for own, chance in zip(np.split(now, ends), np.split(drawn, ends), strict=True):
        lags = len(own) // LAGS
        noise = np.abs([_autocorrelation(column, lags) for column in chance.T])
        forgotten = np.flatnonzero(noise.mean(axis=0)[LEAST:] < FORGOTTEN)
        whole += len(own)
        if len(forgotten):
            first = LEAST + int(forgotten[0])
            most = float(np.abs(_autocorrelation(own, lags))[first:].max())
            kept += len(own) * most if most > noise[:, first:].max() else 0.0
    return float(np.sqrt(kept / whole)) if whole > 0 else 0.0


def _autocorrelation(values: Array, lags: int) -> Array:
    return np.nan_to_num(autocorrelation(values, lags))
