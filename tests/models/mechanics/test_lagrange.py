"""Equations from energies against the textbook's balances, written by hand."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from backsight.models import (
    Component,
    Equation,
    Model,
    Parameter,
    Rotational,
    Translational,
    Variable,
    balance,
    compile_model,
    equal,
    simulate,
)
from backsight.models.mechanics.lagrange import generalised_forces, virtual_work


class Swing(Component):
    """A mass on an arm of changing length under gravity, in polar coordinates: flange r along the arm, flange phi about the pivot."""

    v_r = Variable("m/s")
    omega = Variable("rad/s")
    length = Translational(optional=True)
    angle = Rotational(optional=True)
    m = Parameter("kg", 2.0, min=1e-6)
    g = Parameter("m/s2", 9.81)

    def equations(self, c: Any) -> dict[str, Equation]:
        q = r, phi = c.length.s, c.angle.phi
        kinetic = c.m / 2 * (c.v_r**2 + r**2 * c.omega**2)
        along, about = generalised_forces(c, q, (c.v_r, c.omega), kinetic, -c.m * c.g * r * ca.cos(phi))
        return {
            "rate of r": equal(c.v_r, c.der(r)),
            "rate of phi": equal(c.omega, c.der(phi)),
            "along the arm": balance(along, c.length.f, place="r"),
            "about the pivot": balance(about, c.angle.tau, place="phi"),
        }


def swing() -> Any:
    return compile_model(Model(name="swing", components={"arm": Swing()}, outputs={"r": "arm.length.s", "phi": "arm.angle.phi"}))


def test_polar_coordinates_bring_the_centrifugal_and_the_coriolis_force() -> None:
    dae = swing()
    names = [q.name for q in dae.states]
    r, v, phi, omega = 0.8, 0.3, 0.5, -1.2
    here = {"arm.length.s": r, "arm.v_r": v, "arm.angle.phi": phi, "arm.omega": omega}
    a, alpha = 0.7, 2.0
    rates = {"arm.length.s": v, "arm.v_r": a, "arm.angle.phi": omega, "arm.omega": alpha}
    residual, _ = dae.function()([rates[n] for n in names], [here[n] for n in names], [], [], dae.parameter_values(), np.zeros(2), 0.0)
    by_origin = {e.origin: float(residual[i]) for i, e in enumerate(dae.equations)}
    m, g = 2.0, 9.81
    assert by_origin["along the arm of arm"] == pytest.approx(m * (a - r * omega**2) - m * g * np.cos(phi), rel=1e-12)
    assert by_origin["about the pivot of arm"] == pytest.approx(
        m * r**2 * alpha + 2 * m * r * v * omega + m * g * r * np.sin(phi), rel=1e-12
    )


def test_what_falls_freely_in_polar_coordinates_falls_straight() -> None:
    t = np.linspace(0.0, 0.5, 26)
    run = simulate(swing(), t, initial={"arm.length.s": 1.0, "arm.angle.phi": np.pi / 2, "arm.omega": 0.5})
    across, down = run.outputs["r"] * np.sin(run.outputs["phi"]), run.outputs["r"] * np.cos(run.outputs["phi"])
    assert across == pytest.approx(np.ones(len(t)), abs=1e-9)
    assert down == pytest.approx(-0.5 * t + 9.81 / 2 * t**2, abs=1e-9)


def test_virtual_work_of_a_force_on_a_bar_is_its_torque() -> None:
    x, phi, force, torque = (ca.SX.sym(name) for name in ("x", "phi", "force", "torque"))
    on_x, on_phi = virtual_work((x, phi), [(x + 0.4 * ca.sin(phi), force), (2 * phi, torque)])
    value = ca.Function("q", [x, phi, force, torque], [on_x, on_phi])(1.0, 0.3, 5.0, 7.0)
    assert float(value[0]) == pytest.approx(5.0)
    assert float(value[1]) == pytest.approx(5.0 * 0.4 * np.cos(0.3) + 2 * 7.0)


def test_a_coordinate_that_nothing_acts_on_needs_no_force() -> None:
    q = (ca.SX.sym("q"),)
    assert virtual_work(q, [])[0].is_zero()
