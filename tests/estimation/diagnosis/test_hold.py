"""Inputs that run straight between their rows, against a machine whose motion is known in closed form, and such as are held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import NOISE, posed, run

from backsight.estimation import Problem, smooth
from backsight.estimation.diagnosis.diagnose import diagnose
from backsight.estimation.diagnosis.search.choice import CLEAR
from backsight.estimation.diagnosis.search.refit import HELD, QUICKLY
from backsight.estimation.diagnosis.start.as_it_is import AsItIs
from backsight.estimation.diagnosis.start.hold import promised, straight, with_better_hold
from backsight.models.plants import actuator

M, D, W = 95.0, 203.0, {"carriage": 0.02}


def smoothly_driven(duration: float = 1.5, step: float = 2e-3) -> Problem:
    """m x'' + d x' = sum of cosines, at its steady state: x is what each of them makes of it."""
    t = np.arange(0.0, duration, step)
    force, x = np.zeros_like(t), np.zeros_like(t)
    for frequency, amplitude, phase in ((1.0, 90.0, 0.3), (2.3, 80.0, 1.9), (4.0, 120.0, 4.0)):
        omega = 2 * np.pi * frequency
        force += amplitude * np.cos(omega * t + phase)
        x += np.real(amplitude * np.exp(1j * (omega * t + phase)) / (-M * omega**2 + 1j * D * omega))
    x += NOISE * np.random.default_rng(3).standard_normal(len(t))
    made = run(0.1)
    return posed(replace(made, time=t, inputs={"F": force}, outputs={"x": x}), W=W)


def smoothed(problem: Problem) -> AsItIs:
    return AsItIs(problem=problem, result=smooth(problem), settings=QUICKLY)


def test_a_straight_line_has_the_mean_of_its_ends():
    assert straight(np.arange(3.0), np.array([1.0, 3.0, 2.0])) == pytest.approx([2.0, 2.5, 2.0])


def test_inputs_that_run_smoothly_are_taken_for_straight():
    problem = smoothly_driven()
    first = smoothed(problem)
    assert promised(problem, actuator(), first.result) > CLEAR
    better, said = with_better_hold(problem, actuator(), first, smoothed)
    assert {r.hold for r in better.problem.recordings} == {"linear"}
    assert "straight" in said
    assert abs(better.result.parameters["carriage.m"].value - M) < 0.2 * abs(first.result.parameters["carriage.m"].value - M)


def test_inputs_that_are_held_stay_so():
    problem = posed(run(1.5, 2e-3), W=W)
    first = smoothed(problem)
    assert promised(problem, actuator(), first.result) < 0
    assert with_better_hold(problem, actuator(), first, smoothed) == (first, "")


@pytest.mark.parametrize(("held_rests", "straight_rests", "taken"), [(True, False, False), (False, True, True), (False, False, False)])
def test_what_does_not_come_to_rest_is_no_better(held_rests, straight_rests, taken, monkeypatch):
    """Though a score promises it."""
    problem, result = posed(run(0.5, 2e-3), W=W), smooth(posed(run(0.5, 2e-3), W=W))
    monkeypatch.setattr("backsight.estimation.diagnosis.start.hold.promised", lambda *_: 50.0)

    def left(rests: bool) -> AsItIs:
        return AsItIs(problem=problem, result=replace(result, solver=replace(result.solver, converged=rests)), settings=QUICKLY)

    first, second = left(held_rests), left(straight_rests)
    better, said = with_better_hold(problem, actuator(), first, lambda _: second)
    assert better is (second if taken else first)
    assert ("do not come to rest" in said) is taken


def test_weights_from_the_data_are_not_held_against_held_ones(monkeypatch):
    problem = posed(run(0.5, 2e-3), W=W)
    first = replace(smoothed(problem), settings=HELD)
    monkeypatch.setattr("backsight.estimation.diagnosis.start.hold.promised", lambda *_: 50.0)
    assert with_better_hold(problem, actuator(), first, smoothed) == (first, "")


def test_what_a_study_says_is_not_asked_again():
    problem = smoothly_driven()
    told = replace(problem, recordings=[replace(r, hold="linear") for r in problem.recordings])
    assert promised(told, actuator(), smooth(told)) == 0.0


@pytest.mark.slow
def test_a_diagnosis_says_so_and_finds_nothing_else():
    problem = smoothly_driven(3.0)
    d = diagnose(replace(problem, weights=replace(problem.weights, W={})))
    assert any("run straight" in note for note in d.notes)
    assert d.verdict == "none"
    assert {r.hold for r in d.repaired.recordings} == {"linear"}
