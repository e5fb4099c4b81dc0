"""Block-tridiagonal algebra against numpy's dense one."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.ocp.blocktridiagonal import BlockTridiagonal, factor


def blocks(count: int, size: int, *, definite: bool, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Diagonal and lower blocks of a random symmetric matrix, and the matrix."""
    rng = np.random.default_rng([seed, count, size])
    diagonal, lower = rng.normal(size=(count, size, size)), rng.normal(size=(count - 1, size, size))
    diagonal = diagonal + np.swapaxes(diagonal, 1, 2)
    if definite:
        diagonal += (6 * size + 6) * np.eye(size)
    dense = np.zeros((count * size, count * size))
    for k in range(count):
        dense[k * size : (k + 1) * size, k * size : (k + 1) * size] = diagonal[k]
        if k + 1 < count:
            dense[(k + 1) * size : (k + 2) * size, k * size : (k + 1) * size] = lower[k]
            dense[k * size : (k + 1) * size, (k + 1) * size : (k + 2) * size] = lower[k].T
    return diagonal, lower, dense


@pytest.mark.parametrize("definite", [True, False], ids=["definite", "indefinite"])
@pytest.mark.parametrize("size", [1, 3])
@pytest.mark.parametrize("count", range(1, 18))
def test_solve_determinant_inertia_and_inverse_are_the_dense_ones(count, size, definite):
    diagonal, lower, dense = blocks(count, size, definite=definite)
    tree = factor(diagonal, lower)
    inverse = np.linalg.inv(dense)
    rhs = np.random.default_rng(1).normal(size=(count, size, 2))
    tolerance = 1e-13 * np.linalg.cond(dense) ** 2 + 1e-12
    scale = np.abs(inverse).max()
    np.testing.assert_allclose(tree.solve(rhs).reshape(-1, 2), inverse @ rhs.reshape(-1, 2), atol=tolerance * scale * 10)
    on_diagonal, below = tree.inverse_blocks()
    assert on_diagonal.shape == (count, size, size)
    assert below.shape == (count - 1, size, size)
    whole = inverse.reshape(count, size, count, size)
    for k in range(count):
        np.testing.assert_allclose(on_diagonal[k], whole[k, :, k], atol=tolerance * scale)
        if k + 1 < count:
            np.testing.assert_allclose(below[k], whole[k + 1, :, k], atol=tolerance * scale)
    assert tree.log_abs_determinant == pytest.approx(np.linalg.slogdet(dense)[1], abs=1e-9)
    assert tree.negative_eigenvalues == np.sum(np.linalg.eigvalsh(dense) < 0)


def test_a_singular_block_is_refused():
    diagonal, lower, _ = blocks(4, 2, definite=True)
    diagonal[1] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        factor(diagonal, lower)


def test_a_block_that_is_not_finite_is_refused():
    diagonal, lower, _ = blocks(3, 2, definite=True)
    diagonal[0, 0, 0] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        factor(diagonal, lower)


def test_the_factor_leaves_its_arguments_alone():
    diagonal, lower, _ = blocks(5, 2, definite=False)
    before = diagonal.copy(), lower.copy()
    tree = factor(diagonal, lower)
    rhs = np.ones((5, 2, 1))
    tree.solve(rhs)
    tree.inverse_blocks()
    assert np.array_equal(diagonal, before[0])
    assert np.array_equal(lower, before[1])
    assert np.all(rhs == 1.0)


def test_a_block_that_rounding_makes_singular_costs_the_determinant_alone():
    diagonal, lower, _ = blocks(1, 2, definite=True)
    tree = factor(diagonal, lower)
    rounded = BlockTridiagonal(tree.levels, tree.root, (np.zeros((1, 2, 2)),))
    assert rounded.log_abs_determinant == -np.inf
    np.testing.assert_array_equal(rounded.solve(np.ones((1, 2, 1))), tree.solve(np.ones((1, 2, 1))))
    with pytest.raises(np.linalg.LinAlgError):
        _ = rounded.negative_eigenvalues
