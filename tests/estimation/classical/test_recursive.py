"""Recursive maximum likelihood: where it converges to, and how it follows what changes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from backsight.estimation import Recording
from backsight.estimation.classical import Orders, armax, recursive_armax
from backsight.models.errors import InputError

ORDERS = Orders(na=1, nb=1, nc=1)


def recorded(seed: int, gain: np.ndarray, std: float = 0.3) -> Recording:
    """y(k) = 0.8 y(k-1) + gain(k) u(k-1) + e(k) - 0.6 e(k-1)."""
    rng, n = np.random.default_rng(seed), len(gain)
    u, e = rng.normal(size=n), std * rng.normal(size=n)
    drive = gain * np.concatenate([[0.0], u[:-1]]) + lfilter([1, -0.6], [1], e)
    return Recording(name="run", time=0.1 * np.arange(n), inputs={"u": u}, outputs={"y": lfilter([1], [1, -0.8], drive)})


def test_constant_coefficients_end_where_the_whole_recording_puts_them():
    """Both estimate from the same samples, so they differ by less than their common deviation."""
    run = recorded(1, np.full(4000, 1.5))
    whole, last = armax(run, output="y", orders=ORDERS), recursive_armax(run, output="y", orders=ORDERS)
    std = np.sqrt(np.diag(whole.covariance))
    assert np.max(np.abs(last.theta[-1] - whole.theta) / std) < 1.0
    assert last.std[-1] == pytest.approx(std, rel=0.15)
    assert last.baseline().fit["run"]["y"].rms == pytest.approx(0.3, rel=0.06)


@pytest.mark.slow
def test_deviations_hold_over_many_repetitions():
    """20 repetitions of 3 coefficients: rms of the 60 scores within 0.7 .. 1.35 (chance of failing below 1e-3)."""
    scores = []
    for seed in range(20):
        found = recursive_armax(recorded(seed, np.full(1500, 1.5)), output="y", orders=ORDERS)
        scores.append((found.theta[-1] - [-0.8, 1.5, -0.6]) / found.std[-1])
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.35


def test_for_a_linear_regression_with_a_random_walk_it_is_the_kalman_filter():
    """Information and covariance form of the same recursion, written out by hand."""
    run = recorded(2, np.full(60, 1.5))
    y, u, drift, noise, first = run.outputs["y"], run.inputs["u"], 0.05, 0.3, 2.0
    found = recursive_armax(run, output="y", orders=Orders(na=1, nb=1), drift=drift, noise_std=noise, start_std=first)
    x, P = np.zeros(2), np.eye(2) * first**2
    for k in range(1, 60):
        h = np.array([-y[k - 1], u[k - 1]])
        information = np.linalg.inv(P) + np.outer(h, h) / noise**2
        x = np.linalg.solve(information, np.linalg.inv(P) @ x + h * y[k] / noise**2)
        P = np.linalg.inv(information) + np.eye(2) * drift**2
        assert found.theta[k] == pytest.approx(x, rel=1e-9)


@pytest.mark.parametrize("how", [{"drift": {"b_1": 0.02}}, {"forgetting": 0.985}])
def test_a_gain_that_jumps_is_followed(how):
    gain = np.where(np.arange(3000) < 1500, 1.5, 0.5)
    found = recursive_armax(recorded(3, gain), output="y", orders=ORDERS, **how)
    b = found.theta[:, found.names.index("b_1")]
    assert np.mean(b[1300:1500]) == pytest.approx(1.5, abs=0.1)
    assert np.mean(b[2000:]) == pytest.approx(0.5, abs=0.1)
    stiff = recursive_armax(recorded(3, gain), output="y", orders=ORDERS).theta[-1, 1]
    assert stiff > 0.8


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"forgetting": 0.5}, "must lie above 0.9"),
        ({"drift": {"b_9": 0.1}}, "no such coefficient; did you mean 'b_1'"),
        ({"start": {"q": 0.1}}, "no such coefficient"),
        ({"drift": -1.0}, "zero or positive"),
    ],
)
def test_numbers_out_of_range_and_unknown_names_are_refused(how, message):
    with pytest.raises(InputError, match=message):
        recursive_armax(recorded(4, np.ones(100)), output="y", orders=ORDERS, **how)
