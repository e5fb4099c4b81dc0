"""ARMAX on hand-written difference equations: coefficients, noise polynomial, deviations, orders."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from backsight.estimation import Recording
from backsight.estimation.classical import Orders, armax, select_orders
from backsight.models.errors import InputError

A, B1, B2, C, OFFSET = [1, -1.5, 0.7], [0, 1, 0.5], [0, -0.3, 0.2], [1, -0.9, 0.3], 0.2
TRUE = np.array([-1.5, 0.7, 1, 0.5, -0.3, 0.2, OFFSET, -0.9, 0.3])
ORDERS = Orders(na=2, nb=2, nc=2, offset=True)
STD = 0.3


def recorded(seed: int, n: int = 1500, noise: list[float] = C) -> Recording:
    """y(k) = 1.5 y(k-1) - 0.7 y(k-2) + u_1(k-1) + .. + 0.2 + e(k) - 0.9 e(k-1) + 0.3 e(k-2)."""
    rng = np.random.default_rng(seed)
    u, e = rng.normal(size=(2, n)), STD * rng.normal(size=n)
    y = lfilter(B1, A, u[0]) + lfilter(B2, A, u[1]) + lfilter(noise, A, e) + lfilter([OFFSET], A, np.ones(n))
    return Recording(name="run", time=0.1 * np.arange(n), inputs={"u": u[0], "v": u[1]}, outputs={"y": y})


def test_coefficients_and_noise_polynomial_scatter_as_their_deviations_say():
    """20 repetitions of 9 coefficients: rms of the 180 scores within 0.8 .. 1.2 (chance of failing below 1e-3), none beyond 4.5."""
    models = [armax(recorded(seed), output="y", orders=ORDERS) for seed in range(20)]
    scores = np.array([(m.theta - TRUE) / np.sqrt(np.diag(m.covariance)) for m in models])
    assert 0.8 < np.sqrt(np.mean(scores**2)) < 1.2
    assert np.max(np.abs(scores)) < 4.5
    assert np.mean([m.variance for m in models]) == pytest.approx(STD**2, rel=0.05)


def test_a_model_without_noise_polynomial_is_biased_by_coloured_noise():
    run = recorded(1, n=4000)
    plain, full = (armax(run, output="y", orders=Orders(na=2, nb=2, nc=nc, offset=True)) for nc in (0, 2))
    off = np.abs(plain.theta[:2] - TRUE[:2]) / np.sqrt(np.diag(plain.covariance))[:2]
    assert np.max(off) > 6
    assert np.max(np.abs(full.theta[:2] - TRUE[:2]) / np.sqrt(np.diag(full.covariance))[:2]) < 4.5


def test_without_noise_polynomial_it_is_the_linear_regression():
    run = recorded(2, n=300)
    y, (u, v) = run.outputs["y"], run.inputs.values()
    X = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2], v[1:-1], v[:-2], np.ones(298)])
    assert armax(run, output="y", orders=Orders(na=2, nb=2, offset=True)).theta == pytest.approx(np.linalg.lstsq(X, y[2:], rcond=None)[0])


def test_what_is_left_is_white_and_the_fit_is_that_of_the_prediction():
    base = armax(recorded(3), output="y", orders=ORDERS).baseline()
    fit = base.fit["run"]["y"]
    assert fit.rms == pytest.approx(STD, rel=0.1)
    assert fit.whiteness_p > 1e-3
    assert base.predicted == "one step ahead"
    assert list(base.parameters) == ["a_1", "a_2", "b_u_1", "b_u_2", "b_v_1", "b_v_2", "d", "c_1", "c_2"]


def test_a_noise_polynomial_outside_the_unit_circle_is_found_by_its_mirror_image():
    """1 - 2 q^-1 has the same spectrum as 2 (1 - q^-1/2)."""
    found = armax(recorded(4, n=3000, noise=[1, -2.0, 0.0]), output="y", orders=ORDERS)
    assert list(found.C) == pytest.approx([1, -0.5, 0.0], abs=0.1)
    assert found.variance == pytest.approx(4 * STD**2, rel=0.15)


@pytest.mark.parametrize("criterion", ["aic", "bic"])
def test_orders_are_found_by_the_criteria(criterion):
    candidates = [Orders(na=a, nb=2, nc=c, offset=True) for a in (1, 2, 3) for c in (0, 1, 2)]
    best = select_orders(recorded(5, n=2500), output="y", candidates=candidates, criterion=criterion)
    assert len(best) == 9
    assert (best[0].orders.na, best[0].orders.nc) == (2, 2) if criterion == "bic" else best[0].orders.na >= 2
    assert all(getattr(a, criterion) <= getattr(b, criterion) for a, b in pairwise(best))


def test_a_delay_is_a_lag_of_the_input():
    rng = np.random.default_rng(6)
    u = rng.normal(size=400)
    y = 2.0 * np.concatenate([np.zeros(5), u[:-5]])
    run = Recording(name="run", time=np.arange(400.0), inputs={"u": u}, outputs={"y": y})
    found = armax(run, output="y", orders=Orders(na=0, nb=2, nk=5))
    assert found.B[0] == pytest.approx([0, 0, 0, 0, 0, 2.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: armax(r, output="z", orders=ORDERS), "output = 'z' is not recorded"),
        (lambda r: armax(r, output="y", orders=ORDERS, inputs=["w"]), "input w is not recorded"),
        (lambda r: armax(r, output="y", orders=Orders(na=200, nb=200)), "too few for 600 coefficients"),
        (lambda r: select_orders(r, output="y", candidates=[]), "at least one Orders"),
        (lambda r: select_orders(r, output="y", candidates=[ORDERS], criterion="mdl"), "criterion"),
        (lambda _: Orders(na=-1, nb=1), "whole number from 0 on"),
        (lambda _: Orders(na=0, nb=0), "nothing to estimate"),
    ],
)
def test_what_cannot_be_fitted_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call(recorded(7, n=500))
