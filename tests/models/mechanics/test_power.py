"""Power of every exported one-dimensional component: what goes in is stored, passed on, or lost, and never comes from nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from one_dimensional import SLIDING, TURNING, Alone, sharp, twin

from backsight.models import Component, Model, SignalInput, compile_model
from backsight.models.connectors import Rotational, Translational
from backsight.models.mechanics import rotational as r
from backsight.models.mechanics import translational as t

Energy = Callable[[Any], Any] | None  # stored, of the relative position, or of the element's own state where it has one


def nothing(s: Any) -> Any:
    return 0 * s


AT_REST = None  # a contact stores what its force at rest has done: that is a function of the position alone


SLIDERS: list[tuple[Component, Energy]] = [
    (t.Friction(d=2.0, f_c=3.0), nothing),
    (t.StribeckFriction(d=0.2, f_c=3.0, f_s=5.0, v_s=0.3), nothing),
    (t.StribeckFriction(f_c=3.0, f_s=0.0), nothing),
    (t.LogarithmicFriction(b=2.0, c=2.0 * np.log(1e3)), nothing),
    (t.AsymmetricFriction(d_plus=2.0, d_minus=0.0, f_plus=0.0, f_minus=3.0), nothing),
    (t.PositionDependentFriction(d=0.3, f_c=2.0, amplitude=1.0, phase=0.7), nothing),
    (t.LoadFriction(mu=0.3, load=20.0), nothing),
    (t.LoadDependentFriction(mu=0.3), nothing),
    (t.StickSlip(f_sl=2.0, f_st=3.0), nothing),
    (t.StickSlip(f_sl=2.0, f_st=0.0), nothing),
    (t.DahlFriction(sigma_0=40.0, f_c=2.0, d=0.1), lambda z: 40.0 * z**2 / 2),
    (t.LuGreFriction(sigma_0=40.0, sigma_1=30.0, f_c=2.0, f_s=3.0, v_s=0.2), lambda z: 40.0 * z**2 / 2),
    (t.Damper(d=2.0), nothing),
    (t.Drag(d=0.5, c=2.0), nothing),
    (t.Spring(k=30.0, s_rel0=0.2), lambda s: 30.0 * (s - 0.2) ** 2 / 2),
    (t.CubicSpring(k=3.0, k3=20.0, s_rel0=0.2), lambda s: 3.0 * (s - 0.2) ** 2 / 2 + 20.0 * (s - 0.2) ** 4 / 4),
    (t.SpringDamper(k=30.0, d=2.0), lambda s: 30.0 * s**2 / 2),
    (t.Cogging(amplitude=2.0, period=0.3, phase=0.4), lambda s: -2.0 * 0.3 / (2 * np.pi) * ca.cos(2 * np.pi * s / 0.3 + 0.4)),
    (t.EndStop(x=0.3, k=50.0, d=8.0), AT_REST),
    (t.LowerEndStop(x=-0.3, k=50.0, d=8.0), AT_REST),
    (t.Backlash(gap=0.6, k=50.0, d=8.0), AT_REST),
    (t.Backlash(gap=0.0, k=50.0, d=8.0), AT_REST),
    (t.ConstantForce(f=3.0), lambda s: 3.0 * s),
]
ELEMENTS = [
    *SLIDERS,
    *((twin(component), energy) for component, energy in SLIDERS if not isinstance(component, t.ConstantForce)),
    (r.ConstantTorque(tau=3.0), lambda s: 3.0 * s),
    (r.EccentricWeight(tau_sin=2.0, tau_cos=-0.7), lambda s: -2.0 * ca.cos(s) - 0.7 * ca.sin(s)),
    (r.TorsionString(k=30.0, d=2.0), lambda z: 30.0 * z**2 / 2),
]
IDEAL: list[Component] = [
    t.Rigid(),
    t.ForceSensor(gain=3.0, bias=1.0),
    t.PowerSensor(gain=3.0, bias=1.0),
    r.RotationalRigid(),
    r.TorqueSensor(gain=3.0, bias=1.0),
    r.RotationalPowerSensor(gain=3.0, bias=1.0),
    r.Gear(ratio=-3.0),
    r.GearWithError(ratio=4.0, amplitude=0.3, order=3.0, phase=0.8),
    r.Rack(r=0.2),
    r.EccentricRack(r=0.2, amplitude=0.05, phase=0.8),
]
OTHERS = {  # one flange: sources may give power, sensors take none, bodies have tests of their own
    *(t.Mass, t.AddedMass, t.Fixed, t.Force, t.Position, t.Speed, t.Acceleration, t.PositionSensor, t.VelocitySensor, t.AccelerationSensor),
    *(r.Inertia, r.AddedInertia, r.Rotor, r.RotationalFixed, r.Torque, r.Angle, r.AngularSpeed, r.AngularAcceleration),
    *(r.AngleSensor, r.AngularVelocitySensor, r.AngularAccelerationSensor),
    *(t.Element, t.MovingElement, r.RotationalElement, r.TurningElement),  # bases
}


def named(component: Component) -> str:
    return repr(component)[:60]


def test_every_exported_component_is_here() -> None:
    assert {type(c) for c, _ in ELEMENTS} | {type(c) for c in IDEAL} | OTHERS == SLIDING | TURNING


@pytest.mark.parametrize(("component", "energy"), ELEMENTS, ids=lambda x: named(x) if isinstance(x, Component) else "")
def test_an_element_never_gives_more_power_than_its_energy_loses(component: Component, energy: Energy) -> None:
    generator = np.random.default_rng(11)
    n = 2000
    s, load = generator.uniform(-1.0, 1.0, n), generator.uniform(-9.0, 9.0, n)
    v = generator.choice([-1.0, 1.0], n) * 10 ** generator.uniform(-6.0, 1.0, n)
    z = generator.uniform(-0.2, 0.2, n)
    alone = Alone(component)
    x = ca.SX.sym("x")
    gradient = ca.gradient(ca.SX(energy(x)), x) if energy else x
    slope = np.asarray(ca.Function("slope", [x], [ca.densify(gradient)]).map(n)(z if alone.own else s)).ravel()
    for factor in (1e-5, 1.0, 1e2):  # how sharp the corners are
        blunt = sharp(component, factor).parameters
        widths = {name: value for name, value in blunt.items() if value != component.parameters[name]}
        force, rate = alone.at(s, v, z, load, **widths)
        slope = slope if energy else alone.at(s, 0.0, **widths)[0]
        stored = slope * (rate if alone.own else v)
        lost, scale = force * v - stored, np.abs(force * v) + np.abs(stored)
        assert np.all(lost >= -1e-12 * scale), f"width factor {factor}"
    if not {"d", "mu", "f_c", "tau_c", "f_sl", "tau_sl", "b", "f_plus", "tau_plus"} & set(component.declared_parameters):
        assert np.all(np.abs(lost) <= 1e-12 * scale)  # conservative: springs, cogging, loads
    else:
        assert np.mean(lost) > 1e-3


@pytest.mark.parametrize("component", IDEAL, ids=named)
def test_an_ideal_transmission_passes_all_power_on(component: Component) -> None:
    ports = list(component.declared_connectors.items())
    parts = {
        Translational: (t.Acceleration, t.Force, t.VelocitySensor, "v", "f"),
        Rotational: (r.AngularAcceleration, r.Torque, r.AngularVelocitySensor, "omega", "tau"),
    }
    (port_a, kind_a), (port_b, kind_b) = ((name, type(connector)) for name, connector in ports)
    _, _, sensor_a, word_a, flow_a = parts[kind_a]
    _, _, sensor_b, word_b, flow_b = parts[kind_b]
    # a gear's flange_a follows from flange_b, and a rack from its wheel: these are moved, and the others loaded
    (moved, mover), (loaded, source) = (
        ((port_b, parts[kind_b][0]), (port_a, parts[kind_a][1]))
        if kind_a is kind_b
        else ((port_a, parts[kind_a][0]), (port_b, parts[kind_b][1]))
    )
    model = Model(
        name="passed",
        components={"drive": mover(), "load": source(), "part": component, "v_a": sensor_a(), "v_b": sensor_b()},
        connections=[
            ("drive.flange", f"part.{moved}"),
            ("load.flange", f"part.{loaded}"),
            ("v_a.flange", f"part.{port_a}"),
            ("v_b.flange", f"part.{port_b}"),
        ],
        inputs={word: f"{name}.{word}" for name, kind in (("drive", mover), ("load", source)) for word in kind.declared_signals},
    )
    dae = compile_model(model)
    probe = dae.probe(f"part.{port_a}.{flow_a}", f"v_a.{word_a}", f"part.{port_b}.{flow_b}", f"v_b.{word_b}")
    generator = np.random.default_rng(5)
    for _ in range(20):
        point = [generator.normal(size=symbol.shape[0]) for symbol in (dae.dx, dae.x, dae.z, dae.u)]
        tau_a, v_a, tau_b, v_b = probe(*point, dae.parameter_values(), np.zeros(dae.w.shape[0]), 0.0).full().ravel()
        assert abs(tau_a * v_a) > 1e-6
        assert tau_a * v_a + tau_b * v_b == pytest.approx(0.0, abs=1e-12 * abs(tau_a * v_a))


@pytest.mark.parametrize("component", [c for c, _ in ELEMENTS], ids=named)
def test_a_law_has_finite_first_and_second_derivatives_at_rest_at_its_corners_and_far_away(component: Component) -> None:
    for element in (component, sharp(component), type(component)()):  # as given, as a simulation sharpens it, with strengths of zero
        alone = Alone(element)
        words = ("v_dead", "omega_dead", "v_s", "omega_s", "width", "gap")
        corners = [0.0, 0.3, -0.3, *(getattr(element, word) for word in words if hasattr(element, word))]
        for s in (*corners, 1e4, -1e4):
            for v in (*corners, 1e4, -1e4):
                found = alone.derivatives([s, v, 0.0, 0.0], alone.parameters({}))
                assert all(np.all(np.isfinite(part.full())) for part in found), (element, s, v)


def test_signal_inputs_of_friction_are_loads() -> None:
    told = {c for c in SLIDING | TURNING if any(isinstance(s, SignalInput) for s in c.declared_signals.values())} - OTHERS
    assert told == {t.LoadDependentFriction, r.RotationalLoadDependentFriction}
