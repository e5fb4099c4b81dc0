"""Torsion springs and dampers against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, run_wheel
from scipy.special import ellipj, ellipk

from backsight.models.mechanics.rotational import (
    EccentricWeight,
    RotationalBacklash,
    RotationalCogging,
    RotationalDamper,
    RotationalSpring,
    RotationalSpringDamper,
)


def test_a_torsion_spring_swings_an_inertia_about_its_untwisted_angle() -> None:
    result = run_wheel(RotationalSpring(k=18.0, phi_rel0=0.1), phi=0.5)
    assert result.states["wheel.phi"] == pytest.approx(0.1 + 0.4 * np.cos(6.0 * T), rel=1e-8)


def test_a_damper_slows_an_inertia_exponentially() -> None:
    assert run_wheel(RotationalDamper(d=2.0), omega=3.0).states["wheel.omega"] == pytest.approx(3.0 * np.exp(-4.0 * T), rel=1e-9)


def test_a_spring_with_damping_gives_a_damped_swing() -> None:
    decay, swing = 1.5, np.sqrt(36.0 - 1.5**2)
    expected = 0.5 * np.exp(-decay * T) * (np.cos(swing * T) + decay / swing * np.sin(swing * T))
    assert run_wheel(RotationalSpringDamper(k=18.0, d=1.5), phi=0.5).states["wheel.phi"] == pytest.approx(expected, rel=1e-7, abs=1e-10)


def test_cogging_of_one_turn_is_a_pendulum() -> None:
    result = run_wheel(RotationalCogging(amplitude=2.0), phi=1.2)
    energy = 0.25 * result.states["wheel.omega"] ** 2 + 2.0 * (1 - np.cos(result.states["wheel.phi"]))
    assert energy == pytest.approx(np.full(len(T), 2.0 * (1 - np.cos(1.2))), rel=1e-9)


@pytest.mark.parametrize("down", [0.0, 0.8])
def test_an_eccentric_weight_swings_as_elliptic_functions_say(down: float) -> None:
    moment, start = 4.5, 1.9  # N.m and rad from where it hangs, which is at phi = down
    result = run_wheel(EccentricWeight(tau_sin=moment * np.cos(down), tau_cos=-moment * np.sin(down)), phi=down + start)
    k = np.sin(start / 2)
    sn = ellipj(ellipk(k**2) + np.sqrt(moment / 0.5) * T, k**2)[0]
    assert result.states["wheel.phi"] - down == pytest.approx(2 * np.arcsin(k * sn), abs=1e-6)


def test_a_wheel_in_play_keeps_its_speed_between_two_sides() -> None:
    result = run_wheel(RotationalBacklash(gap=0.4, k=500.0), omega=0.8)
    inside = np.abs(result.states["wheel.phi"]) < 0.19
    assert np.abs(result.states["wheel.omega"][inside]) == pytest.approx(np.full(inside.sum(), 0.8), abs=1e-6)
    assert np.ptp(result.states["wheel.omega"]) == pytest.approx(1.6, abs=1e-3)
