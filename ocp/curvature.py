"""Curvature of a program at its solution: covariances, linear in the length of the record.

The inverse of the KKT matrix of the Gauss-Newton program,

    | H  J' |^-1   | C  . |
    | J  0  |    = | .  . |,         C = covariance of all unknowns given the data, on the constraints,

is block-tridiagonal in time with a border for the parameters. With H_cc the part of the trajectories (and the multipliers),
X = H_cc^-1 H_cp and S = H_pp - H_pc X:

    C_pp = S^-1,    C_cc = H_cc^-1 + X C_pp X',    C_cp = -X C_pp
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
class Blocks:
    """Where every unknown and every multiplier stands: block number and place in the block."""

    block: Index
    place: Index
    count: int
    size: int


def arrange(nlp: Nlp) -> Blocks:
    """Block k holds x(t_k), the interior of interval k and the multipliers of its constraints; the last knot of a horizon its own."""
    nx, stride, index = nlp.interpolation.states, nlp.interpolation.states + nlp.interpolation.interior, nlp.index
    intervals = index.shape[1]
    ends = np.append(index[0, 1:] != index[stride, :-1], True)
    first = np.arange(intervals) + np.concatenate([[0], np.cumsum(ends[:-1])])
    block, place = np.empty(nlp.trajectory_size, dtype=np.int64), np.empty(nlp.trajectory_size, dtype=np.int64)
    block[index[:stride]], place[index[:stride]] = first, np.arange(stride)[:, None]
    block[index[stride:, ends]], place[index[stride:, ends]] = first[ends] + 1, np.arange(nx)[:, None]
    used = np.full(intervals, stride)
    blocks, places = [block], [place]
    for term in nlp.terms:
        if term.equality:
            m, owner = term.target.shape[0], term.row_interval
            order = np.argsort(owner, kind="stable")
            rank = np.empty_like(order)
            rank[order] = np.arange(len(owner)) - np.searchsorted(owner[order], owner[order])
            at = used[owner] + m * rank
            blocks.append(np.repeat(first[owner], m))
            places.append((at[:, None] + np.arange(m)).ravel())
            used += m * np.bincount(owner, minlength=intervals)
    return Blocks(block=np.concatenate(blocks), place=np.concatenate(places), count=int(first[-1]) + 2, size=int(used.max()))


def curvature(nlp: Nlp, hessian: sp.csc_matrix, jacobian: sp.csc_matrix, unit: Array, fixed: Index) -> Curvature:
    """Covariances from the (upper triangle of the) Hessian and the Jacobian in units `unit`; `fixed` decisions are known exactly.

    Raises numpy.linalg.LinAlgError when the unknowns are not determined at all.
    """
    where, n, free = arrange(nlp), nlp.trajectory_size, len(nlp.free)
    upper, J = hessian.tocoo(), jacobian.tocoo()
    rows = np.concatenate([upper.row, nlp.size + J.row])
    columns = np.concatenate([upper.col, J.col])
    values = np.concatenate([upper.data, J.data])
    known = np.zeros(nlp.size + jacobian.shape[0], dtype=bool)
    known[fixed] = True
    keep = ~(known[rows] | known[columns])
    rows, columns, values = rows[keep], columns[keep], values[keep]
    # multipliers follow the trajectory unknowns; parameters last
    def renumber(i: Index) -> Index:
        return np.where(i < n, i, np.where(i < nlp.size, i - n + n + jacobian.shape[0], i - free))

    rows, columns = renumber(rows), renumber(columns)
    inner = n + jacobian.shape[0]
    diagonal, lower, border, corner = _dense(where, rows, columns, values, inner, free)
    blank = np.ones((where.count, where.size), dtype=bool)
    blank[where.block, where.place] = False
    gone = fixed[fixed < n]
    blank[where.block[gone], where.place[gone]] = True
    k, i = np.nonzero(blank)
    diagonal[k, i, i] = 1.0
    for q in fixed[fixed >= n] - n:
        corner[q, q] = 1.0
    tree = factor(diagonal, lower)
    X = tree.solve(border)
    S = corner - np.einsum("kbi,kbj->ij", border, X)
    eigenvalues = np.linalg.eigvalsh(S) if free else np.ones(1)
    C = np.linalg.inv(S) if free else np.empty((0, 0))
    C = (C + C.T) / 2
    definite = tree.negative_eigenvalues == jacobian.shape[0] and bool(np.all(eigenvalues > 0))
    local = _local_covariances(nlp, where, tree, X, C, blank)
    theta = unit[n:]
    scale = np.concatenate([nlp.local(unit[:n]), np.repeat(theta[:, None], nlp.index.shape[1], axis=1)]).T
    return Curvature(
        parameter_covariance=C * np.outer(theta, theta),
        interval_covariance=local * scale[:, :, None] * scale[:, None, :],
        log_determinant=tree.log_abs_determinant + float(np.sum(np.log(np.abs(eigenvalues)))),
        definite=definite,
    )


def _dense(where: Blocks, rows: Index, columns: Index, values: Array, inner: int, free: int) -> tuple[Array, Array, Array, Array]:
    """Dense blocks of the bordered KKT matrix from the entries of one triangle."""
    b = where.size
    diagonal, lower = np.zeros((where.count, b, b)), np.zeros((where.count - 1, b, b))
    border, corner = np.zeros((where.count, b, free)), np.zeros((free, free))
    both = (rows < inner) & (columns < inner)
    r, c, v = rows[both], columns[both], values[both]
    kr, kc, ir, ic = where.block[r], where.block[c], where.place[r], where.place[c]
    same = kr == kc
    np.add.at(diagonal, (kr[same], ir[same], ic[same]), v[same])
    off = same & (r != c)
    np.add.at(diagonal, (kr[off], ic[off], ir[off]), v[off])
    down, up = kr == kc + 1, kc == kr + 1
    np.add.at(lower, (kc[down], ir[down], ic[down]), v[down])
    np.add.at(lower, (kr[up], ic[up], ir[up]), v[up])
    for r, c, v in ((rows, columns, values), (columns, rows, values)):
        mixed = (r < inner) & (c >= inner)
        np.add.at(border, (where.block[r[mixed]], where.place[r[mixed]], c[mixed] - inner), v[mixed])
    square = (rows >= inner) & (columns >= inner)
    r, c, v = rows[square] - inner, columns[square] - inner, values[square]
    np.add.at(corner, (r, c), v)
    off = r != c
    np.add.at(corner, (c[off], r[off]), v[off])
    return diagonal, lower, border, corner


def _local_covariances(nlp: Nlp, where: Blocks, tree: BlockTridiagonal, X: Array, C: Array, blank: NDArray[np.bool_]) -> Array:
    """Covariance of [l_i; p] of every interval, (N, local + np, local + np)."""
    nx, local, free = nlp.interpolation.states, nlp.interpolation.local, C.shape[0]
    left = local - nx
    S, between = tree.inverse_blocks()
    k = where.block[nlp.index[0]]
    out = np.zeros((len(k), local + free, local + free))
    out[:, :left, :left] = S[k, :left, :left]
    out[:, left:local, left:local] = S[k + 1, :nx, :nx]
    out[:, left:local, :left] = between[k, :nx, :left]
    out[:, :left, left:local] = np.swapaxes(between[k, :nx, :left], 1, 2)
    own = np.concatenate([X[k, :left], X[k + 1, :nx]], axis=1)
    out[:, :local, :local] += own @ C @ np.swapaxes(own, 1, 2)
    out[:, :local, local:] = -own @ C
    out[:, local:, :local] = np.swapaxes(out[:, :local, local:], 1, 2)
    out[:, local:, local:] = C
    gone = np.concatenate([blank[k, :left], blank[k + 1, :nx], np.zeros((len(k), free), dtype=bool)], axis=1)
    out[np.broadcast_to(gone[:, :, None], out.shape) | np.broadcast_to(gone[:, None, :], out.shape)] = 0.0
    return out
