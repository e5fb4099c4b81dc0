"""Excitations: at rest at zero, velocities that belong to their positions, and of the size that was asked for."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.data.generators.concealed.motions import KINDS, reference

TIME = np.arange(10_000) * 1e-3
each = pytest.mark.parametrize("kind", KINDS)


@each
def test_the_velocity_is_that_of_the_position_from_rest_at_zero(kind: str) -> None:
    x, v = reference(kind, TIME, 0.15, (0.15, 2.0), np.random.default_rng(1))
    assert (x[0], v[0]) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert np.abs(x).max() == pytest.approx(0.15)
    # The trapezium rule errs where the velocity has a corner, by at most h^2 times the jump of the acceleration over eight.
    assert np.abs(np.diff(x) - (v[1:] + v[:-1]) / 2 * 1e-3).max() < 1e-6 * np.abs(np.diff(v) / 1e-3).max()


@each
def test_a_seed_gives_one_motion_and_another_seed_another(kind: str) -> None:
    one, same, other = (reference(kind, TIME, 0.15, (0.15, 2.0), np.random.default_rng(s))[0] for s in (1, 1, 2))
    assert np.array_equal(one, same)
    assert np.abs(one - other).max() > 1e-3
