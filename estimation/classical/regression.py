"""Linear least squares whose standard deviations hold for coloured residuals.

    e_k = d_k - X_k theta                                    k = 1 .. n, r rows each
    theta = (sum_k X_k' X_k + P)^-1 (sum_k X_k' d_k + P m)   P, m: what is known beforehand
    cov   = B^-1 (S + P) B^-1,   B = sum_k X_k' X_k + P      the sandwich
    S     = sum_|l|<=L (1 - |l|/(L + 1)) sum_k g_k g_(k+l)', g_k = X_k' e_k

S is n times the long-run covariance of the scores g (W. K. Newey, K. D. West, Econometrica 55, 1987) with the lag of D. W. K. Andrews,
Econometrica 59, 1991, eq. 5.3, 6.2 and 6.4: L = 1.1447 (alpha n)^(1/3) with alpha from a first-order model of every score. Filtered signals
are smoother than any first-order model; neighbouring scores are added up before, by twos, until they are no longer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SILENT = 1e-12  # of the largest eigenvalue of the scaled normal matrix: a combination below it is not determined
SMOOTH = 0.5  # first autocorrelation from which scores are added up
FEWEST = 60  # sums that are left


@dataclass(frozen=True, kw_only=True)
class Regression:
    """theta (p,), its covariance (p, p), and which entries the rows determine (p,)."""

    theta: Array
    covariance: Array
    determined: np.ndarray[tuple[int], np.dtype[np.bool_]]

    @property
    def std(self) -> Array:
        """Standard deviations (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def solve(X: Sequence[Array], d: Sequence[Array], mean: Array, information: Array) -> Regression:
    """Least squares over independent pieces, each X (n, r, p) and d (n, r), every row in units of its deviation.

    mean, information (p,): prior mean and 1/std^2, zero where nothing is known.
    """
    rows, targets = np.concatenate([x.reshape(-1, x.shape[2]) for x in X]), np.concatenate([b.ravel() for b in d])
    unit = np.sqrt(np.sum(rows**2, axis=0) + information)
    unit[unit == 0] = 1.0
    values, vectors = np.linalg.eigh((rows.T @ rows + np.diag(information)) / np.outer(unit, unit))
    kept = values > SILENT * max(float(values.max(initial=0.0)), 1e-300)
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    theta = inverse @ ((rows.T @ targets + information * mean) / unit) / unit
    spread = np.diag(information / unit**2)
    for x, b in zip(X, d, strict=True):
        spread = spread + long_run(np.einsum("krp,kr->kp", x, b - x @ theta) / unit)
    silent = np.sqrt(np.sum(vectors[:, ~kept] ** 2, axis=1))
    return Regression(theta=theta, covariance=inverse @ spread @ inverse / np.outer(unit, unit), determined=silent < 1e-3)


def long_run(scores: Array) -> Array:
    """Covariance (p, p) of the sum of the scores (n, p), which may be correlated over time."""
    g = scores
    while len(g) >= 2 * FEWEST and np.max(_correlation(g), initial=0.0) > SMOOTH:
        g = np.add.reduceat(g, np.arange(0, len(g), 2), axis=0)
    total, lags = g.T @ g, _lag(g)
    for lag in range(1, lags + 1):
        cross = g[:-lag].T @ g[lag:]
        total = total + (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return np.asarray(total, dtype=np.float64)


def _correlation(scores: Array) -> Array:
    """First autocorrelation of every score that is not zero throughout."""
    power = np.sum(scores[:-1] ** 2, axis=0)
    moving = power > 0
    return np.asarray(np.clip(np.sum(scores[:-1] * scores[1:], axis=0)[moving] / power[moving], -0.97, 0.97), dtype=np.float64)


def _lag(scores: Array) -> int:
    """Andrews' lag for Bartlett's window: alpha = sum 4 r^2 s^4 / ((1 - r)^6 (1 + r)^2) / sum s^4 / (1 - r)^4."""
    n, r = len(scores), _correlation(scores)
    if n < 10 or not len(r):
        return 0
    fourth = (np.mean(scores[1:, np.sum(scores[:-1] ** 2, axis=0) > 0] ** 2, axis=0) * (1 - r**2)) ** 2
    alpha = np.sum(4 * r**2 * fourth / ((1 - r) ** 6 * (1 + r) ** 2)) / np.sum(fourth / (1 - r) ** 4)
    return int(min(1.1447 * (alpha * n) ** (1 / 3), n // 4))
