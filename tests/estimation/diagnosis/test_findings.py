"""What is said of a force that no member of the library explains."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_axis import posed, run
from diagnoses import runs
from screened import screened

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis.answer.verdict import Explanation, Finding, Strength
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.chance import Chance
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import Screen, screen
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.findings import _chance, explained, finding, nameless, ranked, verdict
from backsight.estimation.diagnosis.search.refit import Fitted, fitted
from backsight.estimation.results import ParameterEstimate, ResidualSummary
from backsight.models import compile_model
from backsight.models.plants import PLANTS


def drilled(*recorded: tuple[str, ...]) -> Problem:
    """Recordings with these outputs."""
    time, V = np.arange(50) * 1e-2, {"V": np.ones(50)}
    recordings = [
        Recording(name=str(n), time=time, inputs=V, outputs={y: np.zeros(50) for y in outputs}, output_std=dict.fromkeys(outputs, 1e-3))
        for n, outputs in enumerate(recorded)
    ]
    return Problem(model=PLANTS["drillstring"](), recordings=recordings)


BOTH, SPEED, CURRENT = ("I_m", "Omega_r"), ("Omega_r",), ("I_m",)


def test_an_unknown_force_on_a_body_with_several_balances_is_told_by_the_body_and_the_one_where_it_is():
    left = ResidualSummary(place="body.tau_x", unit="N.m", rms=0.4, origin="")
    result = SimpleNamespace(residual_places={"body.tau_x": left}, estimates={})
    problem = SimpleNamespace(dae=compile_model(PLANTS["quadrotor"]()), recordings=[SimpleNamespace(outputs=("p", "q", "r"))])
    found = nameless("body.tau_x", 0.2, result, [], problem)
    assert found.explanation.place == "body"
    assert found.explanation.parameters == {"tau_x": Strength(value=0.4, std=None, unit="N.m")}
    assert "body" not in {r.place for r in found.rivals}
    assert all("." not in r.place for r in found.rivals)


@pytest.mark.parametrize(
    ("place", "recorded", "others", "separates"),
    [
        ("bha", [BOTH], ["rotary_table"], "a sensor of bha.omega"),
        ("bha", [BOTH, BOTH], ["rotary_table"], "a sensor of bha.omega"),
        ("motor", [BOTH], ["input:V"], ""),
        ("motor", [SPEED], ["rotary_table", "bha", "input:V", "sensor:Omega_r"], "a sensor of motor.i"),
        ("rotary_table", [SPEED], ["motor", "bha", "input:V", "sensor:Omega_r"], "more than one sensor more"),
        ("motor", [CURRENT, SPEED], ["rotary_table", "bha", "input:V"], "a sensor of motor.i or rotary_table.omega or bha.omega"),
        ("motor", [CURRENT, BOTH], ["input:V"], ""),
    ],
)
def test_an_unknown_force_may_be_wherever_the_outputs_cannot_tell_it_from(place, recorded, others, separates):
    left = ResidualSummary(place=place, unit="N.m", rms=0.4, origin="")
    result = SimpleNamespace(residual_places={place: left}, estimates={})
    found = nameless(place, 0.2, result, [], drilled(*recorded))
    assert found.explanation.place == place
    assert {(r.place, r.physics) for r in found.rivals} == {(other, "unknown_physics") for other in others}
    assert found.separates == separates
    assert verdict([found]) == "unknown_physics"


@pytest.mark.parametrize(
    ("first", "other", "word"), [(True, False, "missing_physics"), (True, True, "undecided"), (False, False, "undecided")]
)
def test_a_number_of_the_model_does_not_stand_against_one_that_the_study_gives(first, other, word):
    """An inertia that the study says is nothing, or that it does not name, and a mass of the model, or of the study, that moves with it."""
    wrong = Explanation(place="slide", family="parameter", physics="wrong_parameter", subject=("slide.m",), given=other)
    added = Explanation(place="wheel", family="inertia", physics="added_mass", given=first)
    assert verdict([Finding(explanation=added, p_value=0.0, gain=50.0, change="", share=None, rivals=(wrong,))]) == word


def test_what_has_the_most_evidence_is_the_answer_whatever_was_found_first():
    """A kinematic error that was seen first, or a spring; then friction beside it. A force without a name has no evidence."""
    wave = Explanation(place="sensor:q", family="sensor", physics="kinematic_error")
    spring = Explanation(place="joint", family="elasticity", physics="spring")
    friction = Explanation(place="joint", family="friction", physics="coulomb_friction")
    small = Finding(explanation=wave, p_value=0.0, gain=19.0, change="", share=None, rivals=(spring,))
    large = Finding(explanation=friction, p_value=0.0, gain=700.0, change="", share=None)
    unknown = replace(large, explanation=replace(friction, physics="unknown_physics"), gain=0.0)
    assert ranked([small, large, unknown]) == (unknown, large, small)
    assert verdict([small, large]) == "missing_physics"
    assert verdict([small]) == "undecided"
    assert verdict([small, large, unknown]) == "unknown_physics"


@pytest.mark.parametrize(("score", "fit", "told"), [(40.0, 35.0, True), (40.0, 900.0, True), (3.0, 900.0, False), (3.0, 4.0, True)])
def test_a_score_that_says_nothing_of_what_a_fit_gained_says_nothing_of_its_chance(score, fit, told):
    s = screened("sensor:phi", "sensor_delay", score)
    found = Screen(found=(s,), chance=Chance(looks=Counter({1: 100})), G=np.empty((0, 0)), plain=np.empty(0), columns=())
    chance = _chance(found, s, Fitted(candidate=s.candidate, gain=fit))
    assert (chance == found.chance.of(score)) is told
    assert np.isnan(chance) != told


@pytest.mark.parametrize(("lacks", "told"), [(1.0, False), (40.0, True)])
def test_two_parameters_of_one_component_may_be_wrong_and_each_is_named(lacks, told):
    """A gear's ratio and its inertia stand in one component: what is said of one of them does not go for the other."""

    def judged(path: str, gain: float) -> tuple:
        value = ParameterEstimate(name=path, value=2.0, std=0.01, unit="1", fixed=False)
        c = Candidate(place="gear", family="parameter", physics="wrong_parameter", strengths=(path,), start={path: (1.0, 0.1, 9.0)})
        result = SimpleNamespace(parameters={path: value}, units={}, solver=SimpleNamespace(converged=True))
        return replace(c, named={path: path}), None, Fitted(candidate=c, result=result, gain=gain)

    best, other = judged("gear.ratio", 100.0), judged("gear.J", 100.0 - lacks)
    found = finding(None, best, [best, other], None, None)
    assert found.explanation.words == "wrong parameter gear.ratio"
    assert [e.words for e in found.rivals] == ["wrong parameter gear.J"] * (not told)
    assert [e.words for e in found.alternatives] == ["wrong parameter gear.J"] * told


@pytest.mark.parametrize(("refused", "open_"), [(frozenset(), True), (frozenset({("input:F", "input_lag")}), False)])
def test_a_fit_against_which_something_speaks_is_nothing_that_it_could_be_instead(refused, open_):
    """A lag that gains more than friction does, but leaves more force over than there was."""

    def judged(place: str, physics: str, gain: float) -> tuple:
        value = ParameterEstimate(name=physics, value=2.0, std=0.01, unit="1", fixed=False)
        c = Candidate(place=place, family="friction", physics=physics, strengths=(physics,), named={physics: physics})
        result = SimpleNamespace(parameters={physics: value}, units={}, solver=SimpleNamespace(converged=True))
        return c, None, Fitted(candidate=c, result=result, gain=gain)

    best, other = judged("carriage", "coulomb_friction", 100.0), judged("input:F", "input_lag", 200.0)
    found = finding(None, best, [best, other], None, None, refused=refused)
    assert [e.physics for e in found.rivals] == ["input_lag"] * open_
    assert [e.physics for e in found.alternatives] == ["input_lag"] * (not open_)


def test_what_came_free_once_it_was_kept_is_among_its_numbers():
    _, before, _, after = runs()
    c = Candidate(place="carriage", family="friction", physics="x", named={"d": "friction.d"}, later={"friction.f_c": (0.0, 0.0, np.inf)})
    assert set(explained(c, before).parameters) == {"d"}
    assert explained(c, after).parameters["f_c"].value == after.parameters["friction.f_c"].value


@pytest.mark.parametrize(("share", "fitted_more", "open_"), [(0.95, 1.0, True), (0.5, 1.0, False), (0.95, 3.0, False)])
def test_a_fit_that_did_not_come_to_rest_says_nothing_against_what_explains_as_much(share, fitted_more, open_):
    """A damping that is wrong, and a sensor's gain of which no fit arrived: by its score it gains this share of as much."""
    made = run(2.0, 2e-3, f_c=20.0, d=200.0)
    problem = posed(made, W={}, friction__d=190.0, friction__f_c=Free(15.0, min=0.0))
    result = smooth(problem)
    base = Linearised(result.solution)
    physics = ("wrong_parameter", "sensor_gain")
    wanted = [c for c in library(problem, problem.model, base.solution) if c.physics in physics and c.strengths != ("carriage.m",)]
    found = screen(base, looked_at(problem, problem.model, base, wanted))
    damping, gain = (next(s for s in found.found if s.candidate.physics == word) for word in physics)
    fit = fitted(problem, problem.model, result, damping.candidate, {"friction.d": 200.0})
    best = damping.candidate, damping, replace(fit, gain=fitted_more * damping.gain)
    lost = (
        gain.candidate,
        replace(gain, gain=share * damping.gain),
        Fitted(candidate=gain.candidate, failed="Stopped at its limit of time."),
    )
    told = finding(base, best, [best, lost], replace(found, found=(damping,)), Sizes(problem, result, base))
    assert [r.words for r in told.rivals] == ["sensor gain at sensor:x"] * open_
    assert told.alternatives == ()
