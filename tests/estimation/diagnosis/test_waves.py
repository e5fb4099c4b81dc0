"""Periods too fine to try them all, found where a force waves along the way."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.diagnosis.waves import fine_periods


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
