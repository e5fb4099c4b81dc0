"""Held inputs between the samples: their moments, what a polynomial leaves out of them, and knots at their steps."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import eval_legendre

from backsight.ocp import Horizon, Mesh
from backsight.ocp.polynomials import gauss, radau


def horizon(seed: int = 0, hold: str = "zero", n: int = 30, intervals: int = 7, nu: int = 2) -> Horizon:
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 1.0, n))
    knots = np.sort(np.concatenate([[time[0], time[-1]], rng.uniform(time[0], time[-1], intervals - 1)]))
    nothing = np.zeros((n, 1))
    return Horizon(
        mesh=Mesh(knots),
        time=time,
        inputs=rng.normal(size=(n, nu)),
        target=nothing,
        target_std=nothing + 1,
        initial=np.zeros(1),
        initial_std=np.ones(1),
        hold=hold,
    )


def held(h: Horizon, i: int, t: np.ndarray) -> np.ndarray:
    """The input by the words of the docstring, one time after the other."""
    out = []
    for now in t:
        k = max(k for k in range(len(h.time)) if h.time[k] <= now)
        if h.hold == "zero" or k == len(h.time) - 1:
            out.append(h.inputs[k, i])
        else:
            share = (now - h.time[k]) / (h.time[k + 1] - h.time[k])
            out.append((1 - share) * h.inputs[k, i] + share * h.inputs[k + 1, i])
    return np.array(out)


def integral(h: Horizon, i: int, a: float, b: float, weight) -> float:
    """Of weight(t) u_i(t) over [a, b], piece by piece between the samples by 8 Gauss points."""
    x, w = np.polynomial.legendre.leggauss(8)
    edges = np.unique(np.concatenate([[a, b], h.time[(h.time > a) & (h.time < b)]]))
    total = 0.0
    for left, right in pairwise(edges):
        t = left + (right - left) * (x + 1) / 2
        total += (right - left) / 2 * w @ (held(h, i, t) * weight(t))
    return total


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_the_input_is_held_as_the_rows_say(hold):
    h = horizon(hold=hold)
    times = np.concatenate([h.time, np.random.default_rng(1).uniform(h.time[0], h.time[-1], 50)])
    np.testing.assert_allclose(h.input_at(times), [held(h, i, times) for i in range(2)], atol=1e-12)


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_the_projected_input_is_a_polynomial_with_the_exact_moments(hold, degree):
    h = horizon(hold=hold)
    places = gauss(degree + 3)[0]
    values = h.projected_input(degree, places).reshape(2, h.mesh.count, len(places))
    for k in range(h.mesh.count):
        a, width = h.mesh.knots[k], h.mesh.steps[k]
        for i in range(2):
            fitted = np.polynomial.Polynomial.fit(places, values[i, k], degree - 1, domain=[0, 1], window=[0, 1])
            np.testing.assert_allclose(fitted(places), values[i, k], atol=1e-10)
            x, w = gauss(8)
            for j in range(degree):
                truth = integral(h, i, a, a + width, lambda t, a=a, width=width, j=j: eval_legendre(j, 2 * (t - a) / width - 1)) / width
                assert w @ (fitted(x) * eval_legendre(j, 2 * x - 1)) == pytest.approx(truth, abs=1e-10)


@pytest.mark.parametrize(("degree", "hold"), [(1, "zero"), (2, "zero"), (2, "linear"), (3, "zero"), (3, "linear")])
def test_unresolved_integrals_are_those_of_the_input_less_its_projection(degree, hold):
    h = horizon(seed=3, hold=hold)
    first, second = h.unresolved_integrals(degree)
    places = gauss(degree)[0]
    projected = h.projected_input(degree, places).reshape(2, h.mesh.count, degree)
    for k, now in enumerate(h.time):
        interval = min(int(np.searchsorted(h.mesh.knots, now, side="right")) - 1, h.mesh.count - 1)
        a, width = h.mesh.knots[interval], h.mesh.steps[interval]
        for i in range(2):
            p = np.polynomial.Polynomial.fit(a + width * places, projected[i, interval], degree - 1)
            lever = np.polynomial.Polynomial([now, -1.0])
            expected = [
                integral(h, i, a, now, np.ones_like) - area(p, a, now),
                integral(h, i, a, now, lever) - area(lever * p.convert(), a, now),
            ]
            if now in h.mesh.knots:
                expected = [0.0, 0.0]  # there the polynomial's own value counts
            assert [first[i, k], second[i, k]] == pytest.approx(expected, abs=1e-12)


def area(p: np.polynomial.Polynomial, a: float, b: float) -> float:
    whole = p.integ()
    return float(whole(b) - whole(a))


def test_a_constant_input_leaves_nothing_unresolved_and_a_linear_one_nothing_from_degree_two_on():
    h = horizon()
    flat = replace(h, inputs=np.ones_like(h.inputs))
    ramp = replace(h, inputs=np.column_stack([h.time, 2 * h.time]), hold="linear")
    for quiet, degree in ((flat, 1), (ramp, 2)):
        assert np.abs(quiet.unresolved_impulse(degree)).max() < 1e-14
        assert max(np.abs(v).max() for v in quiet.unresolved_integrals(degree)) < 1e-14
    assert np.abs(ramp.unresolved_impulse(1)).max() > 1e-4


def test_the_unresolved_impulse_is_the_largest_seen_at_the_ends_of_the_pieces():
    h = horizon(seed=5)
    impulse, (first, _) = h.unresolved_impulse(2), h.unresolved_integrals(2)
    owner = h.mesh.locate(h.time)[0]
    for i in range(2):
        largest = [np.abs(first[i, owner == k]).max(initial=0.0) for k in range(h.mesh.count)]
        np.testing.assert_allclose(impulse[i], largest, atol=1e-12)


def test_a_knot_comes_where_the_input_steps_most_and_only_where_it_is_asked_for():
    time = np.linspace(0.0, 1.0, 11)
    inputs = np.array([0, 0, 1, 1, 9, 9, 9, 3, 3, 3.5, 3.5])[:, None].astype(float)
    h = replace(horizon(n=11, nu=1), mesh=Mesh(np.array([0.0, 0.5, 1.0])), time=time, inputs=inputs)
    np.testing.assert_allclose(h.split_at_steps(np.array([True, False])).mesh.knots, [0.0, 0.4, 0.5, 1.0])
    np.testing.assert_allclose(h.split_at_steps(np.array([True, True])).mesh.knots, [0.0, 0.4, 0.5, 0.7, 1.0])
    assert h.split_at_steps(np.array([False, False])).mesh.count == 2
    flat = replace(h, inputs=np.ones_like(inputs))
    assert flat.split_at_steps(np.array([True, True])).mesh.count == 2


def test_a_step_at_the_last_sample_acts_on_nothing_and_keeps_no_other_step_from_its_knot():
    time = np.linspace(0.0, 1.0, 11)
    inputs = np.array([0, 0, 0, 0, 0, 0, 0, 3, 3, 3, 50])[:, None].astype(float)
    h = replace(horizon(n=11, nu=1), mesh=Mesh(np.array([0.0, 0.5, 1.0])), time=time, inputs=inputs)
    np.testing.assert_allclose(h.split_at_steps(np.array([True, True])).mesh.knots, [0.0, 0.5, 0.7, 1.0])


def test_splitting_again_and_again_ends_with_every_step_on_a_knot():
    h = horizon(seed=2, n=12, intervals=3)
    for _ in range(30):
        h = h.split_at_steps(np.ones(h.mesh.count, dtype=bool))
    assert np.isin(h.time, h.mesh.knots).all()
    assert np.abs(h.unresolved_impulse(1)).max() < 1e-14


def test_point_data_holds_the_projected_inputs_and_the_times():
    h, tau = horizon(), radau(3)
    data = h.point_data(3, tau)
    assert data.shape == (3, h.mesh.count * 3)
    np.testing.assert_allclose(data[:2], h.projected_input(3, tau))
    np.testing.assert_allclose(data[2].reshape(-1, 3)[:, -1], h.mesh.knots[1:])


@pytest.mark.parametrize("name", ["inputs", "target", "target_std"])
def test_arrays_of_another_length_are_refused(name):
    with pytest.raises(ValueError, match=rf"Horizon\({name}=\.\.\.\) needs one row per sample: got 29 for 30 times\."):
        replace(horizon(), **{name: np.zeros((29, 1))})


def test_a_mesh_that_does_not_span_the_samples_is_refused():
    h = horizon()
    with pytest.raises(ValueError, match=r"Horizon\(mesh=\.\.\.\) must span the samples\."):
        replace(h, mesh=Mesh(np.array([h.time[0], h.time[-2]])))
    with pytest.raises(ValueError, match=r"Horizon\(mesh=\.\.\.\) must span the samples\."):
        replace(h, mesh=Mesh(np.array([h.time[1], h.time[-1]])))


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_what_the_projection_leaves_of_the_input_at_the_samples_is_their_difference(hold, degree):
    h = horizon(hold=hold)
    interval, tau = h.mesh.locate(h.time)
    found = h.unresolved_input(degree)
    for i in range(2):
        for k in range(h.mesh.count):
            here = np.flatnonzero(interval == k)
            a, width = h.mesh.knots[k], h.mesh.steps[k]
            projected = np.zeros(len(here))
            for j in range(degree):
                moment = integral(h, i, a, a + width, lambda t, j=j, a=a, width=width: eval_legendre(j, 2 * (t - a) / width - 1)) / width
                projected += (2 * j + 1) * moment * eval_legendre(j, 2 * tau[here] - 1)
            np.testing.assert_allclose(found[i, here], held(h, i, h.time[here]) - projected, atol=1e-9)
            assert h.unresolved_step(degree)[i, k] == pytest.approx(np.max(np.abs(found[i, here]), initial=0.0))


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_fewer_samples_leave_what_the_input_does_between_them(hold):
    whole = horizon(hold=hold)
    rows = np.array([0, 4, 5, 13, 22, 29])
    thin = replace(
        whole, time=whole.time[rows], target=whole.target[rows], target_std=whole.target_std[rows], drive_time=whole.time
    )  # fmt: skip
    np.testing.assert_array_equal(thin.projected_input(2, gauss(2)[0]), whole.projected_input(2, gauss(2)[0]))
    np.testing.assert_array_equal(thin.unresolved_step(2), whole.unresolved_step(2))
    np.testing.assert_array_equal(thin.unresolved_impulse(2), whole.unresolved_impulse(2))
    for few, all_ in zip(thin.unresolved_integrals(2), whole.unresolved_integrals(2), strict=True):
        np.testing.assert_allclose(few, all_[:, rows], atol=1e-14)
