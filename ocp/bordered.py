"""Symmetric matrices of a program that are block-tridiagonal in time with a border: arranged, eliminated, and their inverses.

Block k holds the interior of interval k, x(t_(k+1)) and the multipliers of the interval's rows of J, which determine them from x(t_k): no
block is singular, and elimination runs with time, in which a plant forgets. The next block sees of it x(t_(k+1)) alone, its knot. The first
knot of every horizon, the multipliers of what must hold there, and the parameters form the border. With H_cc the part of the blocks,

    X = H_cc^-1 H_cb,    S = H_bb - H_bc X,    inverse:  C_bb = S^-1,   C_cc = H_cc^-1 + X C_bb X',   C_cb = -X C_bb
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .blocktridiagonal import BlockTridiagonal, factor, times
from .nlp import Nlp
from .polynomials import Array

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Each halves the decades by which the largest entries of rows differ.
SWEEPS = 6


@dataclass(frozen=True, kw_only=True)
class Places:
    """Where every unknown and multiplier stands: block (-1 in the border) and place there. Shapes (n + np + constraints,).

    starts (H,): intervals that open a horizon; count, size of the blocks; knot: places of x(t_(k+1)) in them; border: its size, the
    parameters last.
    """

    block: Index
    place: Index
    starts: Index
    count: int
    size: int
    knot: slice
    border: int


def arrange(nlp: Nlp) -> Places:
    """The places of all unknowns, in the order trajectory, parameters, multipliers of constraints and heavy terms."""
    ip, index = nlp.interpolation, nlp.index
    nx, own, intervals, n, free = ip.states, ip.interior + ip.states, index.shape[1], nlp.trajectory_size, len(nlp.free)
    starts = np.flatnonzero(np.insert(index[0, 1:] != index[own, :-1], 0, True))
    block, place = np.full(nlp.size, -1, dtype=np.int64), np.empty(nlp.size, dtype=np.int64)
    block[index[nx:]], place[index[nx:]] = np.arange(intervals), np.arange(own)[:, None]
    place[index[:nx, starts].T.ravel()] = np.arange(nx * len(starts))
    used, edge = np.full(intervals, own), nx * len(starts)
    blocks, places = [block], [place]
    for term in nlp.terms:
        if term.equality and term.nodes is None:
            # what must hold at single places is said of the start
            blocks.append(np.full(term.target.size, -1))
            places.append(edge + np.arange(term.target.size))
            edge += term.target.size
        elif term.equality or term.heavy:
            m = term.target.shape[0]
            blocks.append(np.repeat(term.interval, m))
            places.append((used[term.interval][:, None] + np.arange(m)).ravel())
            used[term.interval] += m
    place[n:] = edge + np.arange(free)
    return Places(
        block=np.concatenate(blocks),
        place=np.concatenate(places),
        starts=starts,
        count=intervals,
        size=int(used.max()),
        knot=slice(ip.interior, own),
        border=edge + free,
    )


@dataclass(frozen=True, kw_only=True)
class Bordered:
    """A matrix with all rows in units `size` in which their largest entries are near one, and without the rows that are `fixed`.

    diagonal (N, b, b), lower (N - 1, b, nx) in the columns of the knot, edge (N, b, nk), corner (nk, nk): its blocks. idle (N, b): places
    of blocks where nothing stands, with a one on the diagonal; kept (nk,): the places of the border that are not fixed; place: of all,
    there among these.
    """

    at: Places
    size: Array
    fixed: Mask
    diagonal: Array
    lower: Array
    edge: Array
    corner: Array
    idle: Mask
    kept: Index
    place: Index

    @cached_property
    def tree(self) -> BlockTridiagonal:
        """The factor of the blocks; raises numpy.linalg.LinAlgError where one is singular."""
        return factor(self.diagonal, self.lower, self.at.knot)

    @cached_property
    def eliminated(self) -> tuple[Array, Array]:
        """X and S, one step of refinement each: their errors are then those of rounded entries (Skeel, Math. Comp. 35, 1980).

        With a residual R = H_cb - H_cc X, H_bc H_cc^-1 H_cb = H_bc X + (X + H_cc^-1 R)' R exactly.
        """
        X = self.tree.solve(self.edge)
        R = self.edge - times(self.diagonal, self.lower, self.at.knot, X)
        better = X + self.tree.solve(R)
        S = self.corner - np.einsum("kbi,kbj->ij", self.edge, X) - np.einsum("kbi,kbj->ij", better, R)
        return better, (S + S.T) / 2

    def traces(self, rows: Index, columns: Index, values: Array) -> Array:
        """Parts of tr(K^-1 D) by the interval that D's entries belong to, (N,); D symmetric, by the entries of one triangle, in K's units.

        Entries of the border belong to the first interval. Raises numpy.linalg.LinAlgError where K is singular.
        """
        keep = ~(self.fixed[rows] | self.fixed[columns])
        rows, columns, values = rows[keep], columns[keep], values[keep]
        behind = self.at.block[rows] < self.at.block[columns]
        rows, columns = np.where(behind, columns, rows), np.where(behind, rows, columns)
        (kr, ir), (kc, ic) = ((self.at.block[i], self.place[i]) for i in (rows, columns))
        diagonal, lower, edge, corner = self._inverse
        inverse = np.zeros(len(values))
        for block, where, indices in (
            (diagonal, (kr == kc) & (kr >= 0), (kr, ir, ic)),
            (lower, (kr == kc + 1) & (kc >= 0), (kc, ir, ic - self.at.knot.start)),
            (edge, (kr >= 0) & (kc < 0), (kr, ir, ic)),
            (corner, kr < 0, (ir, ic)),
        ):
            inverse[where] = block[tuple(i[where] for i in indices)]
        twice = np.where(rows == columns, 1.0, 2.0) * self.size[rows] * self.size[columns]
        found = np.bincount(np.maximum(kr, 0), weights=twice * values * inverse, minlength=self.at.count)
        return found.astype(np.float64)  # of no entries it would be of integers

    @property
    def log_abs_determinant(self) -> float:
        """log |det K|, but for multipliers of what concerns fixed unknowns alone; -inf where K is singular."""
        S = self.eliminated[1]
        told = np.any(S, axis=1)
        return self.tree.log_abs_determinant + float(np.linalg.slogdet(S[np.ix_(told, told)])[1] - 2.0 * np.sum(np.log(self.size)))

    @cached_property
    def _inverse(self) -> tuple[Array, Array, Array, Array]:
        """The inverse where the blocks, the border and its corner are."""
        X, S = self.eliminated
        # a multiplier of what concerns fixed unknowns alone
        alone = ~np.any(S, axis=1)
        C = np.linalg.inv(S + np.diag(alone.astype(float)))
        diagonal, lower = self.tree.inverse_blocks()
        XC = X @ C
        return diagonal + XC @ np.swapaxes(X, 1, 2), lower + XC[1:] @ np.swapaxes(X[:-1, self.at.knot], 1, 2), -XC, C


def bordered(nlp: Nlp, hessian: sp.csc_matrix, jacobian: sp.csc_matrix, softness: Array, known: Index) -> Bordered:
    """[H J'; J -d] of H (its upper triangle), J and d = softness (rows of J,), with the `known` decisions fixed."""
    at = arrange(nlp)
    there = sp.coo_matrix(entries(nlp, hessian, jacobian))
    rows, columns, values = there.row.astype(np.int64), there.col.astype(np.int64), there.data
    soft = nlp.size + np.flatnonzero(softness)
    rows, columns = np.concatenate([rows, soft]), np.concatenate([columns, soft])
    values = np.concatenate([values, -softness[softness != 0]])
    fixed = np.zeros(len(at.block), dtype=bool)
    fixed[known] = True
    keep = ~(fixed[rows] | fixed[columns])
    rows, columns, values = rows[keep], columns[keep], values[keep]
    size = _equilibrated(rows, columns, values, len(fixed))
    free = np.ones(at.border, dtype=bool)
    free[at.place[fixed & (at.block < 0)]] = False
    kept = np.flatnonzero(free)
    place = _kept_places(at, kept)
    diagonal, lower, edge, corner = _dense(at, place, len(kept), rows, columns, values * size[rows] * size[columns])
    idle = np.ones((at.count, at.size), dtype=bool)
    inside = (at.block >= 0) & ~fixed
    idle[at.block[inside], at.place[inside]] = False
    k, i = np.nonzero(idle)
    diagonal[k, i, i] = 1.0
    return Bordered(
        at=at, size=size, fixed=fixed, diagonal=diagonal, lower=lower, edge=edge, corner=corner, idle=idle, kept=kept, place=place
    )


def _kept_places(at: Places, kept: Index) -> Index:
    """The places of all unknowns, those in the border among what is kept of that, -1 where they are not."""
    among = np.full(at.border, -1, dtype=np.int64)
    among[kept] = np.arange(len(kept))
    return np.where(at.block >= 0, at.place, among[np.where(at.block >= 0, 0, at.place)])


def entries(nlp: Nlp, hessian: sp.csc_matrix, jacobian: sp.csc_matrix) -> sp.csc_matrix:
    """Upper triangle of H, and J below: one triangle of the matrix but for its softness, (n + np + rows, n + np + rows)."""
    empty = sp.csc_matrix((nlp.size + jacobian.shape[0], jacobian.shape[0]))
    return sp.csc_matrix(sp.hstack([sp.vstack([hessian, jacobian]), empty], format="csc"))


def _equilibrated(rows: Index, columns: Index, values: Array, count: int) -> Array:
    """Units (count,), powers of two, in which every row of the symmetric matrix has its largest entry near one (Ruiz, RAL-TR-2001-034)."""
    size = np.ones(count)
    for _ in range(SWEEPS):
        entry, largest = np.abs(values) * size[rows] * size[columns], np.zeros(count)
        np.maximum.at(largest, rows, entry)
        np.maximum.at(largest, columns, entry)
        size /= np.sqrt(np.where(largest > 0, largest, 1.0))
    return np.exp2(np.round(np.log2(size)))


def _dense(at: Places, place: Index, kept: int, rows: Index, columns: Index, values: Array) -> tuple[Array, Array, Array, Array]:
    """Blocks [k, k], [k + 1, k], the border and its corner from the entries of one triangle, each of them once."""
    b, knot = at.size, at.knot
    diagonal, lower = np.zeros((at.count, b, b)), np.zeros((max(at.count - 1, 0), b, knot.stop - knot.start))
    border, corner = np.zeros((at.count, b, kept)), np.zeros((kept, kept))
    mirrored = rows != columns
    r, c = np.concatenate([rows, columns[mirrored]]), np.concatenate([columns, rows[mirrored]])
    v = np.concatenate([values, values[mirrored]])
    kr, kc, ir, ic = at.block[r], at.block[c], place[r], place[c]
    inner = (kr >= 0) & (kc >= 0)
    for target, where, indices in (
        (diagonal, inner & (kr == kc), (kr, ir, ic)),
        (lower, inner & (kr == kc + 1), (kc, ir, ic - knot.start)),
        (border, (kr >= 0) & (kc < 0), (kr, ir, ic)),
        (corner, (kr < 0) & (kc < 0), (ir, ic)),
    ):
        target[tuple(i[where] for i in indices)] = v[where]
    return diagonal, lower, border, corner
