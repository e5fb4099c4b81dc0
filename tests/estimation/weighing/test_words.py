"""What a study says: of forces that the data do not tell from none, and of settings that do not compare."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from shaken import DT
from weighings import candidates, outcome, weighing

from backsight.estimation.weighing.components import Component
from backsight.estimation.weighing.setting import Outcome
from backsight.estimation.weighing.store import Store
from backsight.estimation.weighing.weigh import _moves
from backsight.estimation.weighing.words import unreliable, words

NAN = float("nan")
FORCE = 100.0  # N, rms of the largest at the place


def said_of_the_balance(limit: float, *, tau: float | None = None, known: bool = True) -> str:
    """Of a force that may be none, whose std is at most `limit`; tau: it has a memory."""
    over = FORCE if tau else FORCE * np.sqrt(DT)  # what the rule of magnitudes makes of the forces
    component = Component(std=0.1, log_std=3.0, unit="N" if tau else "N.sqrt(s)", p_zero=0.4, limit=limit)
    found = weighing(candidates(rule={"weights": {"W of mass": float(over), "V of x": 1.0}}), component=component, force=FORCE)
    if tau:
        problem = found.problem
        found = replace(found, problem=replace(problem, weights=replace(problem.weights, W={"mass": 0.1}, tau={"mass": tau})))
    if not known:
        found = replace(found, forces={})
    (line,) = (line for line in words(found) if line.startswith("mass: "))
    return line


def test_a_balance_holds_only_where_a_residual_force_is_small_at_most():
    """Of white noise of this density the rms over a sampling interval, limit / sqrt(DT), beside the forces there."""
    line = said_of_the_balance(0.005 * FORCE * np.sqrt(DT))
    assert line.startswith("mass: its balance holds as it stands")
    assert "0.5 % of the rms of the largest force there (p = 0.4 without it)" in line
    line = said_of_the_balance(0.3 * FORCE * np.sqrt(DT))
    assert line.startswith("mass: the data do not tell a residual force from none (p = 0.4 without it)")
    assert "at most 4.2 N.sqrt(s) at 95 %, over a sampling interval 30 % of" in line
    assert "holds" not in line


def test_a_force_with_a_memory_has_its_rms_at_most():
    assert "at most 30 N at 95 %, 30 % of the rms" in said_of_the_balance(0.3 * FORCE, tau=0.2)


def test_where_no_limit_is_known_or_nothing_to_hold_it_against_that_is_said():
    assert said_of_the_balance(NAN).endswith("nor how large it is at most.")
    line = said_of_the_balance(0.1, known=False)
    assert line.endswith("its std is at most 0.1 N.sqrt(s) at 95 %.")


def turned(**lower: object) -> list[Outcome]:
    """W of mass alone, at a tenth and tenfold, between which p hardly moves."""
    return [
        *candidates(likelihood={"value": 2.0}),
        outcome("W of mass x 0.1", varied="W of mass", factor=0.1, **({"value": 2.01} | lower)),  # type: ignore[arg-type]
        outcome("W of mass x 10", varied="W of mass", factor=10.0, value=2.0),
    ]


def test_parameters_of_another_kind_are_no_influence_of_a_weight_and_that_is_said():
    alike, other = turned(), turned(arrived=False, value=9.0)
    assert _moves(alike)["W of mass"]["p"] == pytest.approx((0.02, 0.0))
    assert _moves(other)["W of mass"]["p"] == pytest.approx((np.nan, 0.0), nan_ok=True)
    quiet, said = (words(replace(weighing(outcomes), moves=_moves(outcomes))) for outcomes in (alike, other))
    assert any(line.startswith("Hardly a matter: W of mass") for line in quiet)
    assert not any("do not compare" in line for line in quiet)
    assert not any(line.startswith("Hardly a matter") for line in said)
    (line,) = (line for line in said if "do not compare" in line)
    assert line.startswith("With W of mass x 0.1 parameters are those most probable together with a trajectory")


def test_where_those_of_greatest_likelihood_are_of_the_other_kind_the_others_are_named():
    outcomes = [o if o.setting.group == "weight" else replace(o, arrived=False) for o in turned()]
    (line,) = (line for line in words(replace(weighing(outcomes), moves=_moves(outcomes))) if "do not compare" in line)
    assert line.startswith("With W of mass x 0.1 and W of mass x 10 parameters are those of most marginal likelihood")


def test_the_kind_of_the_parameters_is_kept(tmp_path):
    for arrived in (True, False):
        one = outcome("W of mass x 10", arrived=arrived, cost=1.0, log_likelihood=2.0, held_out=3.0, condition=4.0)
        store = Store(tmp_path, "study")
        store.put(one)
        assert store.get(one.setting) == one
    (path,) = tmp_path.iterdir()
    kept = json.loads(path.read_text(encoding="utf-8"))
    assert kept.pop("arrived") is False
    path.write_text(json.dumps(kept), encoding="utf-8")
    assert Store(tmp_path, "study").get(one.setting) is None  # of before it was kept


def test_a_recommendation_that_is_none_begins_with_that():
    assert unreliable(True, ["x: its prediction errors are white."]) == ""
    assert unreliable(False, []).startswith("Not to be relied on: the search for the weights of greatest likelihood went no further")
    nothing = unreliable(True, ["residual.cart, 157 N rms: the model explains next to nothing. Check units."])
    assert nothing.startswith("Not to be relied on: with them the model explains next to nothing")
    assert "loss (auto, huber)" in nothing


@pytest.mark.parametrize(("r", "said"), [(-0.95, "has more the other has less"), (0.95, "tell the ratio of"), (0.5, None), (-0.5, None)])
def test_of_two_weights_that_the_data_tell_together_alone_it_is_said_which_way(r, said):
    found = replace(weighing(candidates()), correlation={("W of mass", "V of x"): r})
    lines = [line for line in words(found) if "W of mass and V of x" in line]
    assert len(lines) == (said is not None)
    assert said is None or said in lines[0]
