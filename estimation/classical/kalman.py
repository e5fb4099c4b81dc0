"""Innovations of an affine plant: the Kalman filter in its covariance form, with a gain that is kept once it has settled.

e = y - C x - D u,   S = C P C' + R,   K = P C' S^-1
x <- F (x + K e) + E u,   P <- F (P - K S K') F' + Q
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.signal import lfilter

from .linear_plant import AffineStep

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SETTLED = 1e-7  # relative change of S from sample to sample, over as many samples as the state has entries


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
    quiet, before = 0, np.full((ny, ny), np.inf)
    for k in range(n):
        there = np.isfinite(y[k])
        C = plant.C[there]
        S = C @ P @ C.T + R[np.ix_(there, there)]
        gain = np.linalg.solve(S, C @ P).T
        L[np.ix_([k], there, there)] = np.linalg.cholesky(S)
        e[k, there] = y[k, there] - C @ x - direct[k, there]
        x = plant.F @ (x + gain @ e[k, there]) + forced[k]
        keep = np.eye(nx) - gain @ C
        P = plant.F @ (keep @ P @ keep.T + gain @ R[np.ix_(there, there)] @ gain.T) @ plant.F.T + Q
        if complete:
            quiet = quiet + 1 if np.max(np.abs(S - before)) < SETTLED * np.max(np.abs(S)) else 0
            before = S
            if quiet > 2 * nx:
                return _settled(plant, y, forced, direct, x, gain, e, L, k + 1)
    return Innovations(e=e, L=L)


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
