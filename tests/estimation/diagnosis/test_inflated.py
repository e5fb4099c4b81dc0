"""A machine that a stiff servo moves against a force that its model lacks, as large as all others together."""

from __future__ import annotations

from dataclasses import replace

import pytest
from concealed_axis import posed, run

from backsight.estimation import Weights, smooth
from backsight.estimation.diagnosis import diagnose
from backsight.estimation.diagnosis.search.inflated import with_inertias_bounded

STEP = 2e-3
STIFF = 8e3  # N/m
MASS = 95.1  # kg


def sprung(_, x, __):
    """Force of a spring [N]."""
    return -STIFF * x


def test_an_inertia_that_would_answer_for_what_is_missing_is_bounded():
    made = posed(run(3.0, STEP, force=lambda _, x, __: -4e3 * x), W={})
    found = smooth(made)
    assert found.parameters["carriage.m"].value > 180.0
    held, said = with_inertias_bounded(made, found)
    mass = held.parameters["carriage.m"]
    assert (mass.min, mass.max) == (45.0, 180.0)
    assert held.parameters["friction.d"] == made.parameters["friction.d"]
    assert "With nothing put right carriage.m would be" in said
    given = replace(made, weights=Weights(V={"F": 1.0}))
    assert with_inertias_bounded(given, found) == (given, "")


def test_a_mass_near_its_guess_is_not():
    made = posed(run(2.0, STEP, f_c=20.0), W={})
    assert with_inertias_bounded(made, smooth(made)) == (made, "")


def guessed(problem, times):
    """With a mass that is guessed so many times too small."""
    mass = problem.parameters["carriage.m"]
    return replace(problem, parameters={**problem.parameters, "carriage.m": replace(mass, guess=MASS / times)})


@pytest.mark.parametrize(("times", "f_c"), [(10, 0.0), (5, 100.0)])
def test_nor_is_one_that_was_merely_guessed_badly(times, f_c):
    """Its forces explain the motion."""
    made = guessed(posed(run(2.0, STEP, f_c=f_c), W={}), times)
    found = smooth(made)
    assert found.parameters["carriage.m"].value > 2.0 * MASS / times
    assert with_inertias_bounded(made, found) == (made, "")


@pytest.mark.slow
def test_a_guess_that_is_far_off_is_nothing_that_is_missing():
    d = diagnose(guessed(posed(run(3.0, STEP), W={}), 5), jobs=1)
    assert d.verdict == "none"
    assert d.after.parameters["carriage.m"].value == pytest.approx(MASS, rel=1e-3)


@pytest.mark.slow
def test_a_mass_is_not_held_to_a_guess_that_is_far_off_once_a_spring_was_found():
    """Without the spring it ends beyond 1e20 kg; twice the guess is a third of what it is."""
    d = diagnose(guessed(posed(run(3.0, STEP, force=sprung), W={}), 6), jobs=1)
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
    assert any("carriage.m would be" in note for note in d.notes)
