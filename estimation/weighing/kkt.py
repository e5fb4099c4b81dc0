"""The KKT matrix of a solution: solves with it, how well conditioned it is, and what every weight does to every estimate.

With g_f = J_f'r_f the pull of the rows of weight f, theta_f the logarithm of its standard deviation, K the matrix with the exact Hessian
of the Lagrangian, differentiating the conditions of optimality gives

    K [dX/dtheta_f; .]  =  [2 g_f; 0]

for the reference p_ref of the program held, as a solve holds it, and bounds that hold what they hold now.
(Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU, onenormest, splu

from backsight.models import SolveError
from backsight.ocp import Solution
from backsight.ocp.bordered import arrange
from backsight.ocp.subnormal import flushed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

SWEEPS = 6  # each halves the decades by which the largest entries of rows differ


@dataclass(frozen=True)
class Kkt:
    """[H J'; J -diag(d)] over the unknowns that can move, the others with a one on the diagonal.

    free (n + np,): 1 where an unknown can move. inner: the rows of what lies along time, in its order, where the matrix is a band;
    border: first states, parameters and what must hold at single places, which are eliminated last.
    """

    matrix: sp.csc_matrix
    free: Array
    inner: Index
    border: Index

    def solve(self, g: Array) -> Array:
        """The upper part of K^-1 [g; 0] for columns g (n + np, m) in the program's units; zero for what is held."""
        right = np.zeros((self.matrix.shape[0], g.shape[1]))
        right[: len(self.free)] = self.free[:, None] * g
        return self.solved(right)[: len(self.free)]

    @property
    def condition(self) -> float:
        """Condition number in the 1-norm, after every row and column was given a largest entry near one (Higham & Tisseur 2000)."""
        size = np.ones(self.matrix.shape[0])
        for _ in range(SWEEPS):
            largest = abs(_scaled(self.matrix, size)).max(axis=1).toarray().ravel()
            size = size / np.sqrt(np.where(largest > 0, largest, 1.0))
        K = _scaled(self.matrix, size)

        def inverse(v: Array) -> Array:
            return self.solved((np.ravel(v) / size)[:, None])[:, 0] / size

        operator = LinearOperator(K.shape, matvec=inverse, rmatvec=inverse, dtype=np.float64)
        return float(abs(K).sum(axis=0).max() * onenormest(operator, t=1))  # more columns would be drawn at random

    def solved(self, right: Array) -> Array:
        """K^-1 of columns that have rows for the multipliers too."""
        found = np.empty(right.shape)
        inside = self._inside(right[self.inner])
        found[self.border] = self._corner @ (right[self.border] - self._edge.T @ inside)
        found[self.inner] = inside - self._across @ found[self.border]
        return found

    def _inside(self, right: Array) -> Array:
        with flushed():
            return np.asarray(self._band.solve(right))

    @cached_property
    def _band(self) -> SuperLU:
        band = sp.csc_matrix(self.matrix[self.inner][:, self.inner])
        with flushed():
            return splu(band, permc_spec="NATURAL")

    @cached_property
    def _edge(self) -> sp.csc_matrix:
        return sp.csc_matrix(self.matrix[self.inner][:, self.border])

    @cached_property
    def _across(self) -> Array:
        return self._inside(self._edge.toarray())

    @cached_property
    def _corner(self) -> Array:
        """Inverse of the border's Schur complement; what the data leave open is left alone. Raises SolveError where it has no numbers."""
        S = self.matrix[self.border][:, self.border].toarray() - self._edge.T @ self._across
        if not np.isfinite(S).all():
            raise SolveError("the equations linearised at the solution have derivatives that are not finite")
        size = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(S)), np.finfo(float).tiny))
        return np.asarray(size[:, None] * np.linalg.pinv(size[:, None] * S * size, hermitian=True, rcond=1e-13) * size)


def gauss_newton(solution: Solution, more: sp.csc_matrix | None = None) -> Kkt:
    """The matrix of the least-squares steps, which is that of the covariances. more (n, n + np): derivatives of further squares."""
    H, J, d = solution.solver.kkt(solution.solved.decisions, solution.values)
    H = H if more is None else H + sp.triu(more.T @ more)
    terms = solution.transcription.nlp.terms
    return _made(solution, H, J, d, np.concatenate([np.full(t.target.size, True) for t in terms if t.equality or t.heavy] or [_NONE]))


def newton(solution: Solution) -> Kkt:
    """The matrix with the exact second derivatives."""
    J = solution.solver.jacobian(solution.solved.decisions, solution.values)
    terms = solution.transcription.nlp.terms
    there = np.concatenate([np.full(t.target.size, t.equality) for t in terms if t.equality or t.heavy] or [_NONE])
    return _made(solution, solution.solver.exact_hessian(solution.solved, solution.values), J, np.zeros(J.shape[0]), there)


def sensitivity(solution: Solution, pulls: Array) -> Array:
    """How every unknown moves with log std of every weight, (n + np, F), in the model's units; pulls (n + np, F) in the program's."""
    return np.asarray(solution.values.unit[:, None] * newton(solution).solve(2.0 * pulls), dtype=np.float64)


_NONE = np.empty(0, dtype=bool)


def _scaled(matrix: sp.csc_matrix, size: Any) -> sp.csc_matrix:
    return sp.csc_matrix(sp.diags(size) @ matrix @ sp.diags(size))


def _made(solution: Solution, upper: sp.csc_matrix, J: sp.csc_matrix, d: Any, there: Any) -> Kkt:
    """there: which of the multipliers that a program may have the matrix has."""
    free: Any = np.ones(upper.shape[0])
    free[solution.held] = 0.0
    keep = sp.diags(free)
    H = keep @ (upper + sp.triu(upper, 1).T) @ keep + sp.diags(1.0 - free)
    K = sp.csc_matrix(sp.bmat([[H, keep @ J.T], [J @ keep, -sp.diags(d)]]) if J.shape[0] else H)
    at = arrange(solution.transcription.nlp)
    own = np.concatenate([np.ones(len(free), dtype=bool), there])
    block, place = at.block[own], at.place[own]
    inner = np.flatnonzero(block >= 0)
    return Kkt(K, free, inner[np.lexsort((place[inner], block[inner]))], np.flatnonzero(block < 0))
