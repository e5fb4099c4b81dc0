"""Periods too fine to try them all, found where a force waves along the way."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.diagnosis.candidates.waves import fine_periods


def moved(turns: float, samples: int, seed: int = 1) -> np.ndarray:
    """Positions of a rotor that goes to and fro, unevenly."""
    t = np.linspace(0.0, 1.0, samples)
    return 2 * np.pi * turns * (t + 0.1 * np.sin(7 * t) + 1e-5 * np.random.default_rng(seed).normal(size=samples))


@pytest.mark.parametrize(("turns", "teeth"), [(1.0, 72), (6.0, 72), (15.0, 24)])
def test_a_wave_in_noise_five_times_as_large_is_first(turns, teeth):
    where = moved(turns, 12000)
    force = np.sin(teeth * where + 0.4) + 5.0 * np.random.default_rng(2).normal(size=len(where)) + 3.0
    first = fine_periods(where, force, 60.0)[0]
    # half a wave over the span at most, which a fit closes
    assert np.ptp(where) * abs(1 / first - teeth / (2 * np.pi)) < 0.5


def test_nothing_is_finer_than_samples_can_tell():
    where = np.linspace(0.0, 1.0, 200)
    assert fine_periods(where, np.random.default_rng(3).normal(size=200), 60.0) == ()
    where = np.linspace(0.0, 1.0, 2000)
    assert min(fine_periods(where, np.random.default_rng(3).normal(size=2000), 60.0)) >= 4 / 2000
    assert fine_periods(np.ones(50), np.arange(50.0), 60.0) == ()


def test_a_wave_that_is_passed_too_fast_for_the_samples_in_a_part_of_the_record_is_seen_in_the_rest():
    """Twelve times a turn, at up to 80 rad/s and 500 samples a second: three samples of a wave at the fastest."""
    rng, t = np.random.default_rng(2), np.arange(3000) / 500.0
    position = 80.0 / 3.0 * (1.0 - np.cos(3.0 * t))
    assert np.quantile(np.abs(np.diff(position)), 0.9) > 2 * np.pi / 12 / 4
    found = fine_periods(position, np.sin(12.0 * position) + rng.standard_normal(3000), 60.0)
    assert any(period == pytest.approx(2 * np.pi / 12, rel=2e-3) for period in found)
