"""Propellers: their lag in closed form, what they do to a body by hand, and the momentum that their rotors hold."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.spatial import AsymmetricPropeller, Propeller, PropellerInertia, RigidBody
from backsight.models.mechanics.spatial.propeller import root
from backsight.models.plants import quadrotor

TAU, GAIN, K_R = 0.08, 2.5, 1.7e-5


def lifted(propeller: Propeller, **body: float) -> Model:
    return Model(
        name="lifted",
        components={"body": RigidBody(**body), "rotor": propeller},
        connections=[("body.frame", "rotor.frame")],
        inputs={"u": "rotor.u"},
    )


def with_inertia(model: Model, inertia: PropellerInertia) -> Model:
    return model.insert("body", inertia, "inertia").connect("rotor.thrust", "inertia.thrust")


def test_the_speed_of_the_rotor_follows_its_command_with_one_time_constant() -> None:
    t, begin, u = np.linspace(0.0, 0.4, 21), 2.0, 0.8
    run = simulate(compile_model(lifted(Propeller(tau=TAU, gain=GAIN))), t, {"u": u}, initial={"rotor.thrust": begin})
    speed = GAIN * u + (np.sqrt(begin) - GAIN * u) * np.exp(-t / TAU)  # times sqrt(k_r)
    assert run.states["rotor.thrust"] == pytest.approx(speed**2, rel=1e-9)


def test_from_rest_it_spins_up_as_its_speed_does() -> None:
    t, u = np.linspace(0.0, 0.4, 21), 0.8
    run = simulate(compile_model(lifted(Propeller(tau=TAU, gain=GAIN))), t, {"u": u})
    assert np.sqrt(run.states["rotor.thrust"]) == pytest.approx(GAIN * u * (1 - np.exp(-t / TAU)), abs=2e-3)


def test_switched_off_its_thrust_dies_twice_as_fast_as_its_speed() -> None:
    t = np.linspace(0.0, 0.4, 9)
    run = simulate(compile_model(lifted(Propeller(tau=TAU, gain=GAIN))), t, {"u": 0.0}, initial={"rotor.thrust": 3.0})
    assert run.states["rotor.thrust"] == pytest.approx(3.0 * np.exp(-2 * t / TAU), rel=1e-8)


def test_the_root_of_a_thrust_is_exact_where_it_lifts_and_has_slopes_down_to_zero_and_below() -> None:
    T = ca.SX.sym("T")
    value = ca.Function("root", [T], [root(T, 1e-6), ca.jacobian(root(T, 1e-6), T), ca.hessian(root(T, 1e-6), T)[0]])
    for thrust in (0.5, 1.0, 3.7, 20.0):
        assert float(value(thrust)[0]) == pytest.approx(np.sqrt(thrust), abs=1e-12)
    for thrust in (1e-7, 0.0, -1e-7, -1e-3):
        assert all(np.isfinite(float(part)) for part in value(thrust))
        assert float(value(thrust)[0]) > 0.0


def test_its_residual_is_a_thrust_and_there_from_the_start() -> None:
    dae = compile_model(lifted(Propeller(tau=TAU, gain=GAIN)))
    (place,) = [p for p in dae.places if p.name == "rotor"]
    assert (place.unit, place.kind, place.enabled) == ("N", "balance", True)
    row = next(i for i, e in enumerate(dae.equations) if e.component == "rotor")
    dx, x, w = np.zeros(13), np.zeros(13), np.zeros(len(dae.places))
    x[-1], w[dae.places.index(place)] = 4.0, 0.3
    settled, _ = dae.function()(dx, x, [], [(4.0 - 0.3) / (GAIN * 2.0)], dae.parameter_values(), w, 0)
    assert float(settled[row]) == pytest.approx(0.0, abs=1e-12)  # gain sqrt(T) u + w = T


@pytest.mark.parametrize(("azimuth", "spin"), [(0.0, 1.0), (np.pi / 2, -1.0), (2.5, 1.0)])
def test_it_lifts_at_the_end_of_its_arm_and_turns_the_body_against_its_spin(azimuth: float, spin: float) -> None:
    arm, ratio, thrust = 0.3, 0.02, 4.0
    propeller = Propeller(gain=GAIN, arm=arm, azimuth=azimuth, spin=spin, torque_ratio=ratio)
    dae = compile_model(lifted(propeller, m=1.5, Ixx=0.01, Iyy=0.02, Izz=0.03, g=0.0))
    t = np.array([0.0])
    rates = simulate(dae, t, {"u": 0.0}, initial={"rotor.thrust": thrust}).derivatives
    torque = np.cross([arm * np.cos(azimuth), arm * np.sin(azimuth), 0.0], [0.0, 0.0, -thrust]) - [0.0, 0.0, spin * ratio * thrust]
    assert [rates[f"body.{q}"][0] for q in "uvw"] == pytest.approx([0.0, 0.0, -thrust / 1.5])
    assert [rates[f"body.{q}"][0] for q in "pqr"] == pytest.approx((torque / [0.01, 0.02, 0.03]).tolist())


@pytest.mark.parametrize(("begin", "u", "tau"), [(1.0, 0.9, TAU), (6.0, 0.5, 0.13)])
def test_an_asymmetric_one_spins_up_with_one_time_constant_and_down_with_the_other(begin: float, u: float, tau: float) -> None:
    t = np.linspace(0.0, 0.2, 9)
    model = lifted(AsymmetricPropeller(tau=TAU, tau_down=0.13, gain=GAIN))
    run = simulate(compile_model(model), t, {"u": u}, initial={"rotor.thrust": begin})
    speed = GAIN * u + (np.sqrt(begin) - GAIN * u) * np.exp(-t / tau)
    assert run.states["rotor.thrust"] == pytest.approx(speed**2, rel=1e-8)


def test_an_asymmetric_one_takes_the_place_of_a_propeller_with_shared_parameters() -> None:
    model = quadrotor().replace("rotor_1", AsymmetricPropeller(tau_down=0.11, azimuth=-np.pi / 4))
    assert model.bindings["rotor_1.tau"] == "rotor.tau"
    values = {p.name: p.value for p in compile_model(model).parameters}
    assert values["rotor_1.tau_down"] == 0.11
    assert "rotor_1.tau" not in values


def test_a_rotor_that_spins_up_turns_its_body_the_other_way() -> None:
    J, Izz, u = 2e-4, 0.03, 0.8
    t = np.linspace(0.0, 0.3, 7)
    model = with_inertia(lifted(Propeller(tau=TAU, gain=GAIN), Izz=Izz), PropellerInertia(J=J, k_r=K_R))
    run = simulate(compile_model(model), t, {"u": u}, initial={"rotor.thrust": 1.0})
    speed = np.sqrt(run.states["rotor.thrust"] / K_R)
    assert run.states["body.r"] == pytest.approx(-J * (speed - speed[0]) / Izz, rel=1e-8, abs=1e-12)


def test_a_body_with_a_spinning_rotor_keeps_their_angular_momentum_in_earth_axes() -> None:
    J, inertia = 2e-4, np.array([0.010, 0.015, 0.020])
    body = {"m": 1.0, "Ixx": inertia[0], "Iyy": inertia[1], "Izz": inertia[2]}
    model = with_inertia(lifted(Propeller(tau=TAU, gain=GAIN, spin=-1.0), **body), PropellerInertia(J=J, k_r=K_R, spin=-1.0))
    t = np.linspace(0.0, 1.0, 41)
    u = np.where(t < 0.5, 0.9, 0.3)
    initial = {"rotor.thrust": 3.0, "body.p": 1.0, "body.q": -0.5, "body.r": 2.0}
    s = simulate(compile_model(model), t, {"u": u}, initial=initial).states
    own = np.array([s["body.p"], s["body.q"], s["body.r"]]).T * inertia
    own[:, 2] -= J * np.sqrt(s["rotor.thrust"] / K_R)
    angles = np.array([s["body.psi"], s["body.theta"], s["body.phi"]]).T
    kept = Rotation.from_euler("ZYX", angles).apply(own)
    assert np.linalg.norm(kept[0] - inertia * [1.0, -0.5, 2.0]) > 0.05  # the rotor's share
    assert np.abs(kept - kept[0]).max() < 1e-8 * np.linalg.norm(kept[0])


def test_without_inertia_the_rotors_momentum_is_absent() -> None:
    model = lifted(Propeller(tau=TAU, gain=GAIN, arm=0.2))
    rng = np.random.default_rng(1)
    dx, x = rng.normal(size=13), np.abs(rng.normal(size=13))
    rows = [
        dae.function()(dx, x, [], [0.5], dae.parameter_values(), np.zeros(len(dae.places)), 0)[0].full()
        for dae in (compile_model(model), compile_model(with_inertia(model, PropellerInertia())))
    ]
    assert rows[0] == pytest.approx(rows[1], abs=1e-14)


def test_one_time_constant_can_be_that_of_all_rotors() -> None:
    slow = quadrotor().with_values(**{"rotor.tau": 0.2})
    run = simulate(compile_model(slow), np.array([0.0, 0.1]), {f"u_{i}": 0.0 for i in range(1, 5)}, initial={"rotor_3.thrust": 2.0})
    assert run.states["rotor_3.thrust"][1] == pytest.approx(2.0 * np.exp(-1.0), rel=1e-8)
