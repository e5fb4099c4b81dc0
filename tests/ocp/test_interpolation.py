"""The map from local unknowns to variables: continuity, counts, and derivatives that are derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from truths import differences

from backsight.ocp.interpolation import Interpolation, collocation_interpolation, local_index, spline_interpolation
from backsight.ocp.polynomials import radau

# states (a, s, v) with s' = v; one algebraic variable; for collocation two residual forces
SPLINES = [spline_interpolation(d, 3, 1, [(1, 2)]) for d in (2, 3, 4, 5)]
COLLOCATIONS = [collocation_interpolation(d, 3, 1, 2) for d in (2, 3, 4)]
BOTH = [*SPLINES, *COLLOCATIONS]


def at(ip: Interpolation, local: np.ndarray, tau: float, h: float) -> np.ndarray:
    return ip.apply(ip.values(np.array([tau]), np.array([h])), local[:, None])[:, 0]


@pytest.mark.parametrize("ip", BOTH, ids=lambda ip: f"{ip.interior} interior")
def test_the_ends_of_the_states_are_the_outer_unknowns(ip):
    local, h = np.random.default_rng(0).normal(size=ip.local), 0.3
    np.testing.assert_allclose(at(ip, local, 0.0, h)[3:6], local[:3], atol=1e-12)
    np.testing.assert_allclose(at(ip, local, 1.0, h)[3:6], local[-3:], atol=1e-12)


@pytest.mark.parametrize("ip", BOTH, ids=lambda ip: f"{ip.interior} interior")
def test_the_rates_are_the_derivatives_of_the_states(ip):
    local, h = np.random.default_rng(1).normal(size=ip.local), 0.3
    for tau in (0.2, 0.5, 0.9):
        slope = differences(lambda t: at(ip, local, t[0], h)[3:6], np.array([tau]))[:, 0] / h
        np.testing.assert_allclose(at(ip, local, tau, h)[:3], slope, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("ip", SPLINES, ids=lambda ip: f"{ip.interior} interior")
def test_in_a_spline_the_velocity_is_the_derivative_of_its_position(ip):
    local = np.random.default_rng(2).normal(size=ip.local)
    for tau in (0.0, 0.3, 1.0):
        v = at(ip, local, tau, 0.7)
        assert v[1] == pytest.approx(v[5], rel=1e-12)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_splines_bring_k_unknowns_an_interval_for_every_equation(degree):
    ip = spline_interpolation(degree, 3, 1, [(1, 2)])
    # a balance, a law of first order, an algebraic equation: K moments each; the kinematics are exact
    assert ip.states + ip.interior == 3 * degree


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_collocation_passes_through_its_values_at_the_radau_points(degree):
    ip = collocation_interpolation(degree, 3, 1, 2)
    assert ip.states + ip.interior == degree * (3 + 1 + 2)
    local = np.random.default_rng(3).normal(size=ip.local)
    inner = local[3 : 3 * degree].reshape(degree - 1, 3)
    z = local[3 * degree : 4 * degree]
    w = local[4 * degree : 6 * degree].reshape(degree, 2)
    for k, tau in enumerate(radau(degree)):
        v = at(ip, local, tau, 0.4)
        np.testing.assert_allclose(v[3:6], inner[k] if k < degree - 1 else local[-3:], atol=1e-12)
        np.testing.assert_allclose(v[6:], [z[k], *w[k]], atol=1e-12)


@pytest.mark.parametrize("ip", BOTH, ids=lambda ip: f"{ip.interior} interior")
def test_applying_and_multiplying_by_the_matrix_are_the_same(ip):
    rng = np.random.default_rng(4)
    tau, h, local = rng.uniform(size=6), rng.uniform(0.1, 1.0, 6), rng.normal(size=(ip.local, 6))
    values = ip.values(tau, h)
    np.testing.assert_allclose(ip.apply(values, local), np.einsum("nij,jn->in", ip.matrix(values), local), atol=1e-11)


def test_neighbouring_intervals_share_the_knot_between_them():
    ip = SPLINES[1]
    index, end = local_index(4, ip, start=10)
    assert index[0, 0] == 10
    assert end == index.max() + 1
    assert np.array_equal(index[-3:, :-1], index[:3, 1:])
    assert len(np.unique(index)) == end - 10
