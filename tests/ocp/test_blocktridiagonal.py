"""Block-tridiagonal algebra against numpy's dense one."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.ocp.blocktridiagonal import BlockTridiagonal, factor

ALL = slice(0, None)


def blocks(count: int, size: int, *, definite: bool, knot: slice = ALL, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Diagonal and lower blocks of a random symmetric matrix, and the matrix."""
    rng = np.random.default_rng([seed, count, size])
    diagonal, lower = rng.normal(size=(count, size, size)), np.zeros((count - 1, size, size))
    lower[:, :, knot] = rng.normal(size=lower[:, :, knot].shape)
    diagonal = diagonal + np.swapaxes(diagonal, 1, 2)
    if definite:
        diagonal += (6 * size + 6) * np.eye(size)
    dense = np.zeros((count * size, count * size))
    for k in range(count):
        dense[k * size : (k + 1) * size, k * size : (k + 1) * size] = diagonal[k]
        if k + 1 < count:
            dense[(k + 1) * size : (k + 2) * size, k * size : (k + 1) * size] = lower[k]
            dense[k * size : (k + 1) * size, (k + 1) * size : (k + 2) * size] = lower[k].T
    return diagonal, lower[:, :, knot], dense


@pytest.mark.parametrize("definite", [True, False], ids=["definite", "indefinite"])
@pytest.mark.parametrize(("size", "knot"), [(1, ALL), (3, ALL), (3, slice(1, 2)), (5, slice(2, 4))])
@pytest.mark.parametrize("count", range(1, 18))
def test_solve_determinant_inertia_and_inverse_are_the_dense_ones(count, size, knot, definite):
    diagonal, lower, dense = blocks(count, size, definite=definite, knot=knot)
    tree = factor(diagonal, lower, knot)
    inverse = np.linalg.inv(dense)
    rhs = np.random.default_rng(1).normal(size=(count, size, 2))
    tolerance = 1e-13 * np.linalg.cond(dense) ** 2 + 1e-12
    scale = np.abs(inverse).max()
    np.testing.assert_allclose(tree.solve(rhs).reshape(-1, 2), inverse @ rhs.reshape(-1, 2), atol=tolerance * scale * 10)
    on_diagonal, below = tree.inverse_blocks()
    assert on_diagonal.shape == (count, size, size)
    assert below.shape == lower.shape
    whole = inverse.reshape(count, size, count, size)
    for k in range(count):
        np.testing.assert_allclose(on_diagonal[k], whole[k, :, k], atol=tolerance * scale)
        if k + 1 < count:
            np.testing.assert_allclose(below[k], whole[k + 1, :, k, knot], atol=tolerance * scale)
    assert tree.log_abs_determinant == pytest.approx(np.linalg.slogdet(dense)[1], abs=1e-9)
    assert tree.negative_eigenvalues == np.sum(np.linalg.eigvalsh(dense) < 0)


def test_a_singular_block_is_refused():
    diagonal, lower, _ = blocks(4, 2, definite=True)
    diagonal[1] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        factor(diagonal, lower, ALL)


def test_a_block_that_is_not_finite_is_refused():
    diagonal, lower, _ = blocks(3, 2, definite=True)
    diagonal[0, 0, 0] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        factor(diagonal, lower, ALL)


@pytest.mark.filterwarnings("error")
def test_an_elimination_that_goes_beyond_all_numbers_is_refused_without_a_warning():
    diagonal, lower, _ = blocks(4, 2, definite=True)
    diagonal[1] = 1e-200 * np.eye(2)
    lower[:] *= 1e100
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        factor(diagonal, lower, ALL)


def test_the_factor_leaves_its_arguments_alone():
    diagonal, lower, _ = blocks(5, 2, definite=False)
    before = diagonal.copy(), lower.copy()
    tree = factor(diagonal, lower, ALL)
    rhs = np.ones((5, 2, 1))
    tree.solve(rhs)
    tree.inverse_blocks()
    assert np.array_equal(diagonal, before[0])
    assert np.array_equal(lower, before[1])
    assert np.all(rhs == 1.0)


def test_a_block_that_rounding_makes_singular_costs_the_determinant_alone():
    diagonal, lower, _ = blocks(1, 2, definite=True)
    tree = factor(diagonal, lower, ALL)
    rounded = BlockTridiagonal(tree.levels, tree.root, (np.zeros((1, 2, 2)),), ALL)
    assert rounded.log_abs_determinant == -np.inf
    np.testing.assert_array_equal(rounded.solve(np.ones((1, 2, 1))), tree.solve(np.ones((1, 2, 1))))
    with pytest.raises(np.linalg.LinAlgError):
        _ = rounded.negative_eigenvalues
