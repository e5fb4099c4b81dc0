"""The page of a weighting study: which points of the trade-off are drawn, and under which names."""

from __future__ import annotations

import base64
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from weighings import candidates, lost, outcome, weighing

from backsight.estimation.command.terminal import console, weight_table
from backsight.estimation.report.weighing import _weights, trade_off_chart
from backsight.estimation.weighing.components import Component
from backsight.estimation.weighing.recommendation import LIKELIHOOD, RULE
from backsight.estimation.weighing.setting import Outcome

FIRST = "as smooth chooses them"


def points(outcomes: list[Outcome], chosen: str) -> dict[str, np.ndarray]:
    """Curve -> (n, 2)."""
    chart = trade_off_chart(weighing(outcomes, chosen=chosen))
    assert chart is not None
    every = ((trace["name"], [trace[key] for key in "xy"]) for trace in chart.data)
    return {
        name: np.array([np.frombuffer(base64.b64decode(axis["bdata"]), dtype=f"<{axis['dtype']}") for axis in axes]).T
        for name, axes in every
    }


@pytest.fixture
def study() -> list[Outcome]:
    """Forces of 1 at the greatest likelihood and of 5 with what smooth chooses, the trade-off from 0.1 to 10."""
    path = [outcome(f"W x {s:g}", "trade-off", factor=s, force={"mass": (s, 1.0)}, misfit={"x": (1e-3 / s, 1.0)}) for s in (0.1, 10.0)]
    weights = {"W of mass": 5.0, "V of x": 2e-3}
    return [*candidates(first={"force": {"mass": (5.0, 1.0)}, "misfit": {"x": (2e-3, 1.0)}, "weights": weights}), *path]


def test_those_recommended_are_a_point_of_their_own_where_they_are_not_the_likeliest(study):
    """In decades of their own weights, 5 and 2e-3, in which they stand where both are as supposed."""
    drawn = points(study, FIRST)
    assert list(drawn) == ["all W turned together", "recommended", LIKELIHOOD]
    assert drawn["recommended"] == pytest.approx(np.zeros((1, 2)), abs=1e-6)
    here = np.log10([[1e-3 / 2e-3, 1.0 / 5.0]])
    assert drawn[LIKELIHOOD] == pytest.approx(here, abs=1e-6)
    away = np.array([[1.0, -1.0], [0.0, 0.0], [-1.0, 1.0]])
    assert drawn["all W turned together"] == pytest.approx(here + away, abs=1e-6)


def test_the_likeliest_are_those_recommended_where_they_are_and_the_trade_off_leads_through_them(study):
    drawn = points(study, LIKELIHOOD)
    assert list(drawn) == ["all W turned together", "recommended"]
    assert drawn["all W turned together"][1] == pytest.approx(drawn["recommended"][0])
    assert all(a[0] > b[0] for a, b in pairwise(drawn["all W turned together"]))


def test_where_the_likeliest_did_not_converge_no_other_candidate_stands_in_the_trade_off_for_it(study):
    drawn = points([lost(study[0]), *study[1:]], RULE)
    assert list(drawn) == ["all W turned together", "recommended"]
    assert len(drawn["all W turned together"]) == 2


def test_the_interval_of_a_force_that_may_be_none_ends_at_its_limit_on_the_page_and_in_the_terminal(capsys):
    """Its logarithm may not be told at all. In both the std from the data stands beside the recommended one."""
    maybe = Component(std=0.1234, log_std=float("nan"), unit="N.sqrt(s)", p_zero=0.4, limit=0.777)
    found = weighing(candidates(), component=maybe)
    console().print(weight_table(replace(found, recommended=SimpleNamespace(model="oscillator"))))
    for text in (_weights(found), capsys.readouterr().out):
        assert "up to 0.777" in text
        assert "0.1234" in text
