"""Numbers of a machine that change while it runs, on a spring-mass machine that SciPy integrates on either side of the change."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from concealed_axis import posed, run
from scipy.integrate import solve_ivp
from sprung_mass import machine

from backsight.estimation import Diagnosis, Free, Problem, Recording, diagnose, smooth
from backsight.estimation.diagnosis.answer.words import sentence
from backsight.estimation.diagnosis.candidates.changing import _may, changing
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.onsets import dated, late
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.models import Model, compile_model
from backsight.models.mechanics.planar import PointMass

TRUE = {"load.m": 2.0, "spring.k": 300.0, "damper.d": 6.0}
STEP, N, AT, BACK, NOISE = 4e-3, 1500, 2.5, 4.2, 2e-6


def recorded(later: dict[str, float], seed: int, role: str = "fit", rate: float | None = None, back: float = np.inf) -> Recording:
    """Force held from row to row; from AT until `back` parameters are those of `later`, or with a rate they near them from the start."""
    rng, t, state, seen = np.random.default_rng(seed), STEP * np.arange(N), np.zeros(2), np.empty(N)
    force = 20.0 * np.repeat(rng.uniform(-1, 1, N // 25), 25) + 10.0 * np.sin(11.0 * t)
    for k in range(N):
        changed = later if rate is not None or AT - STEP / 2 <= t[k] < back - STEP / 2 else {}
        seen[k] = state[0]

        def moves(t: float, s: np.ndarray, later: dict[str, float] = changed, f: float = force[k]) -> list[float]:
            share = 1.0 if rate is None else t / STEP / (N - 1) if rate == 0 else 1.0 - np.exp(-rate * t)
            p = {name: value + share * (later.get(name, value) - value) for name, value in TRUE.items()}
            return [s[1], (f + share * later.get("push", 0.0) - p["spring.k"] * s[0] - p["damper.d"] * s[1]) / p["load.m"]]

        state = solve_ivp(moves, (t[k], t[k] + STEP), state, rtol=1e-10, atol=1e-13).y[:, -1]
    x = seen + NOISE * rng.standard_normal(N)
    return Recording(name=role, time=t, inputs={"F": force}, outputs={"x": x}, output_std={"x": NOISE}, role=role)


@cache
def found(name: str, later: float, *fixed: str, rate: float | None = None, back: float = np.inf) -> Diagnosis:
    free = {path: Free(1.2 * value, min=0.1 * value) for path, value in TRUE.items()}
    given = {path: TRUE[path] if path in fixed else guess for path, guess in free.items()}
    changed = {name: later} if name else {}
    recordings = [recorded(changed, 3, rate=rate, back=back), recorded(changed, 4, "held_out", rate, back)]
    return diagnose(Problem(model=machine(), recordings=recordings, parameters=given))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "later", "fixed"), [("spring.k", 240.0, ()), ("spring.k", 10.0, ()), ("load.m", 1.7, ()), ("load.m", 1.7, ("load.m",))]
)
def test_a_number_that_changes_is_found_with_its_time_and_its_size(name, later, fixed):
    d = found(name, later, *fixed)
    assert (d.verdict, [f.explanation.subject for f in d.findings]) == ("parameter", [(name,)])
    (finding,) = d.findings
    assert finding.onset == pytest.approx(AT, abs=0.02)  # steps of its mesh
    (strength,) = finding.explanation.parameters.values()
    assert strength.value == pytest.approx(later - TRUE[name], abs=4 * strength.std)
    assert strength.std < 0.03 * abs(later - TRUE[name])
    assert f"A parameter changes while the machine runs: change of {name} = " in sentence(d)
    assert f"from {finding.onset:.4g} s on" in sentence(d)
    assert d.held_out.improvement_percent > 80
    assert d.model is not None
    (by,) = d.model.changes
    assert d.model.parameters[by].default == pytest.approx(strength.value)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "later", "physics"), [("damper.d", 9.0, "viscous_friction"), ("load.m", 2.5, "added_mass")])
def test_what_acts_from_a_time_on_is_named_before_a_number_that_changes(name, later, physics):
    """A damper that is stronger from then on is viscous friction that sets in; so is a heavier load a mass that is added."""
    d = found(name, later)
    assert d.verdict == "missing_physics"
    assert [(f.explanation.physics, f.onset == pytest.approx(AT, abs=0.05)) for f in d.findings] == [(physics, True)]
    assert d.findings[0].rivals == ()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "later", "rate"), [("spring.k", 270.0, 0.8), ("damper.d", 4.0, 0.4), ("load.m", 1.8, 0.0)])
def test_a_number_that_changes_little_by_little_is_found_with_its_rate(name, later, rate):
    """A spring that tires, a damper that warms up, a load that runs out."""
    d = found(name, later, rate=rate)
    assert (d.verdict, [f.explanation.subject for f in d.findings]) == ("parameter", [(name,)])
    (finding,), last = d.findings, STEP * (N - 1)
    assert (finding.onset, finding.regime) == (None, f"little by little until {last:.4g} s")
    by, there = finding.explanation.parameters[f"change of {name}"], finding.explanation.parameters.get("rate")
    share = 1.0 if rate == 0 else 1.0 - np.exp(-rate * last)
    assert by.value == pytest.approx(share * (later - TRUE[name]), abs=4 * by.std)
    assert by.std < 0.03 * abs(later - TRUE[name])
    assert there is None if rate == 0 else (there.unit, there.value) == ("1/s", pytest.approx(rate, abs=4 * there.std))
    before = d.after.parameters[name]
    assert before.value == pytest.approx(TRUE[name], abs=4 * before.std)
    assert d.held_out.improvement_percent > 80
    assert "little by little until 5.996 s" in sentence(d)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "later"), [("load.m", 1.5), ("spring.k", 220.0)])
def test_a_number_that_is_another_one_for_a_while_is_found_with_both_times(name, later):
    d = found(name, later, back=BACK)
    assert (d.verdict, [f.explanation.subject for f in d.findings]) == ("parameter", [(name,)])
    (finding,) = d.findings
    (change,) = d.model.changes.values()
    assert change == (name, pytest.approx(AT, abs=0.02), pytest.approx(BACK, abs=0.02))
    assert change[1:] == (finding.onset, finding.until)
    by = finding.explanation.parameters[f"change of {name}"]
    assert by.value == pytest.approx(later - TRUE[name], abs=4 * by.std)
    assert d.after.parameters[name].value == pytest.approx(TRUE[name], abs=4 * d.after.parameters[name].std)
    assert d.held_out.improvement_percent > 80
    assert f"from {finding.onset:.4g} s to {finding.until:.4g} s" in sentence(d)


@pytest.mark.slow
def test_what_pushes_for_a_while_is_a_force_and_no_number_that_changes():
    d = found("push", -6.0, back=BACK)
    (finding,) = d.findings
    words = [e.physics for e in (finding.explanation, *finding.rivals)]
    assert {*words} <= {"constant_force", "input_offset"}
    assert (finding.onset, finding.until) == (pytest.approx(AT, abs=0.02), pytest.approx(BACK, abs=0.02))
    (strength,) = finding.explanation.parameters.values()
    assert abs(strength.value) == pytest.approx(6.0, abs=4 * strength.std)
    assert d.after.parameters["spring.k"].value == pytest.approx(300.0, rel=1e-3)


@pytest.mark.slow
def test_where_nothing_changes_nothing_is_found():
    assert found("", 0.0).verdict == "none"


def test_what_shared_parameters_are_tells_whether_they_may_change():
    """A constant of nature does not, whatever the model calls it."""
    declared = PointMass().declared_parameters
    shared = Model(
        name="two",
        components={"a": PointMass(), "b": PointMass()},
        parameters={"pull": declared["g"], "each": declared["m"]},
        bindings={"a.g": "pull", "b.g": "pull", "a.m": "each", "b.m": "each"},
    )
    problem = posed(run(0.2, 2e-3))
    info = compile_model(machine()).parameters[0]
    assert not _may(problem, shared, replace(info, name="pull"), ())
    assert _may(problem, shared, replace(info, name="each"), ())


def test_every_number_of_the_machine_may_change_free_or_fixed():
    problem = posed(run(1.0, 2e-3), carriage__m=95.0)
    result = smooth(problem)
    names = {c.strengths[0] for c in changing(problem, problem.model, result.solution)}
    assert names == {"carriage.m", "friction.d"}  # of what is nothing, or a rounding, there is no share
    assert {c.strengths[0] for c in library(problem, problem.model, result.solution) if c.family == "parameter"} == {"carriage.m"}
    changed = problem.model.changing("friction.d", 0.3, "carriage_m_change")
    again = {c.strengths: c.change for c in changing(problem, changed, result.solution)}
    assert again == {("carriage.m",): "carriage_m_change_", ("friction.d",): "friction_d_change"}  # one name is taken


def test_a_change_is_scored_from_its_time_on_and_looked_at_from_times_on_alone():
    problem = posed(run(1.5, 2e-3, force=lambda t, _, v: -60.0 * v * (t > 0.8)))
    result = smooth(problem)
    base = Linearised(result.solution)
    looks = looked_at(problem, problem.model, base, changing(problem, problem.model, result.solution))
    scored = screen(base, [], late(base, [], looks)).found
    assert all(s.candidate.onset is not None for s in scored)
    best = dated(base, scored[0])
    assert best.candidate.subject == ("friction.d",)
    assert best.candidate.onset == pytest.approx(0.8, abs=0.03)
    assert best.estimate == pytest.approx([60.0], rel=0.1)
    assert [e.words for e in best.candidate.edits] == [f"friction.d + friction_d_change from {best.candidate.onset:.7g} s on"]


def test_a_change_is_named_by_what_changes_and_comes_after_physics():
    problem = posed(run(1.0, 2e-3))
    whole = next(c for c in changing(problem, problem.model, smooth(problem).solution) if c.place == "carriage")
    later = whole.since(0.4)
    assert later.key != whole.key
    assert (later.onset, later.subject, later.title) == (0.4, ("carriage.m",), "change of carriage.m")
    assert later.rank > max(c.rank for c in library(problem, problem.model, smooth(problem).solution))
    (name,) = later.strengths
    _, low, high = later.start[name]
    value, least, most = whole.start["carriage.m"]
    assert (low, high) == (-30 * value, 30 * value)
    (change,) = later.changes
    assert (change.least, change.most) == (least, most) == (0.0, np.inf)
    assert later.edited(problem.model).changes == {name: ("carriage.m", 0.4)}
    assert whole.since(0.4, 0.7).edited(problem.model).changes == {name: ("carriage.m", 0.4, 0.7)}
    assert (later.size, whole.since(0.4, 0.7).size, whole.slowly(0.0, 1.0, 1.0).size) == (2, 3, 2)
    assert later.unit(problem.model, name, {}) == "kg"
    assert whole.since(None) is None
