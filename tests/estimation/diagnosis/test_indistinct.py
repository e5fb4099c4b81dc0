"""What nobody can tell beside what was found."""

from __future__ import annotations

from dataclasses import replace

from concealed_axis import posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.findings import Judged
from backsight.estimation.diagnosis.search.indistinct import indistinct
from backsight.estimation.diagnosis.search.refit import fitted

STARTS = {"sensor_gain": 0.95, "wrong_parameter": 200.0, "quadratic_drag": 1.0}


def judged(mass: Free | float) -> dict[str, Judged]:
    """Fits of an axis whose damping is taken for 190 N s/m and is 200, by what they have beside the model; all gain about as much."""
    made = run(2.0, 2e-3, f_c=20.0, d=200.0)
    problem = posed(made, W={}, carriage__m=mass, friction__d=190.0, friction__f_c=Free(15.0, min=0.0))
    base = smooth(problem)
    there = Linearised(base.solution)
    wanted = [c for c in library(problem, problem.model, base.solution) if c.physics in STARTS and c.strengths != ("carriage.m",)]
    found = {}
    for s in screen(there, looked_at(problem, problem.model, there, wanted)).found:
        start = {s.candidate.strengths[0]: STARTS[s.candidate.physics]}
        fit = fitted(problem, problem.model, base, s.candidate, start)
        found[s.candidate.physics] = s.candidate, s, replace(fit, gain=100.0)
    return found


def test_a_sensors_gain_and_damping_cannot_be_told_apart_where_the_mass_is_free_and_can_where_it_is_known():
    free, known = judged(Free(90.0)), judged(95.109)
    for one, other in (("sensor_gain", "wrong_parameter"), ("wrong_parameter", "sensor_gain")):
        assert indistinct(free[one], [free[other]]) == [free[other]]
        assert indistinct(known[one], [known[other]]) == []
    assert indistinct(free["wrong_parameter"], [free["quadratic_drag"]]) == []
