"""Square roots of information, R of R' R: what they leave of a covariance, and several of them together."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from ..polynomials import Array

SINGULAR = 1e-10  # of the largest singular value of R, its columns scaled: less tells nothing


def root(R: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Root (n, ..) of the covariance that the information R' R leaves, and of which of the unknowns it tells nothing."""
    size = lengths(R)
    scaled = R / size
    if np.abs(np.diag(scaled)).min() > SINGULAR and not R[_below(len(R))].any():
        return np.asarray(lapack.dtrtri(scaled)[0] / size[:, None]), np.zeros(len(R), dtype=bool)
    _, s, Vt = np.linalg.svd(scaled)
    told = s > SINGULAR * s.max(initial=1e-300)
    half = Vt[told].T / s[told] / size[:, None]
    return half, np.any(np.abs(Vt[~told]) > np.sqrt(SINGULAR), axis=0)


def joined(Rd: Array, rows: Array) -> Array:
    """What a square root and more rows tell together."""
    return np.asarray(np.linalg.qr(np.vstack([Rd, rows]), mode="r"), dtype=np.float64)[: len(Rd)]


@cache
def _below(n: int) -> NDArray[np.bool_]:
    """The entries of a square matrix below its diagonal."""
    return np.tri(n, k=-1, dtype=bool)


def lengths(R: Array) -> Array:
    """Of the columns, one for those that are zero."""
    size = np.sqrt((R**2).sum(axis=0))
    size[size == 0] = 1.0
    return np.asarray(size)
