"""Curvature of a program at its solution: covariances, linear in the length of the record.

The inverse of the KKT matrix of the Gauss-Newton program,

    | H  J' |^-1   | C  . |
    | J  0  |    = | .  . |,         C = covariance of all unknowns given the data, on the constraints,

is block-tridiagonal in time with a border. Block k holds x(t_k), the interior of interval k and the multipliers of its constraints,
which determine x(t_k) and the interior from x(t_(k+1)), so no block is singular; the last knot of every horizon and the parameters
form the border.
With H_cc the part of the blocks, X = H_cc^-1 H_cb and S = H_bb - H_bc X:

    C_bb = S^-1,    C_cc = H_cc^-1 + X C_bb X',    C_cb = -X C_bb
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .blocktridiagonal import BlockTridiagonal, factor
from .nlp import Nlp
from .polynomials import Array

Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Curvature:
    """Covariances in the units of the model.

    parameter_covariance (np, np). interval_covariance (N, local + np, local + np): of every interval's local unknowns and the
    parameters. log_determinant of the KKT matrix in the program's units. definite: whether the solution is a strict minimum.
    """

    parameter_covariance: Array
    interval_covariance: Array
    log_determinant: float
    definite: bool


@dataclass(frozen=True, kw_only=True)
class Places:
    """Where every unknown and multiplier stands: block (-1 in the border) and place there. Shapes (n + np + constraints,).

    first (N,): block of every interval; last (H, nx): decisions of the last knots; count, size of the blocks; border: its size.
    """

    block: Index
    place: Index
    first: Index
    last: Index
    count: int
    size: int
    border: int


def arrange(nlp: Nlp) -> Places:
    """The places of all unknowns, in the order trajectory, parameters, multipliers."""
    _nx, stride, index = nlp.interpolation.states, nlp.interpolation.states + nlp.interpolation.interior, nlp.index
    intervals, n = index.shape[1], nlp.trajectory_size
    ends = np.append(index[0, 1:] != index[stride, :-1], True)
    last = index[stride:, ends].T
    block, place = np.full(nlp.size, -1, dtype=np.int64), np.empty(nlp.size, dtype=np.int64)
    block[index[:stride]], place[index[:stride]] = np.arange(intervals), np.arange(stride)[:, None]
    place[last.ravel()] = np.arange(last.size)
    place[n:] = last.size + np.arange(len(nlp.free))
    used = np.full(intervals, stride)
    blocks, places = [block], [place]
    for term in nlp.terms:
        if term.equality:
            m, owner = term.target.shape[0], term.interval
            order = np.argsort(owner, kind="stable")
            rank = np.empty_like(order)
            rank[order] = np.arange(len(owner)) - np.searchsorted(owner[order], owner[order])
            blocks.append(np.repeat(owner, m))
            places.append(((used[owner] + m * rank)[:, None] + np.arange(m)).ravel())
            used = used + m * np.bincount(owner, minlength=intervals)
    return Places(
        block=np.concatenate(blocks),
        place=np.concatenate(places),
        first=np.arange(intervals),
        last=last,
        count=intervals,
        size=int(used.max()),
        border=last.size + len(nlp.free),
    )


def curvature(nlp: Nlp, hessian: sp.csc_matrix, jacobian: sp.csc_matrix, unit: Array, known: Index) -> Curvature:
    """Covariances from the (upper triangle of the) Hessian and the Jacobian in units `unit`; `known` decisions are fixed.

    Raises numpy.linalg.LinAlgError when the unknowns are not determined at all.
    """
    at, n = arrange(nlp), nlp.trajectory_size
    upper, J = hessian.tocoo(), jacobian.tocoo()
    rows = np.concatenate([upper.row, nlp.size + J.row])
    columns = np.concatenate([upper.col, J.col])
    values = np.concatenate([upper.data, J.data])
    fixed = np.zeros(len(at.block), dtype=bool)
    fixed[known] = True
    keep = ~(fixed[rows] | fixed[columns])
    diagonal, lower, border, corner = _dense(at, rows[keep], columns[keep], values[keep])
    idle = np.ones((at.count, at.size), dtype=bool)
    inside = (at.block >= 0) & ~fixed
    idle[at.block[inside], at.place[inside]] = False
    k, i = np.nonzero(idle)
    diagonal[k, i, i] = 1.0
    gone = at.place[fixed & (at.block < 0)]
    corner[gone, gone] = 1.0
    tree = factor(diagonal, lower)
    X = tree.solve(border)
    S = corner - np.einsum("kbi,kbj->ij", border, X)
    eigenvalues = np.linalg.eigvalsh(S)
    C = np.linalg.inv(S)
    C = (C + C.T) / 2
    C[gone], C[:, gone] = 0.0, 0.0
    theta = unit[n:]
    scale = np.concatenate([nlp.local(unit[:n]), np.repeat(theta[:, None], at.count, axis=1)]).T
    local = _local_covariances(nlp, at, tree, X, C, idle)
    return Curvature(
        parameter_covariance=C[at.last.size :, at.last.size :] * np.outer(theta, theta),
        interval_covariance=local * scale[:, :, None] * scale[:, None, :],
        log_determinant=tree.log_abs_determinant + float(np.sum(np.log(np.abs(eigenvalues)))),
        definite=tree.negative_eigenvalues == jacobian.shape[0] and bool(np.all(eigenvalues > 0)),
    )


def _dense(at: Places, rows: Index, columns: Index, values: Array) -> tuple[Array, Array, Array, Array]:
    """Blocks [k, k], [k + 1, k], the border and its corner from the entries of one triangle."""
    b = at.size
    diagonal, lower = np.zeros((at.count, b, b)), np.zeros((max(at.count - 1, 0), b, b))
    border, corner = np.zeros((at.count, b, at.border)), np.zeros((at.border, at.border))
    mirrored = rows != columns
    r, c = np.concatenate([rows, columns[mirrored]]), np.concatenate([columns, rows[mirrored]])
    v = np.concatenate([values, values[mirrored]])
    kr, kc, ir, ic = at.block[r], at.block[c], at.place[r], at.place[c]
    inner = (kr >= 0) & (kc >= 0)
    for target, where, indices in (
        (diagonal, inner & (kr == kc), (kr, ir, ic)),
        (lower, inner & (kr == kc + 1), (kc, ir, ic)),
        (border, (kr >= 0) & (kc < 0), (kr, ir, ic)),
        (corner, (kr < 0) & (kc < 0), (ir, ic)),
    ):
        flat = np.ravel_multi_index(tuple(i[where] for i in indices), target.shape)
        target.ravel()[:] += np.bincount(flat, weights=v[where], minlength=target.size)
    return diagonal, lower, border, corner


def _local_covariances(nlp: Nlp, at: Places, tree: BlockTridiagonal, X: Array, C: Array, idle: NDArray[np.bool_]) -> Array:
    """Covariance of [l_i; p] of every interval, (N, local + np, local + np): l_i = own block, next block or border."""
    nx, local, free = nlp.interpolation.states, nlp.interpolation.local, len(nlp.free)
    left = local - nx
    S, between = tree.inverse_blocks()
    ends = at.block[nlp.index[left]] < 0
    go_on = np.flatnonzero(~ends)
    S[idle] = 0.0
    np.swapaxes(S, 1, 2)[idle] = 0.0
    own = np.zeros((at.count, local + free, at.border))
    own[:, :left] = np.where(idle[:, :left, None], 0.0, X[:, :left])
    own[go_on, left:local] = np.where(idle[go_on + 1, :nx, None], 0.0, X[go_on + 1, :nx])
    where, order = np.nonzero(ends)[0], np.arange(nx)
    own[where[:, None], left + order[None, :], at.place[at.last]] = -1.0
    own[:, local + np.arange(free), at.last.size + np.arange(free)] = -1.0
    out = own @ C @ np.swapaxes(own, 1, 2)
    out[:, :left, :left] += S[:, :left, :left]
    out[go_on, left:local, left:local] += S[go_on + 1, :nx, :nx]
    crossed = np.where(idle[go_on + 1, :nx, None] | idle[go_on, None, :left], 0.0, between[go_on, :nx, :left])
    out[go_on, left:local, :left] += crossed
    out[go_on, :left, left:local] += np.swapaxes(crossed, 1, 2)
    return out
