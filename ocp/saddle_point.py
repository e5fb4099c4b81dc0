"""The matrix of a Gauss-Newton step on constraints, factored by elimination along time.

    | H  J' | | s |     | g |
    | J  0  | | l | = - | c |

It is block-tridiagonal in time with a border, as in `curvature.py`: block k holds the interior of interval k, x(t_(k+1)) and the
multipliers of the interval's constraints, which determine them from x(t_k); the first knot of every horizon, the multipliers of what must
hold there, and the parameters form the border. Parameters stay within their bounds: the step is the least of its quadratic there, all
trajectories coming along. (M. Benzi, G. Golub, J. Liesen, Numerical solution of saddle point problems, Acta Numerica 14, 2005.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .blocktridiagonal import BlockTridiagonal, factor, times
from .evaluated import Linearised
from .nlp import Nlp
from .polynomials import Array

Index = NDArray[np.int64]

DEPENDENT = 1e-12  # eigenvalues of the border, in units in which its diagonal is one, that are rounding
EPS = float(np.finfo(np.float64).tiny)


class SaddlePoint:
    """The matrix at one X, factored, with some decisions fixed."""

    def __init__(self, nlp: Nlp, squares: Array, constraints: Sequence[Linearised], fixed: NDArray[np.bool_]) -> None:
        """squares (N, local + np, local + np); constraints: linearised; fixed (n + np,)."""
        self._place(nlp, constraints)
        self._fill(squares, constraints)
        self._scale(fixed)
        self._tree: BlockTridiagonal = factor(self.diagonal, self.lower, self._knot)
        self._X = self._tree.solve(self.border)
        R = self.border - times(self.diagonal, self.lower, self._knot, self._X)
        better = self._X + self._tree.solve(R)
        S = self.corner - np.einsum("kbi,kbj->ij", self.border, self._X) - np.einsum("kbi,kbj->ij", better, R)
        self._X, self._S = better, (S + S.T) / 2

    def step(self, g: Array, c: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Step s (n + np,) and multipliers, the parameters' step within [low, high]."""
        return self._solved(-g, -c, low[self._n :], high[self._n :])

    def onto(self, c: Array) -> Array:
        """The step that takes the constraints back, parameters unmoved."""
        zero = np.zeros(self._size - self._n)
        return self._solved(np.zeros(self._size), -c, zero, zero)[0]

    # ---- places

    def _place(self, nlp: Nlp, constraints: Sequence[Linearised]) -> None:
        index, nx = nlp.index, nlp.interpolation.states
        self._n, self._size, self._nx = nlp.trajectory_size, nlp.size, nx
        self._own, self._local = len(index) - nx, len(index)
        self._knot = slice(self._own - nx, self._own)
        self._starts = np.flatnonzero(np.insert(index[0, 1:] != index[self._own, :-1], 0, True))
        self._later = np.setdiff1d(np.arange(index.shape[1]), self._starts)
        self._inside, self._first = index[nx:].T, index[:nx, self._starts].T  # decisions of the blocks, and of the border
        self._offsets, self._edges = list[int](), list[int]()
        used, edge = self._own, self._first.size
        for part in constraints:
            at_start = nlp.terms[part.number].nodes is None
            self._offsets.append(-1 if at_start else used)
            self._edges.append(edge if at_start else -1)
            used, edge = used + (0 if at_start else part.J.shape[1]), edge + (part.r.size if at_start else 0)
        self._width, self._edge = used, edge
        self._intervals = [nlp.terms[part.number].interval for part in constraints]
        self._counts = [part.J.shape[1] for part in constraints]

    def _fill(self, squares: Array, constraints: Sequence[Linearised]) -> None:
        count, nx, own, local = len(squares), self._nx, self._own, self._local
        P, knot, later, starts = slice(self._edge, self._edge + squares.shape[1] - local), self._knot, self._later, self._starts
        self.diagonal, self.lower = np.zeros((count, self._width, self._width)), np.zeros((count - 1, self._width, nx))
        self.border, self.corner = np.zeros((count, self._width, P.stop)), np.zeros((P.stop, P.stop))
        self.diagonal[:, :own, :own] = squares[:, nx:local, nx:local]
        self.diagonal[later - 1, knot, knot] += squares[later, :nx, :nx]
        self.lower[later - 1, :own] = squares[later, nx:local, :nx]
        self.border[:, :own, P] = squares[:, nx:local, local:]
        self.border[later - 1, knot, P] += squares[later, :nx, local:]
        self.corner[P, P] = squares[:, local:, local:].sum(axis=0)
        firsts = [slice(nx * k, nx * (k + 1)) for k in range(len(starts))]
        for k, F in zip(starts, firsts, strict=True):
            self.border[k, :own, F] = squares[k, nx:local, :nx]
            self.corner[F, F] = squares[k, :nx, :nx]
            self.corner[F, P], self.corner[P, F] = squares[k, :nx, local:], squares[k, :nx, local:].T
        for part, offset, edge, where in zip(constraints, self._offsets, self._edges, self._intervals, strict=True):
            m = part.J.shape[1]
            if offset < 0:
                for j, k in enumerate(where):
                    rows, F = slice(edge + m * j, edge + m * (j + 1)), firsts[int(np.searchsorted(starts, k))]
                    self.border[k, :own, rows] = part.J[j, :, nx:local].T
                    for columns, block in ((F, part.J[j, :, :nx]), (P, part.J[j, :, local:])):
                        self.corner[rows, columns], self.corner[columns, rows] = block, block.T
                continue
            rows = slice(offset, offset + m)
            self.diagonal[where, rows, :own] = part.J[:, :, nx:local]
            self.diagonal[where, :own, rows] = np.swapaxes(part.J[:, :, nx:local], 1, 2)
            self.border[where, rows, P] = part.J[:, :, local:]
            follows = ~np.isin(where, starts)
            self.lower[where[follows] - 1, rows] = part.J[follows, :, :nx]
            for k, F in zip(starts, firsts, strict=True):
                self.border[k, rows, F] = part.J[np.searchsorted(where, k), :, :nx]

    def _scale(self, fixed: NDArray[np.bool_]) -> None:
        """Units in which unknowns have a diagonal of one and constraints a largest entry of one; what is fixed, or idle, stands alone."""
        own, count = self._own, len(self.diagonal)
        inner, outer = np.ones((count, self._width)), np.ones(len(self.corner))
        pivots = np.einsum("kii->ki", self.diagonal)[:, :own]
        inner[:, :own] = np.where(pivots > 0, 1.0 / np.sqrt(np.where(pivots > 0, pivots, 1.0)), 1.0)
        inner[:, :own][fixed[self._inside]] = 0.0
        pivots = np.diag(self.corner)
        outer = np.where(pivots > 0, 1.0 / np.sqrt(np.where(pivots > 0, pivots, 1.0)), 1.0)
        outer[: self._first.size][fixed[self._first.ravel()]] = 0.0
        outer[self._edge :][fixed[self._n :]] = 0.0
        largest = np.max(np.abs(self.diagonal[:, own:, :own]) * inner[:, None, :own], axis=2, initial=0.0)
        inner[:, own:] = np.where(largest > 0, 1.0 / np.where(largest > 0, largest, 1.0), 0.0)
        R = slice(self._first.size, self._edge)
        largest = np.max(np.abs(self.corner[R]) * outer, axis=1, initial=0.0)
        outer[R] = np.where(largest > 0, 1.0 / np.where(largest > 0, largest, 1.0), 0.0)
        self.diagonal *= inner[:, :, None] * inner[:, None, :]
        self.lower *= inner[1:, :, None] * inner[:-1, None, self._knot]
        self.border *= inner[:, :, None] * outer
        self.corner *= outer[:, None] * outer
        k, i = np.nonzero(inner == 0)
        self.diagonal[k, i, i] = 1.0
        gone = np.flatnonzero(outer == 0)
        self.corner[gone, gone] = 1.0
        self._inner, self._outer = inner, outer

    # ---- solving

    def _solved(self, of_unknowns: Array, of_constraints: Array, low: Array, high: Array) -> tuple[Array, Array]:
        blocks, edge = self._arranged(of_unknowns, of_constraints)
        x = self._tree.solve(blocks[:, :, None])
        x += self._tree.solve(blocks[:, :, None] - times(self.diagonal, self.lower, self._knot, x))
        # what the border has to solve is exact to the second order in the error of x, as S is
        rest = edge - np.einsum("kbi,kb->i", self.border, x[:, :, 0])
        q = self._bounded(rest, low, high)
        return self._back(x[:, :, 0] - self._X @ q, q)

    def _bounded(self, rest: Array, low: Array, high: Array) -> Array:
        """The border's unknowns: stationary, the parameters within their bounds."""
        unit, first = self._outer[self._edge :], self._edge
        movable = unit > 0
        low, high = np.where(movable, low, 0.0), np.where(movable, high, 0.0)
        held, of_edge = np.zeros(len(rest), dtype=bool), np.zeros(len(rest), dtype=bool)
        of_edge[self._first.size : first] = True
        q = np.zeros(len(rest))
        for _ in range(len(unit) + 1):
            free = np.flatnonzero(~held)
            q[free] = _least(self._S[np.ix_(free, free)], rest[free] - self._S[np.ix_(free, held)] @ q[held], of_edge[free])
            moved = q[first:] * unit
            beyond = ((moved < low) | (moved > high)) & movable & ~held[first:]
            if not beyond.any():
                break
            q[first:][beyond] = np.clip(moved, low, high)[beyond] / unit[beyond]
            held[first:] |= beyond
        return q

    def _arranged(self, of_unknowns: Array, of_constraints: Array) -> tuple[Array, Array]:
        blocks, edge = np.zeros(self._inner.shape), np.zeros(len(self._outer))
        blocks[:, : self._own] = of_unknowns[self._inside]
        edge[: self._first.size] = of_unknowns[self._first.ravel()]
        edge[self._edge :] = of_unknowns[self._n :]
        for offset, at, where, rows in self._of_constraints(of_constraints):
            if offset < 0:
                edge[at : at + rows.size] = rows.ravel()
            else:
                blocks[where, offset : offset + rows.shape[1]] = rows
        return blocks * self._inner, edge * self._outer

    def _back(self, blocks: Array, edge: Array) -> tuple[Array, Array]:
        blocks, edge = blocks * self._inner, edge * self._outer
        s = np.empty(self._size)
        s[self._inside] = blocks[:, : self._own]
        s[self._first.ravel()] = edge[: self._first.size]
        s[self._n :] = edge[self._edge :]
        multipliers = np.zeros(sum(m * len(where) for m, where in zip(self._counts, self._intervals, strict=True)))
        for offset, at, where, rows in self._of_constraints(multipliers):
            rows[:] = edge[at : at + rows.size].reshape(rows.shape) if offset < 0 else blocks[where, offset : offset + rows.shape[1]]
        return s, multipliers

    def _of_constraints(self, rows: Array) -> list[tuple[int, int, Index, Array]]:
        """Offset in the block, or place in the border, intervals, and a view (C, m) of every term's rows."""
        out, first = list[tuple[int, int, Index, Array]](), 0
        for offset, edge, where, m in zip(self._offsets, self._edges, self._intervals, self._counts, strict=True):
            out.append((offset, edge, where, rows[first : first + m * len(where)].reshape(len(where), m)))
            first += m * len(where)
        return out


def _least(S: Array, rhs: Array, multipliers: NDArray[np.bool_]) -> Array:
    """S^-1 rhs, nothing along what S leaves open."""
    size = np.sqrt(np.abs(np.diag(S)))
    size = np.where(size > 0, size, 1.0)
    size[multipliers] = np.max(np.abs(S[multipliers][:, ~multipliers]) / size[~multipliers], axis=1, initial=EPS)
    e, Q = np.linalg.eigh(S / np.outer(size, size))
    told = np.abs(e) > DEPENDENT
    return np.asarray((Q[:, told] / e[told]) @ (Q[:, told].T @ (rhs / size)) / size)
