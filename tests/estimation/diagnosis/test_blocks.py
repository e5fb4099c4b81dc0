"""The chance of a gain, against formulas and by simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from backsight.estimation.diagnosis.answer.verdict import FEWEST
from backsight.estimation.diagnosis.proof.blocks import block_gains, chance


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


@pytest.mark.parametrize("memory", [10.0, 20.0, 40.0, 80.0])
def test_windows_that_remember_for_as_long_as_they_last_prove_little_and_refute_nothing_by_chance(memory):
    """A hundred windows of an AR(1) process, no gain: three blocks of them refuted in a tenth to a sixth of the cases."""
    rng, proven, refuted = np.random.default_rng(3), 0, 0
    a = np.exp(-2.0 / memory)
    for _ in range(400):
        noise = np.sqrt(1 - a**2) * rng.standard_normal((2, 100))
        first = rng.standard_normal(2)
        logs = np.stack([lfilter([1.0], [1.0, -a], row, zi=[a * start])[0] for row, start in zip(noise, first, strict=True)])
        part = np.exp(0.2 * logs)[:, None, None, :]
        gains = np.array(block_gains(part, part.mean(axis=3)))
        proven += chance(gains) < 0.05
        refuted += len(gains) >= FEWEST and chance(gains) > 0.95
    assert proven / 400 < 0.13
    assert refuted / 400 < 0.08


def test_a_lone_recording_that_shows_nothing_of_an_output_is_refused_no_more_than_it_must():
    part = squares(np.full(40, 0.1))
    part[:, :, :, 5:] = np.nan
    gains = block_gains(part, np.nanmean(part, axis=3))
    assert gains == pytest.approx([0.1] * len(gains))
    assert block_gains(np.full((2, 1, 1, 9), np.nan), np.full((2, 1, 1), np.nan)) == []
