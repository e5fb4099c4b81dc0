"""What a weight from the data says of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from backsight.estimation.weighing.components import Component
from backsight.estimation.weighing.setting import Outcome, Setting
from backsight.estimation.weighing.weigh import _moves
from backsight.estimation.wording import per_root_bandwidth


@pytest.mark.parametrize("n", [200, 5000])
@pytest.mark.parametrize("left", [1e-3, 1e-6])
def test_where_there_may_be_none_the_interval_ends_where_the_likelihood_has_fallen(n, left):
    """White readings of variance r^2 = 4, just as large as their noise: of a variance s^2 beside it, by its own likelihood

    2 (l(0) - l(s^2)) = n (log(1 + s^2/r^2) + 1/(1 + s^2/r^2) - 1) = 1.645^2,

    whatever small s the search has stopped at; the information on log s is 2 n (s^2 / (r^2 + s^2))^2.
    """
    r2, s2 = 4.0, 4.0 * left
    log_std = (r2 + s2) / (s2 * np.sqrt(2 * n))
    low, high = Component(std=float(np.sqrt(s2)), log_std=float(log_std), unit="N", p_zero=1.0).interval
    limit = brentq(lambda u: n * (np.log1p(u) + 1 / (1 + u) - 1) - 1.644854**2, 1e-6, 10.0)
    assert low == 0.0
    assert high**2 / r2 == pytest.approx(limit, rel=3.5 / np.sqrt(n))


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
