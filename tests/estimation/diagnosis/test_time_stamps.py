"""Time stamps that are off, on a mass with a damper at its steady state in closed form: what was read is what was there a little later."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording, diagnose, smooth
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.estimation.diagnosis.start.as_it_is import AsItIs
from backsight.estimation.diagnosis.start.time_stamps import with_clock
from backsight.models.plants import actuator

M, D, OFF, NOISE = 95.0, 203.0, 1e-4, 2e-6


def recorded(off: float, seed: int = 3, role: str = "fit") -> Recording:
    """m x'' + d x' = sum of cosines. off: standard deviation of the time stamps [s]."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 1.5, 1e-3)
    read = t + off * rng.standard_normal(len(t))
    force, x = np.zeros_like(t), np.zeros_like(t)
    for frequency, amplitude, phase in ((0.7, 90.0, 0.3 + seed), (1.9, 80.0, 1.9), (4.0, 120.0, 4.0 * seed)):
        omega = 2 * np.pi * frequency
        force += amplitude * np.cos(omega * t + phase)
        x += np.real(amplitude * np.exp(1j * (omega * read + phase)) / (-M * omega**2 + 1j * D * omega))
    x += NOISE * rng.standard_normal(len(t))
    return Recording(name=role, time=t, inputs={"F": force}, outputs={"x": x}, hold="linear", role=role)


def posed(*recordings: Recording) -> Problem:
    parameters = {"carriage.m": Free(90.0), "friction.d": Free(190.0), "friction.f_c": 0.0, "offset.f": 0.0}
    return Problem(model=actuator(), recordings=list(recordings), parameters=parameters)


def based(problem: Problem) -> AsItIs:
    return AsItIs(problem=problem, result=smooth(problem), settings=QUICKLY)


@pytest.mark.slow
def test_a_clock_that_is_off_is_told_and_samples_count_as_they_move():
    problem = posed(recorded(OFF))
    first = based(problem)
    assert any("say clock_std = " in note for note in first.result.notes)
    now, found, off, said = with_clock(problem, first, based)
    (own,) = now.recordings
    assert own.clock_std == pytest.approx(OFF, rel=0.35)
    assert [r.clock_std for r in off([recorded(0.0)])] == [own.clock_std]
    assert f"off by about {own.clock_std:.2g} s" in said
    assert not any("clock_std" in note for note in found.result.notes)
    for name, true in (("carriage.m", M), ("friction.d", D)):
        after = found.result.parameters[name]
        assert after.value == pytest.approx(true, abs=4 * after.std)
    assert with_clock(now, found, based)[3] == ""


@pytest.mark.slow
def test_nothing_is_missing_where_only_time_stamps_are_off():
    d = diagnose(posed(recorded(OFF), recorded(OFF, 5, "held_out")))
    assert d.verdict == "none"
    assert any("Time stamps are off" in note for note in d.notes)


def test_a_clock_that_is_right_is_left_alone():
    problem = posed(recorded(0.0))
    first = based(problem)
    assert with_clock(problem, first, based) == (problem, first, list, "")
