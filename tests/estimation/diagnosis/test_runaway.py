"""A machine that a stiff servo moves against a force that its model lacks, as large as all others together."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.diagnosis import diagnose
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import identifiable
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.fits import Base, Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.estimation.diagnosis.search.runaway import free_again, unheld, wild, with_all_near, with_inertias_near
from backsight.estimation.diagnosis.start.as_it_is import RanAway, as_it_is
from backsight.models.mechanics.translational import Mass
from backsight.models.plants import actuator

STEP = 2e-3
STIFF = 8e3  # N/m
MASS = 95.1  # kg


def sprung(_, x, __):
    """Force of a spring [N]."""
    return -STIFF * x


def test_an_inertia_that_would_answer_for_what_is_missing_is_looked_at_near_its_guess():
    made = posed(run(3.0, STEP, force=lambda _, x, __: -4e3 * x), W={})
    found = smooth(made)
    assert found.parameters["carriage.m"].value > 180.0
    near, said = with_inertias_near(made, found)
    mass = near.parameters["carriage.m"]
    assert (mass.min, mass.max) == (45.0, 180.0)
    assert near.parameters["friction.d"] == made.parameters["friction.d"]
    assert "With nothing put right carriage.m would be" in said
    assert free_again(near).parameters == made.parameters
    assert free_again(made) is made
    given = replace(made, weights=Weights(V={"F": 1.0}))
    assert with_inertias_near(given, found) == (given, "")
    known = replace(made, parameters={**made.parameters, "carriage.m": Free(90.0, 80.0, found.parameters["carriage.m"].value / 2)})
    assert with_inertias_near(known, smooth(known)) != (known, "")
    kept = replace(made, parameters={**made.parameters, "carriage.m": Free(90.0, 80.0, 120.0)})
    assert with_inertias_near(kept, smooth(kept)) == (kept, "")


def test_scores_beside_an_inertia_near_its_guess_leave_out_what_only_that_would_do():
    made = posed(run(3.0, STEP, force=lambda _, x, __: -4e3 * x), W={})
    near, _ = with_inertias_near(made, smooth(made))
    found = smooth(near)
    n = found.solution.transcription.nlp.trajectory_size
    assert n in found.solution.held
    assert n not in unheld(near, found.solution).held
    assert unheld(made, found.solution) is found.solution
    looks = looked_at(made, made.model, Linearised(found.solution), library(made, made.model, found.solution))
    names = {look.candidate.physics for look in identifiable(Linearised(unheld(near, found.solution)), looks)}
    assert {"added_mass", "input_gain"} <= {look.candidate.physics for look in looks}
    assert "spring" in names
    assert not {"added_mass", "input_gain"} & names


def test_a_mass_near_its_guess_is_what_it_is():
    made = posed(run(2.0, STEP, f_c=20.0), W={})
    assert with_inertias_near(made, smooth(made)) == (made, "")


def guessed(problem: Problem, guess: float) -> Problem:
    """With another guess of the mass [kg]."""
    mass = problem.parameters["carriage.m"]
    return replace(problem, parameters={**problem.parameters, "carriage.m": replace(mass, guess=guess)})


@pytest.mark.parametrize(("guess", "f_c"), [(MASS / 10, 0.0), (MASS / 5, 100.0), (900.0, 300.0)])
def test_nor_has_one_run_away_that_was_merely_guessed_badly(guess, f_c):
    """Its forces explain the motion. The last one is four times too large, and yet less than half its guess: that one is not there."""
    made = guessed(posed(run(2.0, STEP, f_c=f_c), W={}), guess)
    found = smooth(made)
    assert not 0.5 < found.parameters["carriage.m"].value / guess < 2.0
    assert with_inertias_near(made, found) == (made, "")


def test_a_small_part_of_what_moves_has_not_run_away_for_forces_as_large_as_what_it_makes_alone():
    """A tool of 5 kg on a carriage of 90.1 kg that is known, in all MASS."""
    base = posed(run(2.0, STEP, f_c=10.0), W={})
    model = replace(actuator(), components={**actuator().components, "tool": Mass(m=2.0)}).connect("tool.flange", "carriage.flange")
    known = {**base.parameters, "carriage.m": 90.1, "tool.m": Free(2.0)}
    made = replace(base, model=model, parameters=known)
    found = smooth(made)
    assert found.parameters["tool.m"].value > 4.0
    assert with_inertias_near(made, found) == (made, "")


@pytest.mark.slow
@pytest.mark.parametrize(("guess", "f_c"), [(30.0, 300.0), (20.0, 200.0), (900.0, 300.0)])
def test_friction_as_strong_as_all_other_forces_is_friction_whatever_the_guess_of_the_mass(guess, f_c):
    """Held to twice its guess the mass would leave what looks like a dead zone of the drive."""
    d = diagnose(guessed(posed(run(2.0, STEP, f_c=f_c), W={}), guess), jobs=1)
    (found,) = d.findings
    assert found.explanation.words == "coulomb friction at carriage"
    assert found.explanation.parameters["f_c"].value == pytest.approx(f_c, rel=1e-3)
    assert d.after.parameters["carriage.m"].value == pytest.approx(MASS, rel=1e-3)
    assert d.before.parameters["carriage.m"].value > 2.0 * MASS
    assert d.repaired.parameters["carriage.m"].max == np.inf


def sprung_and_toothed(_, x, __):
    """Force of a spring, and of teeth 50 mm apart [N]."""
    return -6e3 * x - 150.0 * np.sin(2 * np.pi * x / 0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("guess", "f_c", "force", "truth"),
    [
        (90.0, 300.0, sprung, {"spring": STIFF, "coulomb_friction": 300.0}),
        (30.0, 150.0, sprung_and_toothed, {"spring": 6e3, "coulomb_friction": 150.0, "cogging": 150.0}),
    ],
)
def test_forces_that_are_missing_together_are_found_one_after_the_other(guess, f_c, force, truth):
    """Beside a mass that nothing tells, 1e56 kg or none at all: with any one of them it still is not told."""
    d = diagnose(guessed(posed(run(3.0, STEP, f_c=f_c, force=force), W={}), guess), jobs=1)
    words = {"spring": "k", "coulomb_friction": "f_c", "cogging": "amplitude"}
    found = {f.explanation.physics: f.explanation.parameters[words[f.explanation.physics]].value for f in d.findings}
    assert {name: abs(value) for name, value in found.items()} == pytest.approx(truth, rel=1e-3)
    assert d.after.parameters["carriage.m"].value == pytest.approx(MASS, rel=1e-3)


@pytest.mark.slow
def test_a_guess_that_is_far_off_is_nothing_that_is_missing():
    d = diagnose(guessed(posed(run(3.0, STEP), W={}), MASS / 5), jobs=1)
    assert d.verdict == "none"
    assert d.after.parameters["carriage.m"].value == pytest.approx(MASS, rel=1e-3)


@pytest.mark.slow
def test_a_mass_is_not_held_to_a_guess_that_is_far_off_once_a_spring_was_found():
    """Without the spring it ends beyond 1e20 kg; twice the guess is a third of what it is."""
    d = diagnose(guessed(posed(run(3.0, STEP, force=sprung), W={}), MASS / 6), jobs=1)
    (found,) = d.findings
    assert found.explanation.words == "spring at carriage"
    assert found.explanation.parameters["k"].value == pytest.approx(STIFF, rel=1e-3)
    assert d.after.parameters["carriage.m"].value == pytest.approx(MASS, rel=2e-3)


@pytest.mark.slow
def test_a_spring_as_strong_as_all_other_forces_is_found():
    """Without a bound the mass ends beyond 1e20 kg, and so does all that is fitted beside it."""
    d = diagnose(posed(run(3.0, STEP, force=sprung), W={}), jobs=1)
    (found,) = d.findings
    assert found.explanation.words == "spring at carriage"
    k = found.explanation.parameters["k"]
    assert k.std is not None
    assert abs(k.value - STIFF) < 4 * k.std
    assert k.value == pytest.approx(STIFF, rel=1e-3)
    assert d.after.parameters["carriage.m"].value == pytest.approx(MASS, rel=2e-3)
    assert any("grow without end" in note and "carriage.m" in note for note in d.notes)


def test_a_fit_near_the_guess_is_not_the_one_that_was_kept_of_a_free_mass(tmp_path):
    problem = posed(run(0.5, STEP, f_c=20.0))
    result = smooth(problem, settings=QUICKLY)
    friction = next(c for c in library(problem, problem.model, result.solution) if c.physics == "coulomb_friction")
    base = Base(problem=problem, model=problem.model, result=result, settings=QUICKLY, changes=())
    near = replace(base, problem=replace(problem, parameters={**problem.parameters, "carriage.m": Free(45.0, 30.0, 60.0)}))
    with ProcessPoolExecutor(1) as pool:
        fits = Fits(pool=pool, ahead=1, kept=Keep(tmp_path, problem), say=lambda _: None, end=inf)
        free, held = (fits.candidates(one, [(friction, None)])[0][2] for one in (base, near))
    assert free.result.parameters["carriage.m"].value == pytest.approx(MASS, rel=0.01)
    assert held.result.parameters["carriage.m"].value == pytest.approx(60.0)


def stuck() -> Problem:
    """A carriage that whatever holds it does not let go, by up to 17 N: its encoder reads noise."""
    t = np.arange(0.0, 4.0, STEP)
    F = 12 * np.sin(2 * np.pi * 0.7 * t) + 5 * np.sin(2 * np.pi * 2.3 * t + 1)
    x = np.random.default_rng(3).normal(0.0, 2e-6, len(t))
    log = Recording(name="axis", time=t, inputs={"F": F}, outputs={"x": x}, output_std={"x": 2e-6})
    free = {"carriage.m": Free(90.0), "friction.d": Free(190.0, min=0.0), "friction.f_c": 0.0, "offset.f": 0.0}
    return Problem(model=actuator(), recordings=[log], parameters=free)


def test_a_mass_that_grows_without_end_is_given_up_and_held_near_its_guess():
    problem = stuck()
    with pytest.raises(RanAway, match="could not be smoothed"):
        as_it_is(problem, Keep(None, problem), lambda _: None, running=False)
    near, said = with_all_near(problem)
    mass = near.parameters["carriage.m"]
    assert (mass.min, mass.max) == (45.0, 180.0)
    assert near.parameters["friction.d"] == problem.parameters["friction.d"]
    assert "grow without end" in said
    assert "carriage.m" in said
    found = as_it_is(near, Keep(None, near), lambda _: None, running=False)
    assert found.result.solver.converged
    assert not wild(near, found.result)
    assert with_all_near(near) == (near, "")


@pytest.mark.slow
def test_of_a_machine_that_never_moves_nobody_says_that_nothing_is_missing():
    found = diagnose(stuck(), seconds=30.0)
    assert found.verdict in ("undecided", "unknown_physics")
    assert any("grow without end" in note for note in found.notes)
