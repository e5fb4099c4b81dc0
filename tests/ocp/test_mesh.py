"""Knots, where times fall among them, and quadrature that respects the breaks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backsight.ocp import Mesh, mesh_over
from backsight.ocp.mesh import quadrature
from backsight.ocp.polynomials import gauss

INTERVALS = st.lists(st.floats(0.01, 3.0), min_size=1, max_size=30)


@pytest.mark.parametrize("knots", [[0.0], [[0.0, 1.0]], [0.0, 0.0, 1.0], [1.0, 0.0], [0.0, np.nan], [0.0, np.inf]])
def test_knots_that_are_no_mesh_are_refused(knots):
    with pytest.raises(ValueError, match=r"Mesh\(knots=\.\.\.\) needs at least two finite, strictly increasing times; got"):
        Mesh(np.array(knots))


def test_a_mesh_cannot_be_changed_from_outside():
    knots = np.array([0.0, 1.0, 2.0])
    mesh = Mesh(knots)
    knots[1] = 1.5
    assert mesh.knots.tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        mesh.knots[0] = -1.0


@given(INTERVALS, st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=50)
def test_every_time_is_found_in_the_interval_that_holds_it(widths, seed):
    mesh = Mesh(np.concatenate([[0.0], np.cumsum(widths)]))
    times = np.random.default_rng(seed).uniform(0.0, mesh.knots[-1], 40)
    interval, tau = mesh.locate(times)
    assert np.all((interval >= 0) & (interval < mesh.count))
    assert np.all((tau >= 0) & (tau <= 1))
    np.testing.assert_allclose(mesh.knots[interval] + tau * mesh.steps[interval], times, rtol=1e-12, atol=1e-12)


def test_a_knot_belongs_to_the_interval_it_opens_and_the_last_one_to_the_last():
    interval, tau = Mesh(np.array([0.0, 1.0, 3.0])).locate(np.array([0.0, 1.0, 3.0, 2.0]))
    assert interval.tolist() == [0, 1, 1, 1]
    assert tau.tolist() == [0.0, 0.0, 1.0, 0.5]


def test_refining_halves_every_interval():
    assert Mesh(np.array([0.0, 1.0, 3.0])).refined().knots.tolist() == [0.0, 0.5, 1.0, 2.0, 3.0]


@given(st.integers(2, 200), st.floats(0.0, 0.45), st.floats(0.3, 8.0), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=100)
def test_a_mesh_over_jittered_samples_spans_them_with_knots_about_a_step_apart(count, jitter, step, seed):
    rng = np.random.default_rng(seed)
    times = np.arange(count) + jitter * rng.uniform(-1, 1, count)
    mesh = mesh_over(times, step)
    assert (mesh.knots[0], mesh.knots[-1]) == (times[0], times[-1])
    even = (times[-1] - times[0]) / mesh.count
    assert 0.6 < even / min(step, times[-1] - times[0]) < 1.7
    assert np.all(mesh.steps > 0.09 * even)
    assert np.all(mesh.steps < 1.91 * even)


def test_the_lengths_stay_within_what_is_promised():
    """Two samples close to the middle between two places where a knot would like to be."""
    times = np.array([0.0, 0.5, 1.44, 1.56, 2.5, 3.0])
    steps = mesh_over(times, 1.0).steps
    assert np.all((steps >= 0.09) & (steps <= 1.91)), steps


def test_knots_lie_on_samples_where_they_can_and_a_gap_is_divided_evenly():
    times = np.concatenate([np.arange(0.0, 1.05, 0.1), np.arange(5.0, 6.05, 0.1)])
    mesh = mesh_over(times, 0.5)
    outside = [k for k in mesh.knots if (k < 1.01 or k > 4.99) and not np.any(k == times)]
    assert outside == []
    inner = mesh.knots[(mesh.knots > 1.3) & (mesh.knots < 4.7)]
    assert len(inner) >= 6
    np.testing.assert_allclose(np.diff(inner), 0.5, rtol=0.05)


def test_one_interval_is_enough_for_two_samples():
    assert mesh_over(np.array([0.0, 1.0]), 7.0).knots.tolist() == [0.0, 1.0]


def test_clock_that_counts_from_1970_keeps_its_knots_apart():
    times = 1.7e9 + np.arange(200) * 1e-3
    mesh = mesh_over(times, 5e-3)
    assert mesh.count == 40
    assert np.isin(mesh.knots, times).all()


@pytest.mark.parametrize("points", [1, 2, 3, 4])
@given(widths=INTERVALS, inner=st.lists(st.floats(0.001, 0.999), max_size=20), seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=25)
def test_what_is_a_polynomial_between_breaks_is_integrated_exactly(points, widths, inner, seed):
    mesh = Mesh(np.concatenate([[0.0], np.cumsum(widths)]))
    end = float(mesh.knots[-1])
    breaks = np.unique(np.array([-1.0, *(end * np.array(inner)), end + 1.0]))
    edges = np.unique(np.concatenate([mesh.knots, breaks[1:-1]]))
    q = quadrature(mesh, breaks, gauss(points))
    coefficients = np.random.default_rng(seed).normal(size=(len(edges) - 1, 2 * points))
    powers = np.arange(2 * points)
    cell = np.clip(np.searchsorted(edges, q.time) - 1, 0, len(edges) - 2)
    value = q.weight @ np.sum(coefficients[cell] * (q.time - edges[cell])[:, None] ** powers, axis=1)
    exact = np.sum(coefficients * np.diff(edges)[:, None] ** (powers + 1) / (powers + 1))
    assert value == pytest.approx(exact, rel=1e-9, abs=1e-9 * np.abs(coefficients).max() * max(1.0, max(widths)) ** (2 * points) * end)
    np.testing.assert_allclose(mesh.knots[q.interval] + q.tau * mesh.steps[q.interval], q.time, atol=1e-12 * end)


def test_a_break_that_is_a_knot_but_for_rounding_makes_no_cell_of_its_own():
    mesh = Mesh(np.array([0.0, 0.1 + 0.2, 1.0]))
    q = quadrature(mesh, np.array([0.0, 0.3, 0.6, 1.0]), gauss(2))
    assert len(q.weight) == 2 * 3
    assert q.weight.sum() == pytest.approx(1.0, rel=1e-15)
    assert q.interval.tolist() == [0, 0, 1, 1, 1, 1]
