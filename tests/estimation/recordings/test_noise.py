"""Noise estimated from the samples alone."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from backsight.estimation.recordings.noise import Noise, noise, noise_std, varies

TIME = np.linspace(0.0, 10.0, 4001)
SMOOTH = np.sin(2 * TIME) + 0.3 * np.sin(7 * TIME)


def estimates(std: float, signal: np.ndarray, seeds: int = 10) -> np.ndarray:
    return np.array([noise_std(TIME, signal + std * np.random.default_rng(s).normal(size=len(signal))) for s in range(seeds)])


@pytest.mark.parametrize("std", [1e-6, 1e-4, 1e-2, 1.0])
def test_white_noise_on_a_smooth_signal_is_found_within_a_few_percent(std):
    found = estimates(std, SMOOTH)
    # the least over five orders is low by about the deviation of one of them
    assert np.all(np.abs(found / std - 1) < 0.12), found / std
    assert abs(found.mean() / std - 1) < 0.06


@pytest.mark.parametrize("std", [0.01, 2.0])
def test_the_unit_of_the_signal_does_not_matter(std):
    y = SMOOTH + std * np.random.default_rng(0).normal(size=len(SMOOTH))
    assert noise_std(TIME, 1e6 * y) == pytest.approx(1e6 * noise_std(TIME, y), rel=1e-9)
    assert noise_std(TIME, y + 3.0) == pytest.approx(noise_std(TIME, y), rel=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_missing_samples_do_not_bias_it(share):
    rng = np.random.default_rng(1)
    y = SMOOTH + 1e-2 * rng.normal(size=len(SMOOTH))
    y[rng.uniform(size=len(y)) < share] = np.nan
    assert noise_std(TIME[: len(y)], y) == pytest.approx(1e-2, rel=0.25)


@pytest.mark.parametrize("step", [1e-3, 0.1])
def test_a_quantised_signal_has_at_least_the_deviation_of_its_rounding(step):
    y = step * np.round(SMOOTH / step)
    assert noise_std(TIME[: len(y)], y) >= step / np.sqrt(12) * (1 - 1e-9)
    assert noise_std(TIME[: len(y)], y) < step
    slow = step * np.round(np.linspace(0, 5 * step, 2000) / step)
    assert noise_std(np.arange(2000.0), slow) == pytest.approx(step / np.sqrt(12), rel=1e-6)


def test_quantisation_and_noise_together_are_both_seen():
    step, rng = 1e-2, np.random.default_rng(2)
    y = step * np.round((SMOOTH + step * rng.normal(size=len(SMOOTH))) / step)
    assert noise_std(TIME[: len(y)], y) == pytest.approx(step * np.sqrt(1 + 1 / 12), rel=0.15)


def test_a_few_jumps_are_not_noise():
    y = SMOOTH + 1e-3 * np.random.default_rng(3).normal(size=len(SMOOTH))
    y[1500:] += 1.0
    y[3000:] -= 2.0
    assert noise_std(TIME[: len(y)], y) < 4e-3


@pytest.mark.parametrize(
    "y", [np.zeros(100), np.full(100, 7.0), np.array([1.0, np.nan, 2.0]), np.array([0.0])],
    ids=["zero", "constant", "three", "one"],
)  # fmt: skip
def test_it_is_always_positive_and_finite(y):
    assert np.isfinite(noise_std(TIME[: len(y)], y))
    assert noise_std(TIME[: len(y)], y) > 0


@pytest.mark.parametrize("value", [0.0, 1e-3, 0.25, 250.0])
def test_a_constant_tells_nothing_of_its_noise_whatever_its_rounding(value):
    """The std of a thousand times 0.001 is 4e-19."""
    y = np.full(1000, value)
    y[::7] = np.nan
    assert not varies(y)
    assert noise(TIME[:1000], y, supposed=0.07) == Noise(std=0.07, least=0.0)
    assert noise(TIME[:1000], y).std == 1e-3 * (value or 1.0)
    y[500] = 1.1 * value + 1e-3
    assert varies(y)


def test_what_a_rough_signal_is_rounded_to_is_the_least_of_its_noise_and_nothing_that_it_shows():
    """A walk in steps of .005 has differences that do not alternate."""
    walk = 0.005 * np.cumsum(np.random.default_rng(3).integers(-4, 5, 1000))
    found = noise(TIME[:1000], walk)
    assert found.least == pytest.approx(0.005 / np.sqrt(12.0))
    assert found.white == 0.0
    noisy = noise(TIME[:1000], np.random.default_rng(4).normal(0.0, 0.02, 1000))
    assert noisy.white == noisy.least == pytest.approx(0.02, rel=0.1)


def uneven(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Times, and which samples are there."""
    rng, there = np.random.default_rng(5), np.ones(len(TIME), dtype=bool)
    if kind == "every other":
        there[1::2] = False
    if kind == "a third is missing":
        there = rng.uniform(size=len(TIME)) > 1 / 3
    jitter = 0.3 * rng.uniform(-1, 1, size=len(TIME)) if kind == "jittered" else 0.0
    return TIME + jitter * (TIME[1] - TIME[0]), there


@pytest.mark.parametrize("kind", ["every other", "a third is missing", "jittered"])
def test_the_times_of_the_samples_that_are_there_count(kind):
    time, there = uneven(kind)
    y = np.sin(20 * time) + 1e-6 * np.random.default_rng(6).normal(size=len(time))
    found = noise(time, np.where(there, y, np.nan))
    assert found.std == pytest.approx(1e-6, rel=0.15)
    assert found.least == found.std


def test_a_signal_as_quick_as_the_sampling_does_not_pass_for_noise():
    time = 0.01 * np.arange(2000)
    clean, rng = np.sin(2 * np.pi * time / 0.1), np.random.default_rng(7)
    assert noise(time, clean + 1e-6 * rng.normal(size=2000)).least == 0.0
    assert noise(time, clean + 1e-2 * rng.normal(size=2000)).least == pytest.approx(1e-2, rel=0.15)


def test_a_sensor_that_filters_has_no_less_noise_than_a_converter_can_tell():
    numerator, denominator = scipy.signal.butter(4, 0.05)
    y = 0.05 * np.sin(TIME) + scipy.signal.lfilter(numerator, denominator, 1e-5 * np.random.default_rng(8).normal(size=len(TIME)))
    found = noise(TIME, y)
    assert found.std >= 0.1 * 2.0**-20 / np.sqrt(12) * 0.99
    assert found.least == 0.0


@pytest.mark.parametrize("factor", [1e-3, np.pi / 180, 1.0])
def test_the_step_of_a_converted_reading_shows_though_it_rests_most_of_the_time(factor):
    """Steps of 0.1 in another unit are off the grid by a rounding error, which is neither a step nor a noise."""
    t = np.arange(4000) * 0.005
    y = np.round(np.clip(60.0 * np.sin(t), -20.0, 20.0) / 0.1) * 0.1 + 123.4
    found = noise(t, y * factor)
    assert found.least == pytest.approx(0.1 * factor / np.sqrt(12.0), rel=0.05)
    assert found.std == pytest.approx(found.least, rel=0.05)
