"""Friction of turning bodies against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, run_wheel

from backsight.models.mechanics.rotational import RotationalDahlFriction, RotationalFriction, StickSlip


def test_coulomb_friction_stops_an_inertia_and_keeps_it() -> None:
    result = run_wheel(RotationalFriction(tau_c=2.0), omega=6.0)  # 4 rad/s2: stops after 1.5 s
    moving = np.minimum(T, 1.5)
    assert result.states["wheel.phi"] == pytest.approx(6.0 * moving - 2.0 * moving**2, abs=1e-6)
    assert np.abs(run_wheel(RotationalFriction(tau_c=2.0), torque=1.9).states["wheel.phi"]).max() < 1e-5


def test_viscous_friction_is_a_damper() -> None:
    assert run_wheel(RotationalFriction(d=2.0), omega=3.0).states["wheel.omega"] == pytest.approx(3.0 * np.exp(-4.0 * T), rel=1e-9)


def test_an_inertia_breaks_away_at_one_torque_and_slides_under_a_lower_one() -> None:
    bit = StickSlip(tau_sl=0.4, tau_st=0.6)
    assert np.abs(run_wheel(bit, torque=-0.599).states["wheel.phi"]).max() < 1e-5
    assert run_wheel(bit, torque=-0.601).states["wheel.omega"] == pytest.approx(-2 * 0.201 * T, abs=1e-4)
    assert np.all(np.abs(run_wheel(bit, torque=0.599, width=0.05).states["wheel.omega"]) < 0.05)


def test_an_inertia_held_by_dahl_twists_elastically() -> None:
    result = run_wheel(RotationalDahlFriction(sigma_0=50.0, tau_c=4.0), torque=1e-5)
    assert result.states["wheel.phi"] == pytest.approx(2e-7 * (1 - np.cos(10.0 * T)), abs=2e-11)
