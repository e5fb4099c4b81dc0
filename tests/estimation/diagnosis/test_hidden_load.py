"""Friction at a load of which no output tells: an encoder on the motor alone, a soft shaft between, simulated by hand."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from examples import soft_drive
from hidden_load import LOAD, MOTOR, posed

from backsight.estimation import Free, Problem
from backsight.estimation.diagnosis import diagnose
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.search.choice import CLEAR
from backsight.estimation.diagnosis.search.fits import Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.refit import HELD, at_work, hidden
from backsight.estimation.diagnosis.search.search import ASTRAY, Search
from backsight.estimation.diagnosis.search.standing import Standing
from backsight.estimation.diagnosis.start.as_it_is import as_it_is
from backsight.estimation.smoothing.smoother import smoothing
from backsight.models import compile_model
from backsight.models.mechanics.rotational import RotationalFriction


def test_the_place_of_which_no_output_tells_is_the_load():
    problem = posed(0.0)
    assert hidden(Problem(model=compile_model(soft_drive()), recordings=problem.recordings, parameters=problem.parameters)) == {"load"}


@pytest.mark.parametrize(("given", "held"), [(0.0, set()), (0.2, {"load"}), (Free(0.0, min=0.0), {"load"})])
def test_a_law_is_at_work_but_where_its_strength_is_fixed_at_nothing(given, held):
    model = soft_drive().insert("load", RotationalFriction(tau_c=0.1), "brake")
    assert at_work(replace(posed(0.0), model=model, parameters={**posed(0.0).parameters, "brake.tau_c": given})) == held


HELD_NAME, WEIGHED, ONWARD, FROM_THERE = (
    "the model as it is" + more
    for more in (", with weights from the forces' sizes", "", ", from where it was left", ", with weights from the data from there")
)


@pytest.mark.parametrize(
    ("settled", "taken"),
    [
        ({HELD_NAME, WEIGHED}, HELD_NAME),
        ({WEIGHED, FROM_THERE}, WEIGHED),
        ({ONWARD, FROM_THERE}, ONWARD),
        ({FROM_THERE}, FROM_THERE),
        (set(), HELD_NAME),
    ],
)
def test_the_model_as_it_is_is_the_first_way_that_comes_to_rest_where_a_load_is_hidden(tmp_path, settled, taken):
    """The ways were gone before and are kept: here it is told which of them came to rest."""
    problem = posed(0.0)
    kept = Keep(tmp_path, problem)
    result = smoothing(problem, settings=HELD)
    for name in (HELD_NAME, WEIGHED, ONWARD, FROM_THERE):
        told = replace(result, solver=replace(result.solver, converged=name in settled), notes=(name,))
        kept.put(kept.name(name), (told, result.solution))
    found = as_it_is(problem, kept, lambda _: None)
    assert found.result.notes == (taken,)
    assert found.settings.weigh is (taken != HELD_NAME)


def astray() -> Search:
    """The motor's inertia was found to be wrong beside a load that came to rest fifty times too heavy."""
    problem = posed(0.0)
    wrong = Candidate(
        place="motor", family="parameter", physics="wrong_parameter", strengths=("motor.J",), start={"motor.J": (1.3 * MOTOR, 0.0, np.inf)}
    )
    bare = replace(problem, parameters={**problem.parameters, "motor.J": 1.3 * MOTOR})
    heavy = replace(problem, parameters={**problem.parameters, "load.J": 50 * LOAD, "motor.J": Free(MOTOR)})
    kept = Keep(None, problem)
    fits = Fits(pool=ThreadPoolExecutor(1), ahead=1, kept=kept, say=lambda _: None, end=time.time() + 1e4)
    begun = Standing(problem=bare, model=soft_drive(), result=smoothing(heavy, settings=HELD))
    search = Search(standing=begun, fits=fits, settings=HELD)
    search.standing = replace(begun, problem=problem, accepted=(wrong,))
    return search


@pytest.mark.parametrize(("left", "better"), [(0.5 * ASTRAY, False), (2.0 * ASTRAY, True)])
def test_a_load_that_a_wrong_model_led_astray_is_found_again_from_the_guesses(left: float, better: bool):
    search = astray()
    scored = SimpleNamespace(sizes=SimpleNamespace(left={"load": left, "motor": 1.0}))
    before = search.now.nats
    assert search._better_from_the_guesses(scored) is better  # type: ignore[arg-type]
    if better:
        assert search.now.nats > before + CLEAR
        assert search.result.parameters["load.J"].value == pytest.approx(LOAD, rel=0.1)
        assert not search._better_from_the_guesses(scored)  # type: ignore[arg-type]  # asked once


@pytest.mark.slow
def test_friction_that_holds_a_load_that_nobody_sees_is_found_there():
    d = diagnose(posed(0.15), jobs=2)
    assert d.verdict == "missing_physics"
    found = d.findings[0].explanation
    assert found.place == "load"
    assert found.family == "friction"
    level = next(s for word, s in found.parameters.items() if word in ("tau_c", "tau_s"))
    assert level.value == pytest.approx(0.15, rel=0.1)
    assert d.held_out is not None
    assert d.held_out.improvement_percent > 20


@pytest.mark.slow
def test_a_load_without_friction_gets_none():
    d = diagnose(posed(0.0), jobs=2)
    assert d.verdict == "none"
    assert d.findings == ()
