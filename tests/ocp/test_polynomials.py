"""Points, weights and bases."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from backsight.ocp.polynomials import cardinal_basis, gauss, hermite_basis, lagrange_basis, legendre, radau, radau_weights

DEGREES = range(1, 6)
# Abramowitz & Stegun, table 25.4, moved to [0, 1]; Hairer & Wanner II, table IV.5.6 (Radau IIA)
GAUSS = {1: [0.5], 2: [0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6], 3: [0.5 - np.sqrt(15) / 10, 0.5, 0.5 + np.sqrt(15) / 10]}
GAUSS_WEIGHTS = {1: [1.0], 2: [0.5, 0.5], 3: [5 / 18, 8 / 18, 5 / 18]}
RADAU = {1: [1.0], 2: [1 / 3, 1.0], 3: [(4 - np.sqrt(6)) / 10, (4 + np.sqrt(6)) / 10, 1.0]}
RADAU_WEIGHTS = {1: [1.0], 2: [3 / 4, 1 / 4], 3: [(16 - np.sqrt(6)) / 36, (16 + np.sqrt(6)) / 36, 1 / 9]}


def highest_exact_degree(tau, weight) -> int:
    """The degree up to which sum of weight tau^p is 1/(p + 1)."""
    p = 0
    while abs(weight @ tau**p - 1 / (p + 1)) < 1e-13:
        p += 1
    return p - 1


@pytest.mark.parametrize("count", [1, 2, 3])
def test_gauss_and_radau_points_and_weights_are_the_tabulated_ones(count):
    tau, weight = gauss(count)
    np.testing.assert_allclose(tau, GAUSS[count], atol=1e-15)
    np.testing.assert_allclose(weight, GAUSS_WEIGHTS[count], atol=1e-15)
    np.testing.assert_allclose(radau(count), RADAU[count], atol=1e-15)
    np.testing.assert_allclose(radau_weights(count), RADAU_WEIGHTS[count], atol=1e-15)


@pytest.mark.parametrize("count", DEGREES)
def test_gauss_is_exact_to_degree_2k_minus_1_and_radau_to_2k_minus_2_and_not_beyond(count):
    assert highest_exact_degree(*gauss(count)) == 2 * count - 1
    assert highest_exact_degree(radau(count), radau_weights(count)) == 2 * count - 2
    assert radau(count)[-1] == 1.0
    assert np.all(np.diff(radau(count)) > 0)
    assert radau(count)[0] > 0


def test_legendre_polynomials_are_orthonormal_by_a_fine_sum():
    n = 20_000
    tau = (np.arange(n) + 0.5) / n
    L = legendre(5, tau)
    np.testing.assert_allclose(L @ L.T / n, np.eye(5), atol=1e-7)
    np.testing.assert_allclose(L[0], 1.0)
    np.testing.assert_allclose(L[1], np.sqrt(3) * (2 * tau - 1))


@pytest.mark.parametrize("degree", [3, 4, 5, 6])
def test_hermite_basis_has_one_corner_each_and_bubbles_vanish_doubly_at_both_ends(degree):
    basis = hermite_basis(degree)
    corners = np.array([[p(0.0), p.deriv()(0.0), p(1.0), p.deriv()(1.0)] for p in basis])
    np.testing.assert_allclose(corners, np.eye(len(basis), 4), atol=1e-13)
    assert len(basis) == degree + 1
    assert spans_all_polynomials(basis, degree)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_lagrange_basis_has_one_end_each_and_bubbles_vanish_at_both(degree):
    basis = lagrange_basis(degree)
    np.testing.assert_allclose(np.array([[p(0.0), p(1.0)] for p in basis]), np.eye(len(basis), 2), atol=1e-13)
    assert len(basis) == degree + 1
    assert spans_all_polynomials(basis, degree)


@pytest.mark.parametrize("count", DEGREES)
def test_cardinal_polynomials_are_one_at_their_node_and_zero_at_the_others(count):
    nodes = np.concatenate([[0.0], radau(count)])
    np.testing.assert_allclose([p(nodes) for p in cardinal_basis(nodes)], np.eye(count + 1), atol=1e-12)


def spans_all_polynomials(basis: tuple[Polynomial, ...], degree: int) -> bool:
    """Whether these are degree + 1 independent polynomials of that degree at most, and not nearly dependent."""
    tau = np.linspace(0, 1, 50)
    values = np.array([p(tau) for p in basis])
    return all(p.degree() <= degree for p in basis) and np.linalg.cond(values) < 1e4
