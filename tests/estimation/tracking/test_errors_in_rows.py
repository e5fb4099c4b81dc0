"""Gross errors among honest samples of an estimator on-line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from friction_axis import FrictionAxis

from backsight.estimation import Free
from backsight.estimation.tracking import Estimator, Outcome, Sample
from backsight.ocp.moving.trajectory import Trajectory


@pytest.mark.slow
def test_a_gross_error_behind_samples_on_its_own_side_is_no_level():
    axis_rows, at = 300, 200
    axis = FrictionAxis(count=axis_rows)
    (recording,) = axis.problem.recordings
    std = 1e-3
    problem = replace(axis.problem, recordings=[replace(recording, output_std={"x": std}, output_loss={"x": "huber"})])
    noise = std * np.random.default_rng(7).standard_normal(axis_rows)
    noise[at - 4 : at] = 2.5 * std
    noise[at] = 1000 * std
    estimator = Estimator(problem, samples=50, jit=False)
    outcomes = []
    for k in range(axis_rows):
        sample = axis.sample(k)
        now = estimator.update(Sample(time=sample.time, inputs=sample.inputs, outputs={"x": float(axis.states[k, 0] + noise[k])}))
        outcomes.append(now.outcome)
        assert abs(now["carriage.s"] - axis.states[k, 0]) < 6 * max(now.std("carriage.s"), 1e-5) or k < 50
    assert outcomes[at] is Outcome.DOUBTED


def test_a_mark_that_there_is_no_sample_is_none():
    axis = FrictionAxis(count=100)
    estimator = Estimator(axis.problem, samples=20, jit=False)
    for k in range(100):
        sample = axis.sample(k)
        marked = Sample(time=sample.time, inputs=sample.inputs, outputs={"x": 1.7e308}) if k == 50 else sample
        now = estimator.update(marked)
        if k == 50:
            assert now.outcome is Outcome.PREDICTED
    assert estimator.counts[Outcome.FAILED] <= 2


def test_a_change_of_the_input_that_comes_too_late_is_no_matter():
    axis = FrictionAxis(count=100)
    one, other = (Estimator(axis.problem, samples=20, jit=False) for _ in range(2))
    for k in range(100):
        now, then = one.update(axis.sample(k)), other.update(axis.sample(k))
        np.testing.assert_array_equal(now.row(), then.row())
        one.hold(axis.sample(k).time - 0.004, {"F": 123.0})


def test_a_step_along_a_curve_is_a_trajectory_of_its_own():
    axis = FrictionAxis(count=40)
    estimator = Estimator(axis.problem, samples=20, jit=False)
    for k in range(40):
        estimator.update(axis.sample(k))
    window, rng = estimator.window, np.random.default_rng(1)
    step = Trajectory(*(1e-3 * rng.standard_normal(part.shape) for part in (window.here.x, window.here.inner, window.here.p)))
    found = window._rolled(step, 0.5)
    np.testing.assert_array_equal(found.stages, Trajectory(found.x, found.inner, found.p).stages)
    assert np.abs(found.x - window.here.moved(step, 0.5).x).max() > 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("update", ["smoothing", "filtering"])
@pytest.mark.parametrize("late", [1, 3])
def test_samples_that_come_late_in_the_end_tell_what_they_would_have_told_in_time(update, late):
    """Without friction the axis is linear, and what is learnt does not depend on when."""
    axis = FrictionAxis(count=120)
    problem = axis.posed({"friction.f_c": 0.0, "offset.f": Free(1.0)})
    whole, torn = (Estimator(problem, samples=20, update=update, jit=False) for _ in range(2))
    waiting = []
    for k in range(120):
        now = whole.update(axis.sample(k))
        if 30 <= k < 30 + late:
            held = axis.sample(k)
            waiting.append(held)
            torn.hold(held.time, held.inputs)  # the input is known in time
            continue
        then = torn.update(axis.sample(k))
        while waiting and k > 30:
            assert torn.update(waiting.pop(0)).outcome is Outcome.FILLED
        if k == 119:
            np.testing.assert_allclose(then.states, now.states, atol=1e-3 * now.states_std.min())
            np.testing.assert_allclose(then.parameters, now.parameters, atol=1e-3 * now.parameters_std.min())
            np.testing.assert_allclose(then.parameters_std, now.parameters_std, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("wild", [1e6, -1e300])
def test_one_wild_input_is_missing_and_no_more(wild):
    axis = FrictionAxis(count=300)
    one, other = (Estimator(axis.problem, samples=50, jit=False) for _ in range(2))
    for k in range(300):
        sample = axis.sample(k)
        spoilt, missing = ({"F": bad} if k == 200 else sample.inputs for bad in (wild, float("nan")))
        now = one.update(Sample(time=sample.time, inputs=spoilt, outputs=sample.outputs))
        then = other.update(Sample(time=sample.time, inputs=missing, outputs=sample.outputs))
        np.testing.assert_array_equal(now.row(), then.row())
    assert one.wild == 1
