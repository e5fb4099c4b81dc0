"""How far the stages of a window trust what a rounded sign says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backsight.estimation import Problem, Recording, Weights
from backsight.estimation.tracking import Estimator
from backsight.estimation.tracking.tuning import GROSS, of_weights
from backsight.models.mechanics.translational import AccelerationSensor
from backsight.models.plants import actuator
from backsight.ocp.moving.trajectory import Trajectory

MASS, F_C, WIDTH, STEP, STD, NOISE = 10.0, 20.0, 0.01, 0.01, 0.02, np.array([1e-5, 0.02])


def estimator():
    """Of an axis with an accelerometer, all parameters known."""
    bare = actuator()
    model = replace(
        bare,
        components={**bare.components, "shaker": AccelerationSensor()},
        connections=(*bare.connections, ("carriage.flange", "shaker.flange")),
        outputs={**bare.outputs, "a": "shaker.a"},
    )
    time = STEP * np.arange(5)
    recording = Recording(name="axis", time=time, inputs={"F": 0 * time}, outputs={"x": 0 * time, "a": 0 * time})
    known = {"carriage.m": MASS, "friction.f_c": F_C, "friction.d": 5.0, "friction.width": WIDTH, "offset.f": 0.0}
    weights = Weights(W={"carriage": STD}, V={"x": NOISE[0], "a": NOISE[1]})
    settled = Problem(model=model, recordings=[recording], parameters=known, weights=weights)
    facts = {"widths": {}, "stages": 1, "sampling": STEP, "gap": 1.0, "noise": NOISE, "corner": np.full(2, GROSS)}
    return Estimator(settled, samples=4, tuning=of_weights(settled, force_std={"carriage": STD}, **facts))


def test_a_reading_of_the_acceleration_is_as_uncertain_as_the_rounded_sign_changes_within_its_stage():
    one = estimator()
    window = one.window
    v = np.array([-0.5, -0.3, -0.015, 0.005, 0.3])
    for _ in range(4):
        window.push(np.concatenate([[STEP, 0.0], np.zeros(2), np.zeros(2), [1 / STD], 1 / NOISE]))
    # the positions of a velocity that is linear over each stage, which cubic splines hold exactly
    s = np.concatenate([[0.0], np.cumsum(STEP * (v[1:] + v[:-1]) / 2)])
    at = np.argsort([q.name == "carriage.v" for q in window.stage.dae.states])
    window.here = Trajectory(np.array([s, v])[at], window.here.inner, window.here.p)
    one.room.doubt, window.passed = np.zeros((1, 3)), 1  # the newest stage alone is new
    one.room.given(window)
    force = F_C * np.tanh(np.column_stack([v[:-1], (v[:-1] + v[1:]) / 2, v[1:]]) / WIDTH)
    expected = np.hypot(NOISE[1], np.ptp(force, axis=1) / MASS)
    np.testing.assert_allclose(1 / window.d[-1], expected, rtol=1e-3)
    assert 1 / window.d[-1, 0] == pytest.approx(NOISE[1], rel=1e-5)
    assert 1 / window.d[-1, 2] > 20 * NOISE[1]
    np.testing.assert_allclose(1 / window.d[-2], NOISE[0])
    # the balance has room for the whole law where the velocity falls below its change, and none far from zero
    np.testing.assert_allclose(1 / window.d[-3], [STD, F_C * STEP**0.5, F_C * STEP**0.5, F_C * STEP**0.5], rtol=1e-5)


def test_a_reading_that_is_missing_stays_missing():
    one = estimator()
    one.window.push(np.concatenate([[STEP, 0.0], np.zeros(2), np.zeros(2), [1 / STD], [1 / NOISE[0], 0.0]]))
    one.room.given(one.window)
    assert one.window.d[-1, 0] == 0.0
    assert one.window.d[-2, 0] == pytest.approx(1 / NOISE[0])
