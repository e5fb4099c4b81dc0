"""Solves with a matrix whose border is eliminated last, against dense ones."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from backsight.estimation.weighing.kkt import Kkt
from backsight.models import SolveError


def matrix(corner: float) -> Kkt:
    """A band of four unknowns, and a border of two."""
    rng = np.random.default_rng(3)
    A = np.diag([4.0, 5.0, 6.0, 7.0, 3.0, corner]) + 0.1 * rng.standard_normal((6, 6))
    return Kkt(matrix=sp.csc_matrix(A + A.T), free=np.ones(6), inner=np.arange(4), border=np.array([4, 5]))


def test_columns_are_solved_as_a_dense_solve_has_them():
    kkt, right = matrix(2.0), np.random.default_rng(4).standard_normal((6, 3))
    assert kkt.solved(right) == pytest.approx(np.linalg.solve(kkt.matrix.toarray(), right), rel=1e-10)


@pytest.mark.parametrize("corner", [np.nan, np.inf])
def test_a_matrix_without_numbers_is_no_fault_of_the_linear_algebra(corner):
    with pytest.raises(SolveError, match="not finite"):
        matrix(corner).solved(np.ones((6, 1)))
