"""Standardised prediction errors of a smoothed record: what must be white, and of variance one, when the model is right.

Smoothed residuals r = (I - A (A'A)^-1 A') e are correlated even when the errors e are N(0, I): the fit bends towards every one of
them. The same rows read in the order of time give the errors of one-step predictions, which are independent and N(0, 1) (Schweppe, IEEE
Trans. Inf. Theory 11, 1965). Given beta = [first states; parameters] that is a Kalman filter on `chain.py`, run for all columns
[1 | beta] at once (de Jong, Ann. Statist. 19, 1991). Its innovations, over their roots, form a small regression

    u = E beta + e,        e ~ N(0, I),

whose recursive residuals (Brown, Durbin & Evans, J. R. Statist. Soc. B 37, 1975) are the prediction errors: beta is known at every
moment from what was read before. Exact for linear models and given weights; to first order for others.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack, null_space

from backsight.ocp import Solution

from ..smoothing.robust import RobustSolution
from .chain import Chain, chain

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

DIFFUSE = 1e6  # standard deviation of beta beforehand, in units of what its own column tells: nothing is known
LARGEST = 100.0  # variance of a prediction, noise = 1, from which on its error tells beta and not the noise
CHUNK = 32  # innovations whose recursive residuals are taken at once: few enough for no library to start threads


@dataclass(frozen=True, kw_only=True)
class Step:
    """One interval of the filter: m samples, numbers `samples` in the order of all, with L L' the variance of their innovations.

    D (m, nx): samples in x_i. A (nx, nx), K (nx, m): x_(i+1) = A x_i + K u. noise_x (nx, q), noise_y (m, q): what the q noises of the
    interval do to x_(i+1) and to the samples.
    """

    samples: slice
    L: Array
    D: Array
    A: Array
    K: Array
    noise_x: Array
    noise_y: Array


@dataclass(frozen=True, kw_only=True)
class Innovations:
    """One horizon. errors (n, ny): measured less predicted, over its deviation; NaN where there is no sample or where it tells beta.

    log_densities (n, ny): of the samples [1/unit], each given all before and beta as it was estimated; 0 where there is none. u (m,),
    E (m, k + np): the regression above, in the order of the filter. steps: of all intervals. log_roots: sum of log L_jj.
    """

    errors: Array
    log_densities: Array
    u: Array
    E: Array
    steps: tuple[Step, ...]
    log_roots: float


@dataclass(frozen=True, kw_only=True)
class Filtered:
    """All horizons, and what the marginal likelihood needs beside them.

    first_root: sum of log |R_jj|, R'R the information on the first states given the parameters. first_states: what integrals over those of
    which less is known gain by as much as the sample that tells most of each (`_unit_information`). parameter_root (np, np): R of the
    parameters. squares: sum of the squared prediction errors, with those that tell beta.
    determined: whether the data determine all of them.
    """

    horizons: tuple[Innovations, ...]
    first_root: float
    first_states: float
    parameter_root: Array
    squares: float
    determined: bool


def innovations(solution: Solution, factors: Array | None = None) -> Filtered | None:
    """The prediction errors of a solution; None where it is no minimum or its rows form no chain.

    factors (n_soft,): on the deviations of its residual forces; trajectories and parameters then are those that go with these.
    """
    if solution.curvature is None:
        return None
    links = chain(solution, factors)
    if links is None:
        return None
    t = solution.transcription
    runs, places, first = [], [], 0
    for number, horizon in enumerate(t.horizons):
        part, first = slice(first, first + len(horizon.time)), first + len(horizon.time)
        owner = horizon.mesh.locate(horizon.time)[0]
        run, where = _filter(links, number, range(t.offsets[number], t.offsets[number + 1]), part, owner)
        runs.append(run)
        places.append(where)
    np_ = links.H.shape[2]
    size = np.sqrt(sum(np.sum(E[:, E.shape[1] - np_ :] ** 2, axis=0) for _, E, _, _ in runs))
    R, d = _absorbed(_weak(size), np.zeros(np_), links.known_parameters)
    horizons, first_root, first_states, squares, first = [], 0.0, 0.0, 0.0, 0
    scale = scale_of_samples(solution).T
    for (u, E, steps, log_roots), where, known, horizon in zip(runs, places, links.known, t.horizons, strict=True):
        k = E.shape[1] - np_
        size = np.sqrt(np.sum(E[:, :k] ** 2, axis=0) + np.sum(known[:, 1:] ** 2, axis=0))
        root: Array = np.zeros((k + np_, k + np_))
        root[:k, :k], root[k:, k:] = _weak(size), R
        right = np.concatenate([np.zeros(k), d])
        root, right = _absorbed(root, right, np.hstack([known, np.zeros((len(known), np_))]))
        w, variance, root, right = _recursive(u, E, root, right)
        squares += float(w @ w)
        errors = np.full((len(horizon.time), len(t.dae.outputs)), np.nan)
        errors[where[:, 0], where[:, 1]] = np.where(variance < LARGEST, w, np.nan)
        densities = np.zeros(errors.shape)
        of_rows = -0.5 * (u**2 + np.log(2.0 * np.pi)) - log_roots
        densities[where[:, 0], where[:, 1]] = of_rows + np.log(scale[first + where[:, 0], where[:, 1]])
        first += len(horizon.time)
        horizons.append(Innovations(errors=errors, log_densities=densities, u=u, E=E, steps=steps, log_roots=float(np.sum(log_roots))))
        first_root += float(np.sum(np.log(np.abs(np.diag(root)[:k]))))
        first_states += _unit_information(root[:k, :k], E[:, :k], known)
        R, d = root[k:, k:], right[k:]
    return Filtered(
        horizons=tuple(horizons),
        first_root=first_root,
        first_states=first_states,
        parameter_root=R,
        squares=squares,
        determined=solution.determined,
    )


def _unit_information(R: Array, E: Array, known: Array) -> float:
    """By how much an integral over first states is larger where of each as much is known beforehand as one sample tells, at least.

    R (k, k): root of the information on them; E (m, k): of the innovations; known (rows, 1 + k): what was known, [r | derivative]. Of those
    directions N (k, n) of which less was known, P (n,), than the most that one innovation tells, M,

        log |R| - 1/2 log det(R'R + N (M - P) N') + 1/2 log det(M / 2 pi) - 1/2 log det(P / 2 pi) + 1/2 r' (I - P/M) r

    (P not where it is zero): what is known more is so about the estimate.
    What is flat hangs on units, and where a state is hardly told it is as large as anybody likes: a delay of no length would be worth a
    hundred nats.
    """
    N, P, squares = _hardly_known(known)
    most = np.max((E @ N) ** 2, axis=0, initial=0.0)
    most = np.where(most > 0, most, np.sum((R @ N) ** 2, axis=0))
    less = most > P
    N, P, most, squares = N[:, less], P[less], most[less], squares[less]
    _, log_det = np.linalg.slogdet(R.T @ R + (N * (most - P)) @ N.T)
    own = float(np.sum(np.log(most / (2.0 * np.pi))) - np.sum(np.log(P[P > 0] / (2.0 * np.pi))) + np.sum(squares * (1.0 - P / most)))
    return float(np.sum(np.log(np.abs(np.diag(R)))) - 0.5 * log_det + 0.5 * own)


def _hardly_known(known: Array) -> tuple[Array, Array, Array]:
    """Directions of the first states (k, n), the information on them (n,) and the squares that it costs (n,).

    known: rows, (rows, 1 + k), of what is known of them.

    An axis that no row has together with others is one; of the rest those of which nothing is known.
    """
    rows = known[np.any(known[:, 1:] != 0, axis=1)]
    r, derivative = rows[:, 0], rows[:, 1:]
    axes = np.eye(derivative.shape[1])
    together = np.any(derivative[np.count_nonzero(derivative, axis=1) > 1] != 0, axis=0)
    information, squares = np.sum(derivative**2, axis=0), np.sum((r[:, None] * (derivative != 0)) ** 2, axis=0)
    if not np.any(together):
        return axes, information, squares
    joint = derivative[:, together]
    joint = joint[np.any(joint != 0, axis=1)]
    free = axes[:, together] @ null_space(joint / np.linalg.norm(joint, axis=1, keepdims=True))
    nothing = np.zeros(free.shape[1])
    return (
        np.hstack([axes[:, ~together], free]),
        np.concatenate([information[~together], nothing]),
        np.concatenate([squares[~together], nothing]),
    )


def scale_of_samples(solution: Solution) -> Array:
    """One over the standard deviations of all samples, (ny, all samples)."""
    scale = solution.values.scale[solution.term("samples")]
    return scale / np.sqrt(solution.weights * solution.gain) if isinstance(solution, RobustSolution) else scale


def log_likelihood(filtered: Filtered) -> float:
    """Of the prediction errors, first states and parameters integrated out; but for what is the same with other residual forces."""
    parameters = float(np.sum(np.log(np.abs(np.diag(filtered.parameter_root)))))
    return -0.5 * filtered.squares - sum(run.log_roots for run in filtered.horizons) - filtered.first_root - parameters


def _weak(size: Array) -> Array:
    """Root of next to no information on unknowns with columns of these sizes."""
    return np.asarray(np.diag(np.where(size > 0, size, 1.0) / DIFFUSE), dtype=np.float64)


def _filter(
    links: Chain, number: int, intervals: range, part: slice, owner: Index
) -> tuple[tuple[Array, Array, tuple[Step, ...], Array], Index]:
    """(u, E, steps, log L_jj) of one horizon, and sample and output of every innovation."""
    nx, Z, np_ = links.F.shape[2], links.first[number], links.H.shape[2]
    where = np.argwhere(np.isfinite(links.rows[part]))
    sample, output = where.T
    step = owner[sample]
    # an interval as a step of a state space model: x+ = A x + a + noise_x e, samples y = D x + d + noise_y e + noises of their own
    inside = slice(intervals.start, intervals.stop)
    F, G, known = links.F[inside], links.G[inside], np.concatenate([links.g[inside, :, None], links.H[inside]], axis=2)
    S = links.S[part][sample, output]
    inner = S[:, None, nx:]
    D, noise_y = S[:, :nx] + (inner @ F[step])[:, 0], (inner @ G[step])[:, 0]
    columns = [0, *range(1 + Z.shape[1], 1 + Z.shape[1] + np_)]
    d, a = np.zeros((len(S), 1 + Z.shape[1] + np_)), np.zeros((len(F), nx, 1 + Z.shape[1] + np_))
    d[:, columns] = np.column_stack([links.rows[part][sample, output], links.T[part][sample, output]]) + (inner @ known[step])[:, 0]
    a[:, :, columns] = known[:, -nx:]
    A, noise_x = F[:, -nx:], G[:, -nx:]
    moved = noise_x @ np.swapaxes(noise_x, 1, 2)

    X, P = np.hstack([np.zeros((nx, 1)), Z, np.zeros((nx, np_))]), np.zeros((nx, nx))
    edge = np.searchsorted(step, np.arange(len(F) + 1)).tolist()
    steps, roots = [], np.ones(len(d))
    for k, (begin, end) in enumerate(itertools.pairwise(edge)):
        at = slice(begin, end)
        A_k, D_k, e_x, e_y = A[k], D[at], noise_x[k], noise_y[at]
        AP, y, X = A_k @ P, d[at] + D_k @ X, a[k] + A_k @ X
        DP = D_k @ P
        P = AP @ A_k.T + moved[k]
        L = _root(DP @ D_k.T + e_y @ e_y.T + np.eye(end - begin))
        K = _solved(L, D_k @ AP.T + e_y @ e_x.T).T
        d[at] = y = _solved(L, y)
        X -= K @ y
        P -= K @ K.T
        P = (P + P.T) / 2
        roots[at] = np.diag(L)
        steps.append(Step(samples=at, L=L, D=D_k, A=A_k, K=K, noise_x=e_x, noise_y=e_y))
    return (-d[:, 0], d[:, 1:], tuple(steps), np.log(roots)), where


def _root(matrix: Array) -> Array:
    """The lower Cholesky root; LAPACK itself, since the matrices are small and many."""
    if not matrix.size:
        return matrix
    L, info = lapack.dpotrf(matrix, lower=1, clean=1)
    if info:
        raise np.linalg.LinAlgError("a prediction's variance is not positive definite")
    return np.asarray(L)


def _solved(L: Array, right: Array) -> Array:
    """L^-1 right. Not by LAPACK's dtrtrs, which starts threads for the smallest system."""
    return np.asarray(blas.dtrsm(1.0, L, right, lower=1)) if L.size else right


def _absorbed(R: Array, d: Array, rows: Array) -> tuple[Array, Array]:
    """Root and right side with the rows r + J b = e added: |R b - d|^2 + |J b + r|^2."""
    return _triangular(np.hstack([R, d[:, None]]), np.hstack([rows[:, 1:], -rows[:, :1]]))


def _triangular(above: Array, below: Array) -> tuple[Array, Array]:
    n = above.shape[1] - 1
    T = np.asarray(np.linalg.qr(np.concatenate([above, below]), mode="r"), dtype=np.float64)
    return T[:n, :n], T[:n, n]


def _recursive(u: Array, E: Array, R: Array, d: Array) -> tuple[Array, Array, Array, Array]:
    """Recursive residuals of u = E b + e, their variances before they were scaled to one, and the last root and right side.

    A chunk's errors u - E b, b from all before, have covariance I + E (R'R)^-1 E' = C C'; C^-1 takes them one by one.
    """
    w, variance = np.empty(len(u)), np.empty(len(u))
    for k in range(0, len(u), CHUNK):
        part = slice(k, k + CHUNK)
        spread = blas.dtrsm(1.0, R, E[part].T, trans_a=1).T if R.size else np.zeros((len(u[part]), 0))
        C = np.linalg.cholesky(np.eye(len(spread)) + spread @ spread.T)
        # E R^-1 d: the prediction by what was read so far
        w[part] = blas.dtrsv(C, u[part] - spread @ d, lower=1)
        variance[part] = np.diag(C) ** 2
        R, d = _triangular(np.hstack([R, d[:, None]]), np.hstack([E[part], u[part][:, None]]))
    return w, variance, R, d
