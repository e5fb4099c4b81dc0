"""What a weight from the data says of itself."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize

from backsight.estimation.weighing import components
from backsight.estimation.weighing.components import Component, Found, _along, _step, maximise
from backsight.estimation.weighing.setting import Outcome, Setting
from backsight.estimation.weighing.weigh import _moves
from backsight.estimation.wording import per_root_bandwidth


def test_an_interval_begins_at_none_where_there_may_be_none_and_ends_at_the_limit():
    maybe = Component(std=0.1, log_std=5.0, unit="N", p_zero=0.3, limit=0.7)
    assert maybe.interval == (0.0, 0.7)
    low, high = replace(maybe, p_zero=0.01, log_std=0.2).interval
    assert (low, high) == pytest.approx((0.1 / np.exp(0.2 * 1.959964), 0.1 * np.exp(0.2 * 1.959964)))


@pytest.mark.parametrize(
    ("unit", "density"),
    [("N", "N.sqrt(s)"), ("1", "sqrt(s)"), ("N.s/m/s", "N.s/m/sqrt(s)"), ("m/s", "m/sqrt(s)"), ("rad/s", "rad/sqrt(s)")],
)
def test_a_white_quantity_has_the_unit_of_its_integral_over_the_root_of_time(unit, density):
    """A drift of a damper, N.s/m in a second, moves it by its std times sqrt(T): N.s/m over the root of a second."""
    assert per_root_bandwidth(unit) == density


def outcome(name: str, value: float, std: float, **setting: object) -> Outcome:
    at = Setting(**({"name": name, "group": "weight", "theta": (0.0,)} | setting))
    return Outcome(
        setting=at, converged=True, status="", iterations=1, seconds=0.0, weights={}, parameters={"p": (value, std), "q": (1.0, np.inf)}
    )


def test_influence_is_counted_in_deviations_and_of_what_is_not_determined_there_is_none():
    best = outcome("greatest likelihood", 2.0, 0.5, group="candidate")
    ends = [outcome(f"W of x x {s:g}", v, 9.0, varied="W of x", factor=s) for s, v in ((0.1, 1.0), (10.0, 2.25))]
    moves = _moves([best, *ends])
    assert moves["W of x"]["p"] == (-2.0, 0.5)
    assert np.isnan(moves["W of x"]["q"]).all()
    lost = replace(ends[0], converged=False)
    assert np.isnan(_moves([best, lost, ends[1]])["W of x"]["p"][0])
    assert _moves([replace(best, converged=False), *ends]) == {}


def test_steps_go_along_the_variances_and_shorter_ones_less_far():
    step, variance = np.array([0.15, -0.075 / 0.2, 0.0]), np.array([1.0, 0.2, 1.0])
    parts = np.array([np.exp(2 * _along(step, length)) * variance for length in (1.0, 1 / 3, 1 / 9)])
    # what one variance has more the other has less, in any part of the step
    assert parts[:, 0] - 1.0 == pytest.approx([0.3, 0.1, 0.3 / 9])
    assert parts[:, 1] - 0.2 == pytest.approx([-0.15, -0.05, -0.15 / 9])
    assert parts[:, 2] == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(20))
def test_what_goes_to_nothing_goes_no_further_and_the_others_step_as_is_best_beside_it(seed):
    """A sensor that made room for a force below nothing lost by it what the force gained: the search crept, and did not settle.

    The truth is the quadratic's greatest value within the bounds, by a general method.
    """
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(9, 4))
    here = SimpleNamespace(freedom=np.full(4, 10.0), information=B.T @ B, slope=3.0 * rng.normal(size=4))
    step, promise = _step(SimpleNamespace(noise=np.ones(4, dtype=bool)), here, np.ones(4, dtype=bool))
    best = optimize.minimize(
        lambda s: s @ here.information @ s / 2 - s @ here.slope, np.zeros(4), method="L-BFGS-B", bounds=[(-0.475, 1.5)] * 4
    )
    assert step.min() >= -0.475 - 1e-12
    assert np.exp(2 * _along(step, 1.0)).min() > 0.0499
    assert promise == pytest.approx(-best.fun, rel=0.02, abs=0.01)
    assert step == pytest.approx(best.x, rel=0.05, abs=0.02)


def test_a_force_that_goes_to_nothing_does_not_hold_up_the_others():
    """Its own step had no length; it took the promise of all steps with it, and a search ended 500 nats below its summit."""
    here = SimpleNamespace(freedom=np.array([1.0, 500.0]), slope=np.array([-50.0, 100.0]), information=np.diag([1e-3, 1e3]))
    step, promise = _step(SimpleNamespace(noise=np.array([False, True])), here, np.ones(2, dtype=bool))
    assert step == pytest.approx([-0.475, 0.1], rel=2e-3)
    assert promise == pytest.approx(0.475 * 50 + 0.1 * 100 / 2, rel=2e-3)


def test_a_solve_that_stopped_early_does_not_end_the_search(monkeypatch):
    """What it is worth too much, .3 nats here, no step gains; asked again from where one of these went on it is worth what it is."""

    def at(_: object, theta: np.ndarray, start: object) -> SimpleNamespace:
        early = 0.3 if start is None else 0.0
        solved = SimpleNamespace(status=SimpleNamespace(converged=True), decisions="there")
        return SimpleNamespace(
            value=early - 50.0 * float((theta[0] - 1.0) ** 2),
            slope=100.0 * (1.0 - theta),
            information=np.array([[100.0]]),
            freedom=np.array([50.0]),
            solution=SimpleNamespace(solved=solved),
        )

    monkeypatch.setattr(components, "_at", at)
    found = maximise(SimpleNamespace(noise=np.array([True])), np.array([0.95]), np.ones(1, dtype=bool))
    assert found.settled
    assert found.theta == pytest.approx([1.0], abs=0.01)


def test_of_a_force_that_has_gone_rounding_does_not_take_the_deviations_of_the_others_along():
    """Its information, the difference of two numbers, may come out negative: then nothing is told of it, and all else as without it."""
    plain = np.array([[400.0, 30.0], [30.0, 90.0]])
    information = np.block([[plain, np.array([[1.0], [2.0]])], [np.array([[1.0, 2.0]]), np.array([[1e-3]])]])

    def found(freedom: float) -> Found:
        here = SimpleNamespace(information=information, freedom=np.array([200.0, 45.0, freedom]))
        return Found(theta=np.zeros(3), moving=np.ones(3, dtype=bool), likelihood=here, settled=True)

    gone, there = found(1e-4), found(1.0)
    assert gone.std[:2] == pytest.approx(np.sqrt(np.diag(np.linalg.inv(plain))))
    assert np.isnan(gone.std[2])
    assert np.all(np.isnan(there.std))  # of one that is there a negative information says that this is no summit
