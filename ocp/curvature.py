"""Curvature of a program at its solution: covariances, linear in the length of the record.

The inverse of the KKT matrix of the Gauss-Newton program,

    | H  J' |^-1   | C  . |
    | J -d  |    = | .  . |,         C = covariance of all unknowns given the data, on the constraints,

with d = 0 for a constraint. A square of the cost that may be as heavy as one has its row in J too, in units in which J is of order one,
and d = 1 over its weight there: squared and summed, it would leave nothing of the light ones.

The matrix is block-tridiagonal in time, with a border b of the first knots, the multipliers of what must hold there, and the parameters
(`bordered.py`): with c what is in the blocks, X = H_cc^-1 H_cb and S = H_bb - H_bc X,

    C_bb = S^-1,    C_cc = H_cc^-1 + X C_bb X',    C_cb = -X C_bb

What the data leave open makes S singular. With S = D (Q diag(e) Q' + N diag(~0) N') D, in units D of the rounding of S, the columns of
D^-1 N are the null directions, and C_bb = D^-1 Q diag(1/e) Q' D^-1 is the covariance of all else: every generalised inverse gives the
same variance to a quantity that no null direction moves (Rao & Mitra, Generalized Inverse of Matrices and its Applications, section 2.2).

Which directions are null. Column i of X says how everything moves with unknown i of the border, and S_ii is the sum of squares that this
costs. With M the whole matrix in the blocks, X_i as computed solves a system whose entries are off by a rounding of their own, so that its
unknowns may as well be at |X_i| + eps rho_i, where rho_i is how the blocks answer rounding in the sums that their constraints cancel:

    D_i^2 = sum over k of |M_kk| (|X_ki| + rho_ki)^2,        rho_i = |M^-1 (0; +-|J -d| |X_i|)|

By Cauchy and Schwarz no S_ij is then off by much more than eps D_i D_j, and |e| < ROUNDING says no more than that a combination costs less
than rounding of what each of its parts costs alone. Every product is of a weight with the moves of its own unknown, so neither the units of
the unknowns nor the weights of the constraints change e; a weight that is not there at all counts as the rounding of one.

A sum of squares is known better than a difference of sums: what is grey, |e| < GREY, is told by its squares. Along z_v, how everything
moves with a combination v of the border, it costs

    F_vw = z_v' H z_w + (J z_v)' d^-1 (J z_w) + l_v' J z_w + z_v' J' l_w

with l its multipliers in the border. What nearly exact balances and other samples take back is taken back before it is squared: an error in
z_v counts by its square. F_vv may be off by ROUNDING of |z_v|' |H| |z_v|, and by the squares of ROUNDING of what adds up in J z_v, of what
its parts move, and, in v, of that over the least e that is not grey. What costs less is null.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .blocktridiagonal import BlockTridiagonal, times
from .bordered import Bordered, Places, bordered
from .nlp import Nlp
from .polynomials import Array

Index = NDArray[np.int64]

# Known null directions come out below 1e-15 in every unit, the least of what is determined near 4e-15 (a quadrotor that hovers, with
# nearly exact balances) and commonly above 1e-6.
EPS = float(np.finfo(np.float64).eps)
ROUNDING = 2.0**6 * EPS
GREY = EPS**0.5


@dataclass(frozen=True, kw_only=True)
class Curvature:
    """Covariances in the units of the model.

    parameter_covariance (np, np). interval_covariance (N, local + np, local + np): of every interval's local unknowns and the
    parameters, both given the null directions. log_determinant of the KKT matrix in the program's units, without them
    and with the heavy terms in H.
    null (r, H nx + np): the null directions, as the first states of every horizon and the parameters move along each.
    interval_null (N, local + np, r): the same at every interval's local unknowns, as long as rounding could hide.
    definite: whether the solution is a minimum, strict but for the null directions.
    """

    parameter_covariance: Array
    interval_covariance: Array
    log_determinant: float
    null: Array
    interval_null: Array
    definite: bool

    @property
    def parameter_variance(self) -> Array:
        """(np,); inf where a null direction moves the parameter."""
        first = self.interval_null.shape[1] - len(self.parameter_covariance)
        return determined_variance(np.diag(self.parameter_covariance), self.interval_null[0, first:])


def determined_variance(variance: Array, null: Array) -> Array:
    """Variances (...), inf where a quantity moves along a null direction; null (..., r): how far, for the lengths of `interval_null`.

    A null direction is known no better than rounding, so its information is at most that of rounding, 1/|null|^2. Where that much would
    leave more variance than all that is determined, the quantity is not.
    """
    return np.where(np.sum(null**2, axis=-1) > variance, np.inf, variance)


def curvature(nlp: Nlp, hessian: sp.csc_matrix, jacobian: sp.csc_matrix, softness: Array, unit: Array, known: Index) -> Curvature:
    """Covariances from H (its upper triangle), J and d = softness (rows of J,) in units `unit`; `known` decisions are fixed.

    Raises numpy.linalg.LinAlgError when the first states and the parameters together do not determine the rest.
    """
    matrix, n = bordered(nlp, hessian, jacobian, softness, known), nlp.trajectory_size
    at, size, tree, idle, kept = matrix.at, matrix.size, matrix.tree, matrix.idle, matrix.kept
    X, S = matrix.eliminated
    unit = unit * size[: nlp.size]
    own = nlp.interpolation.interior + nlp.interpolation.states
    weight = np.where(idle, 0.0, np.abs(np.einsum("kii->ki", matrix.diagonal)))
    weight[:, :own] = np.maximum(weight[:, :own], EPS)
    reach = np.abs(X) + _slack(matrix, X, own)
    # The blocks are determined by the border whatever the data; their own inertia is that of a sum of squares, and counting the
    # signs of their pivots would only count rounding. What the data must determine is the border: its inertia is that of a minimum when
    # every multiplier there brings one negative eigenvalue, but those of redundant constraints, which are null directions themselves.
    edge = nlp.interpolation.states * len(at.starts)
    multipliers = (kept >= edge) & (kept < at.border - len(nlp.free))
    D = _units(S, np.abs(np.diag(matrix.corner)) + np.einsum("kb,kbi->i", weight, reach**2), multipliers)
    e, Q = np.linalg.eigh(S / np.outer(D, D))
    hidden = np.zeros(len(e))
    if np.any(np.abs(e) < GREY):
        e, Q, hidden = _told_by_squares(nlp, matrix, (hessian, jacobian, softness), D, e, Q)
    lost = np.abs(e) < hidden
    Z, Q, e = Q[:, lost], Q[:, ~lost], e[~lost]
    held = np.count_nonzero(multipliers) - round(float(np.sum(Z[multipliers] ** 2)))
    definite = int(np.sum(e < 0)) == held and (jacobian.shape[0] > 0 or tree.negative_eigenvalues == 0)
    C = np.zeros((at.border, at.border))
    C[np.ix_(kept, kept)] = (Q / e) @ Q.T / np.outer(D, D)
    Z[multipliers] = 0.0
    left, length, _ = np.linalg.svd(Z, full_matrices=False)
    N = np.zeros((at.border, np.count_nonzero(length > 0.5)))
    N[kept] = left[:, length > 0.5] / D[:, None]
    theta = unit[n:]
    scale = np.concatenate([nlp.local(unit[:n]), np.repeat(theta[:, None], at.count, axis=1)]).T
    rows = _rows(nlp, at, X, idle, kept)
    first = np.concatenate([nlp.local(unit[:n])[: nlp.interpolation.states, at.starts].T.ravel(), theta])
    return Curvature(
        parameter_covariance=C[at.border - len(theta) :, at.border - len(theta) :] * np.outer(theta, theta),
        interval_covariance=_local_covariances(nlp, at, tree, rows, C, idle) * scale[:, :, None] * scale[:, None, :],
        log_determinant=tree.log_abs_determinant
        + float(np.sum(np.log(np.abs(e))) + 2.0 * np.sum(np.log(D)) - 2.0 * np.sum(np.log(size)) - np.sum(np.log(softness[softness != 0]))),
        null=np.concatenate([N[:edge], N[at.border - len(theta) :]]).T * first,
        interval_null=-(rows @ N) * scale[:, :, None] / np.sqrt(np.min(hidden[lost], initial=ROUNDING)),
        definite=definite,
    )


def _told_by_squares(
    nlp: Nlp, matrix: Bordered, kkt: tuple[sp.csc_matrix, sp.csc_matrix, Array], D: Array, e: Array, Q: Array
) -> tuple[Array, Array, Array]:
    """e (nb,) and Q (nb, nb) with what is grey told by its squares, and what each e may be off by (nb,), nothing where it is not grey."""
    hessian, jacobian, softness = kkt
    H, heavy = hessian + sp.triu(hessian, 1).T, softness != 0
    grey = np.abs(e) < GREY
    V = Q[:, grey] / D[:, None]
    z, rows = _moves(nlp, matrix, V), sp.csr_matrix(jacobian)
    squared = sp.diags(softness[heavy] ** -0.5) @ rows[heavy]
    first = np.flatnonzero((matrix.at.block[nlp.size :] < 0) & ~heavy)
    crossed = (matrix.size[nlp.size + first, None] * V[matrix.place[nlp.size + first]]).T @ (rows[first] @ z)
    F = z.T @ (H @ z) + (squared @ z).T @ (squared @ z) + crossed + crossed.T
    f, U = np.linalg.eigh((F + F.T) / 2)
    turned, size = Q[:, grey] @ U, np.abs(z @ U)
    parts = np.sum((abs(squared) @ size) ** 2, axis=0) + np.sum(np.abs(turned), axis=0) ** 2 + 1.0 / GREY
    off = ROUNDING * np.sum(size * (abs(H) @ size), axis=0) + ROUNDING**2 * parts
    hidden = np.concatenate([np.zeros(np.count_nonzero(~grey)), off])
    return np.concatenate([e[~grey], f]), np.hstack([Q[:, ~grey], turned]), hidden


def _moves(nlp: Nlp, matrix: Bordered, V: Array) -> Array:
    """How all unknowns (n + np, r), in the program's units, move with the border along V (nb, r)."""
    at, place = matrix.at, matrix.place
    inside = matrix.eliminated[0] @ V
    inside += matrix.tree.solve(matrix.edge @ V - times(matrix.diagonal, matrix.lower, at.knot, inside))
    own = at.block >= 0
    moves = np.where(own[:, None], -inside[np.maximum(at.block, 0), np.where(own, place, 0)], V[np.where(own, 0, place)])
    moves[matrix.fixed] = 0.0
    return np.asarray((moves * matrix.size[:, None])[: nlp.size], dtype=np.float64)


def _slack(matrix: Bordered, X: Array, own: int) -> Array:
    """How far everything moves, in units of eps, when the sums that the constraints cancel are rounded; as X.

    Signs of rounding are drawn, the same ones at every call, so that no regular pattern of a plant cancels them.
    """
    sums = times(np.abs(matrix.diagonal), np.abs(matrix.lower), matrix.at.knot, np.abs(X)) + np.abs(matrix.edge)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=sums.shape[:2])
    signs[:, :own] = 0.0
    return np.abs(matrix.tree.solve(signs[:, :, None] * sums))


def _units(S: Array, summed: Array, multipliers: NDArray[np.bool_]) -> Array:
    """D (nb,) from its squares; a multiplier of the border, which may cost nothing, gets a unit that makes its row of S one at most."""
    D = np.sqrt(summed)
    unknown = ~multipliers & (D > 0)
    D[multipliers] = np.maximum(D[multipliers], np.max(np.abs(S[multipliers][:, unknown]) / D[unknown], axis=1, initial=0.0))
    return np.where(D > 0, D, 1.0)


def _rows(nlp: Nlp, at: Places, X: Array, idle: NDArray[np.bool_], kept: Index) -> Array:
    """X and the border itself, with the sign of X, at every interval's [l_i; p], (N, local + np, nb): l_i = [block before; own block]."""
    ip, free = nlp.interpolation, len(nlp.free)
    nx, local, own = ip.states, ip.local, ip.interior + ip.states
    knot = slice(own - nx, own)
    later = np.setdiff1d(np.arange(at.count), at.starts)
    rows = np.zeros((at.count, local + free, at.border))
    rows[later[:, None, None], np.arange(nx)[:, None], kept] = np.where(idle[later - 1, knot, None], 0.0, X[later - 1, knot])
    rows[at.starts[:, None], np.arange(nx), at.place[nlp.index[:nx, at.starts].T]] = -1.0
    rows[:, nx:local, kept] = np.where(idle[:, :own, None], 0.0, X[:, :own])
    rows[:, local + np.arange(free), at.border - free + np.arange(free)] = -1.0
    return rows


def _local_covariances(nlp: Nlp, at: Places, tree: BlockTridiagonal, rows: Array, C: Array, idle: NDArray[np.bool_]) -> Array:
    """Covariance of [l_i; p] of every interval, (N, local + np, local + np)."""
    ip = nlp.interpolation
    nx, local, own = ip.states, ip.local, ip.interior + ip.states
    knot = slice(own - nx, own)
    S, between = tree.inverse_blocks()
    S[idle] = 0.0
    np.swapaxes(S, 1, 2)[idle] = 0.0
    later = np.setdiff1d(np.arange(at.count), at.starts)
    out = rows @ C @ np.swapaxes(rows, 1, 2)
    out[later, :nx, :nx] += S[later - 1, knot, knot]
    out[:, nx:local, nx:local] += S[:, :own, :own]
    crossed = np.where(idle[later, :own, None] | idle[later - 1, None, knot], 0.0, between[later - 1, :own])
    out[later, nx:local, :nx] += crossed
    out[later, :nx, nx:local] += np.swapaxes(crossed, 1, 2)
    return out
