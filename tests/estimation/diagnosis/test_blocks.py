"""The chance of a gain, against formulas and by simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from backsight.estimation.diagnosis.blocks import block_gains, chance


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
