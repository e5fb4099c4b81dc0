"""Innovations of an affine plant: the Kalman filter in its covariance form, with a gain that is kept once it has settled.

    e = y - C x - D u,   S = C P C' + R,   K = P C' S^-1
    x <- F (x + K e) + E u,   P <- F (P - K S K') F' + Q

From P = 0 on, P never falls, and no gain makes it smaller than the filter's own. So m samples after P_k, from which P_(k+1) followed,

    P_k <= P_(k+m) <= P_k + sum_(j < m) A^j (P_(k+1) - P_k) A'^j,   A = F (I - K_k C),

the right side being what the gain K_k makes of it when it is kept. It is kept where this adds too little to S until the last sample to
matter: a filter that a weak force moves slowly has not arrived then, and states that no output shows, however unsure, do not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.signal import lfilter

from .linear_plant import AffineStep

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SETTLED = 1e-9  # share of S that a kept gain may add to it until the last sample
FIRST, OFTEN = 8, 0.125  # samples after which the gain is asked for the first time, and share of those before after which again


@dataclass(frozen=True, kw_only=True, eq=False)
class Innovations:
    """e (n, ny), zero where a sample is missing, and the lower Cholesky factors L (n, ny, ny) of their covariances."""

    e: Array
    L: Array


def innovations(plant: AffineStep, y: Array, u: Array, Q: Array, R: Array, start: Array) -> Innovations:
    """One pass over y (n, ny), NaN where missing, and u (nu, n); from the start (nx,) in x - x*, known exactly."""
    n, ny, nx = len(y), y.shape[1], len(plant.F)
    drive = np.column_stack([(u - plant.input[:, None]).T, np.ones(n)])
    forced, direct = drive @ plant.E.T, drive @ plant.D.T
    complete = bool(np.all(np.isfinite(y)))
    x, P = start.copy(), np.zeros((nx, nx))
    e, L = np.zeros((n, ny)), np.tile(np.eye(ny), (n, 1, 1))
    ask = FIRST
    for k in range(n):
        there = np.isfinite(y[k])
        C = plant.C[there]
        S = C @ P @ C.T + R[np.ix_(there, there)]
        gain = np.linalg.solve(S, C @ P).T
        L[np.ix_([k], there, there)] = np.linalg.cholesky(S)
        e[k, there] = y[k, there] - C @ x - direct[k, there]
        x = plant.F @ (x + gain @ e[k, there]) + forced[k]
        keep = np.eye(nx) - gain @ C
        before, P = P, plant.F @ (keep @ P @ keep.T + gain @ R[np.ix_(there, there)] @ gain.T) @ plant.F.T + Q
        if complete and k + 1 == ask:
            if _growth(plant.F @ keep, P - before, C, L[k], n - k) < SETTLED:
                return _settled(plant, y, forced, direct, x, gain, e, L, k + 1)
            ask += max(FIRST, int(OFTEN * ask))
    return Innovations(e=e, L=L)


def _growth(A: Array, change: Array, C: Array, L: Array, samples: int) -> float:
    """Largest entry of L^-1 C (sum_(j < m) A^j change A'^j) C' L'^-1, m the power of two from `samples` on; inf where it overflows."""
    count = 1
    with np.errstate(over="ignore", invalid="ignore"):
        while count < samples:
            change, A, count = change + A @ change @ A.T, A @ A, 2 * count
        added = C @ change @ C.T
    return float(np.max(np.abs(np.linalg.solve(L, np.linalg.solve(L, added).T)))) if np.all(np.isfinite(added)) else np.inf


def _settled(
    plant: AffineStep, y: Array, forced: Array, direct: Array, x: Array, gain: Array, e: Array, L: Array, first: int
) -> Innovations:
    """The rest with a constant gain: x <- (F - F K C) x + F K (y - D u) + E u, e = y - C x - D u."""
    closed = plant.F - plant.F @ gain @ plant.C
    pushed = (y - direct) @ (plant.F @ gain).T + forced
    e[first:] = y[first:] - _recursion(closed, pushed[first:], x) @ plant.C.T - direct[first:]
    L[first:] = L[first - 1]
    return Innovations(e=e, L=L)


def _recursion(A: Array, f: Array, start: Array) -> Array:
    """x(k+1) = A x(k) + f(k) from x(0) = start, (n, nx), by Schur's form A = U T U*: T is triangular, so its rows are scalar filters."""
    if not len(f):
        return np.empty((0, len(start)))
    T, U = scipy.linalg.schur(A, output="complex")
    z, g, z0 = np.empty(f.shape, dtype=complex), f @ U.conj(), start @ U.conj()
    for i in reversed(range(len(T))):
        drive = g[:, i] + z[:, i + 1 :] @ T[i, i + 1 :]
        z[0, i] = z0[i]
        z[1:, i] = lfilter([1.0], [1.0, -T[i, i]], drive[:-1], zi=[T[i, i] * z0[i]])[0]
    return np.asarray((z @ U.T).real, dtype=np.float64)
