"""How fast a signal moves, by its samples alone."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.recordings.rate import rate


def test_it_is_the_slope_of_a_line_whatever_the_times_are():
    t = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 50)) * 1e-3 + 1e6
    y = 3.0 * (t - t[0]) + 7.0
    y[[0, 20, 21]] = np.nan
    found = rate(t, y)
    assert found[np.isfinite(y)] == pytest.approx(3.0, rel=1e-5)
    assert np.all(found[~np.isfinite(y)] == 0.0)


def test_noise_counts_for_little_and_nothing_for_nothing():
    t = 1e-3 * np.arange(500)
    assert np.std(rate(t, 1e-3 * np.random.default_rng(1).standard_normal(500))) < 0.25
    assert np.array_equal(rate(t[:3], np.array([np.nan, 2.0, np.nan])), np.zeros(3))
