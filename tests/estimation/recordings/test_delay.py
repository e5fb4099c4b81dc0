"""Samples moved back in time, and forth."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.recordings.delay import advance

TIME = 0.01 * np.arange(50)


def curve(t: np.ndarray) -> np.ndarray:
    """A cubic, which cubics through four samples meet exactly."""
    return 1.0 - 2.0 * t + 3.0 * t**2 - 4.0 * t**3


@pytest.mark.parametrize("delay", [0.03, 0.0137, -0.02, -0.0137])
def test_a_sample_is_what_the_sensor_shows_that_much_later_and_missing_beyond_the_ends(delay):
    moved = advance(TIME, curve(TIME), delay)
    inside = (TIME + delay >= -1e-9) & (TIME + delay <= TIME[-1] + 1e-9)
    assert np.isnan(moved[~inside]).all()
    assert np.isfinite(moved[inside]).all()
    middle = (TIME + delay >= TIME[1]) & (TIME + delay <= TIME[-2])  # towards the ends straight lines
    np.testing.assert_allclose(moved[middle], curve(TIME + delay)[middle], rtol=1e-9)


def test_whole_intervals_move_samples_as_they_are():
    y = np.random.default_rng(0).normal(size=50)
    y[7] = np.nan
    np.testing.assert_array_equal(advance(TIME, y, 0.05)[:45], y[5:])
