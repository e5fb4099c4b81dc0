"""Inputs that drop out of what was recorded, and pulses that were meant, on a spring-mass machine by its exact discrete solution."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import cont2discrete
from sprung_mass import machine

from backsight.estimation import Diagnosis, Free, Problem, Recording, diagnose, smooth
from backsight.estimation.diagnosis.answer.words import sentence
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.estimation.diagnosis.start.as_it_is import AsItIs
from backsight.estimation.diagnosis.start.dropouts import Torn, with_whole_signals
from backsight.models.errors import InputError

M, K, D, STEP, N, NOISE = 2.0, 300.0, 6.0, 4e-3, 1500, 2e-6
OUT = ((300, 318), (900, 911))  # rows


def recorded(seed: int, *, meant: bool, friction: float = 0.0, role: str = "fit", late: int = 0) -> Recording:
    """A force that is held from row to row, and nothing in some rows: of what is recorded, or, where that is meant, in truth.

    late: rows by which it acts later.
    """
    rng, t = np.random.default_rng(seed), STEP * np.arange(N)
    force = 60.0 + 4.0 * np.sin(5.0 * t) + 3.0 * np.sin(17.0 * t)
    told = force.copy()
    for first, last in OUT if role == "fit" else ():
        told[first : last + 1] = 0.0
    acting = np.roll(told if meant else force, late)
    A, B, *_ = cont2discrete(
        (np.array([[0.0, 1.0], [-K / M, -(D + friction) / M]]), np.array([[0.0], [1.0 / M]]), np.eye(2), np.zeros((2, 1))), STEP
    )
    state, seen = np.array([60.0 / K, 0.0]), np.empty(N)
    for k in range(N):
        seen[k] = state[0]
        state = A @ state + B[:, 0] * acting[k]
    x = seen + NOISE * rng.standard_normal(N)
    return Recording(name=role, time=t, inputs={"F": told}, outputs={"x": x}, output_std={"x": NOISE}, role=role)


@cache
def found(*, meant: bool, friction: float = 0.0) -> Diagnosis:
    free = {"load.m": Free(1.7, min=0.1), "spring.k": Free(350.0, min=10.0), "damper.d": Free(8.0, min=0.1) if friction == 0 else D}
    recordings = [recorded(3, meant=meant, friction=friction), recorded(4, meant=meant, friction=friction, role="held_out")]
    return diagnose(Problem(model=machine(), recordings=recordings, parameters=free))


@pytest.mark.slow
def test_an_input_that_drops_out_is_told_and_mended():
    d = found(meant=False)
    assert d.verdict == "input"
    (finding,) = d.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("input:F", "input_dropout")
    lasted = STEP * sum(last - first + 1 for first, last in OUT)
    assert finding.explanation.parameters["time"].value == pytest.approx(lasted, abs=4.1 * STEP)
    assert finding.gain > 1000
    assert finding.regime.startswith("in 2 stretches: 1.196 to 1.2")
    assert "An input does not act as it was recorded: input dropout at input:F" in sentence(d)
    assert {name: d.after.parameters[name].value for name in ("load.m", "spring.k", "damper.d")} == pytest.approx(
        {"load.m": M, "spring.k": K, "damper.d": D}, rel=2e-2
    )
    assert d.held_out.improvement_percent > 50
    (whole, _) = d.repaired.recordings
    assert whole.inputs["F"].min() > 40.0


@pytest.mark.slow
def test_what_else_is_missing_is_found_beside_it():
    d = found(meant=False, friction=3.0)
    assert {(f.explanation.place, f.explanation.physics) for f in d.findings} == {
        ("input:F", "input_dropout"),
        ("damper", "wrong_parameter"),
    }


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "rows"), [("square", OUT), ("auto", OUT), ("square", ((300, 300), (700, 700)))])
def test_an_output_that_reads_nothing_for_a_while_is_told_and_left_out(loss, rows):
    made, unseen = (recorded(seed, meant=True, role="held_out") for seed in (3, 4))
    x = made.outputs["x"].copy()
    for first, last in rows:
        x[first : last + 1] = 0.0
    fit = replace(made, name="fit", role="fit", outputs={"x": x}, output_loss={"x": loss})
    free = {"load.m": Free(1.7, min=0.1), "spring.k": Free(350.0, min=10.0), "damper.d": D / 2}
    d = diagnose(Problem(model=machine(), recordings=[fit, unseen], parameters=free))
    assert {f.explanation.words for f in d.findings} == {"sensor dropout at sensor:x", "wrong parameter damper.d"}
    finding = next(f for f in d.findings if f.explanation.family == "sensor")
    assert finding.explanation.parameters["time"].value == pytest.approx(STEP * sum(last - first + 1 for first, last in rows))
    assert d.after.parameters["load.m"].value == pytest.approx(M, rel=1e-4)
    assert d.after.parameters["damper.d"].value == pytest.approx(D, rel=1e-3)


@pytest.mark.slow
def test_a_pulse_that_was_meant_is_none():
    assert found(meant=True).verdict == "none"


@pytest.mark.slow
@pytest.mark.parametrize(("meant", "late", "torn"), [(True, 0, False), (True, 10, False), (False, 0, True), (False, 3, True)])
def test_pulses_that_act_late_were_meant(meant, late, torn):
    free = {"load.m": Free(1.7, min=0.1), "spring.k": Free(350.0, min=10.0), "damper.d": Free(8.0, min=0.1)}
    problem = Problem(model=machine(), recordings=[recorded(3, meant=meant, late=late)], parameters=free)
    _, _, found = with_whole_signals(problem, lambda posed: AsItIs(problem=posed, result=smooth(posed), settings=QUICKLY))
    assert (found is not None) is torn


def test_inputs_that_are_held_out_stay_as_they_are():
    fit, unseen = recorded(3, meant=False), replace(recorded(3, meant=True), role="held_out", name="held_out")
    problem = Problem(model=machine(), recordings=[fit])
    mended = Torn(problem=problem, before=None, gains={"input:F": 100.0}).mended([fit, unseen])
    assert mended[0].inputs["F"].min() > 40.0
    assert np.array_equal(mended[1].inputs["F"], unseen.inputs["F"])


def test_a_model_that_comes_to_rest_in_no_way_is_refused_as_ever():
    problem = Problem(model=machine(), recordings=[recorded(3, meant=False)], parameters={})

    def nowhere(_: Problem):
        raise InputError("it is lost")

    with pytest.raises(InputError, match="it is lost"):
        with_whole_signals(problem, nowhere)
