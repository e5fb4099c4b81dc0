"""The KKT matrix of a solution: solves with it, how well conditioned it is, and what every weight does to every estimate.

With g_f = J_f'r_f the pull of the rows of weight f, theta_f the logarithm of its standard deviation, K the matrix with the exact Hessian
of the Lagrangian, differentiating the conditions of optimality gives

    K [dX/dtheta_f; .]  =  [2 g_f; 0]

for the reference p_ref of the program held, as a solve holds it, and bounds that hold what they hold now.
(Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU, onenormest, splu

from backsight.ocp import Solution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True)
class Kkt:
    """[H J'; J -diag(d)], factored, over the unknowns that can move."""

    matrix: sp.csc_matrix
    factor: SuperLU
    free: Array

    def solve(self, g: Array) -> Array:
        """The upper part of K^-1 [g; 0] for columns g (n + np, m) in the program's units; zero for what is held."""
        right = np.zeros((self.matrix.shape[0], g.shape[1]))
        right[: len(self.free)] = self.free[:, None] * g
        return np.asarray(self.factor.solve(right)[: len(self.free)], dtype=np.float64)

    @property
    def condition(self) -> float:
        """Condition number in the 1-norm, after every row and column was given a largest entry near one (Higham & Tisseur 2000)."""
        size = np.ones(self.matrix.shape[0])
        for _ in range(SWEEPS):
            largest = abs(_scaled(self.matrix, size)).max(axis=1).toarray().ravel()
            size = size / np.sqrt(np.where(largest > 0, largest, 1.0))
        K = _scaled(self.matrix, size)

        def inverse(v: Array) -> Array:
            return np.asarray(self.factor.solve(np.ravel(v) / size) / size, dtype=np.float64)

        operator = LinearOperator(K.shape, matvec=inverse, rmatvec=inverse, dtype=np.float64)
        return float(abs(K).sum(axis=0).max() * onenormest(operator))


SWEEPS = 6  # each halves the decades by which the largest entries of rows differ


def gauss_newton(solution: Solution) -> Kkt:
    """The matrix of the least-squares steps, which is that of the covariances."""
    return _factored(solution, *solution.solver.kkt(solution.solved.decisions, solution.values))


def newton(solution: Solution) -> Kkt:
    """The matrix with the exact second derivatives."""
    J = solution.solver.jacobian(solution.solved.decisions, solution.values)
    return _factored(solution, solution.solver.exact_hessian(solution.solved, solution.values), J, np.zeros(J.shape[0]))


def sensitivity(solution: Solution, pulls: Array) -> Array:
    """How every unknown moves with log std of every weight, (n + np, F), in the model's units; pulls (n + np, F) in the program's."""
    return np.asarray(solution.values.unit[:, None] * newton(solution).solve(2.0 * pulls), dtype=np.float64)


def _scaled(matrix: sp.csc_matrix, size: Any) -> sp.csc_matrix:
    return sp.csc_matrix(sp.diags(size) @ matrix @ sp.diags(size))


def _factored(solution: Solution, upper: sp.csc_matrix, J: sp.csc_matrix, d: Array) -> Kkt:
    free: Any = np.ones(upper.shape[0])
    free[solution.held] = 0.0
    keep = sp.diags(free)
    H = keep @ (upper + sp.triu(upper, 1).T) @ keep + sp.diags(1.0 - free)
    softness: Any = d
    K = sp.csc_matrix(sp.bmat([[H, keep @ J.T], [J @ keep, -sp.diags(softness)]]) if J.shape[0] else H)
    return Kkt(K, splu(K), free)
