"""The held-out proof, on machines from simulators that share nothing with this project, and its statistics against formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from backsight.data.generators import actuator as machine
from backsight.data.generators.run import Conditions
from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis import HeldOut
from backsight.estimation.diagnosis.proof import block_gains, chance, prove
from backsight.models.plants import actuator

NOISE, PROCESS = 2e-6, 0.02
KNOWN = {"carriage.m": Free(90.0), "friction.d": Free(250.0), "offset.f": Free(0.0)}


def record(seed: int, role: str, f_c: float, duration: float) -> Recording:
    conditions = Conditions(duration=duration, step=2e-3, noise={"x": NOISE}, process={"carriage": PROCESS})
    run = machine.record(machine.Carriage(f_c=f_c), seed=seed, conditions=conditions)
    return Recording(name=role, time=run.time, inputs=run.inputs, outputs=run.outputs, output_std={"x": NOISE}, role=role)


def proven(f_c: float, duration: float) -> HeldOut:
    """A base model without Coulomb friction against one with it."""
    fit, held = record(1, "fit", f_c, duration), record(2, "held_out", f_c, duration)
    base = Problem(model=actuator(), recordings=[fit], parameters={**KNOWN, "friction.f_c": 0.0})
    repaired = replace(base, parameters={**KNOWN, "friction.f_c": Free(5.0, min=0.0)})
    return prove((base, smooth(base)), (repaired, smooth(repaired)), [held])


@pytest.fixture(scope="module")
def friction() -> HeldOut:
    return proven(20.0, 2.0)


def test_the_right_repair_gains_much_and_surely(friction):
    assert friction.improvement_percent > 50
    assert friction.p_value < 0.01
    assert friction.recordings == ("held_out",)
    before, after, unit = friction.force["carriage"]
    assert unit == "N"
    assert before > 10
    assert after < 1
    assert list(friction.before["x"].windows) == list(friction.after["x"].windows) == [0.05, 0.2, 0.25]


def test_errors_of_the_right_model_are_what_noise_and_process_make_them(friction):
    """Var = r^2 + q^2 T^3 / 3 / m^2 for a mass under white force, T up to the horizon; more, by the start, and less, by the damping."""
    for span, rms in friction.after["x"].windows.items():
        T = np.linspace(0, span, 200)
        expected = np.sqrt(np.mean(NOISE**2 + PROCESS**2 * T**3 / 3 / 95.1**2))
        assert 0.8 * expected < rms < 2.0 * expected


def test_a_repair_of_what_is_not_missing_gains_nothing():
    found = proven(0.0, 3.0)
    assert abs(found.improvement_percent) < 2
    assert found.p_value > 0.05


def test_the_chance_is_that_of_students_t():
    gains = np.random.default_rng(0).normal(0.1, 0.2, 12)
    assert chance(gains) == pytest.approx(stats.ttest_1samp(gains, 0.0, alternative="greater").pvalue, rel=1e-12)
    assert chance(np.array([0.5, 0.5, 0.5])) == 0.0
    assert chance(np.array([-0.5, -0.5])) == 1.0
    assert chance(np.zeros(4)) == 0.5
    assert chance(np.array([0.3])) == 1.0


def squares(ratio: np.ndarray) -> np.ndarray:
    """Mean squares (2, 1, 1, M) of windows with this gain in the logarithm of their rms."""
    return np.array([np.exp(2 * ratio), np.ones_like(ratio)])[:, None, None, :]


def test_blocks_of_independent_windows_are_many_and_their_gains_are_those_of_the_windows():
    part = squares(np.full(90, 0.2) + 1e-3 * np.random.default_rng(1).standard_normal(90))
    gains = block_gains(part, part.mean(axis=3))
    assert 10 <= len(gains) <= 30
    assert gains == pytest.approx([0.2] * len(gains), abs=2e-3)


def test_blocks_grow_with_the_memory_of_the_windows_so_that_the_chance_stays_what_it_says():
    """White windows averaged over eight, no gain on average: the p-value is uniform, up to what a few blocks can do."""
    rng, found = np.random.default_rng(2), []
    for _ in range(400):
        white = rng.standard_normal(307)
        part = squares(0.02 * np.convolve(white, np.ones(8) / np.sqrt(8), "valid"))
        found.append(chance(np.array(block_gains(part, part.mean(axis=3)))))
    share = np.mean(np.array(found) < 0.05)
    assert 0.01 < share < 0.10


def test_a_lone_recording_that_shows_nothing_of_an_output_is_refused_no_more_than_it_must():
    part = squares(np.full(40, 0.1))
    part[:, :, :, 5:] = np.nan
    gains = block_gains(part, np.nanmean(part, axis=3))
    assert gains == pytest.approx([0.1] * len(gains))
    assert block_gains(np.full((2, 1, 1, 9), np.nan), np.full((2, 1, 1), np.nan)) == []
