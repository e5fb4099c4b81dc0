"""Every rotational component against a solution by hand."""

import numpy as np
import pytest

from backsight.models import Component, Model, Trajectory, compile_model, simulate
from backsight.models.mechanics.rotational import (
    AngleSensor,
    AngularAccelerationSensor,
    AngularVelocitySensor,
    ConstantTorque,
    Gear,
    Inertia,
    Rack,
    RotationalDamper,
    RotationalFixed,
    RotationalFriction,
    RotationalRigid,
    RotationalSpring,
    RotationalSpringDamper,
    Torque,
)
from backsight.models.mechanics.translational import Mass

T = np.linspace(0.0, 2.0, 81)


def wheel_with(element: Component) -> Model:
    """A driven inertia of 0.5 kg m2, with an element between it and ground."""
    return Model(
        name="wheel",
        components={"motor": Torque(), "wheel": Inertia(J=0.5)},
        connections=[("motor.flange", "wheel.flange")],
        inputs={"T": "motor.tau"},
    ).insert("wheel", element, name="element")


def run(element: Component, torque: float = 0.0, phi: float = 0.0, omega: float = 0.0) -> Trajectory:
    return simulate(compile_model(wheel_with(element)), T, {"T": torque}, initial={"wheel.phi": phi, "wheel.omega": omega})


def test_a_torsion_spring_swings_an_inertia_about_its_untwisted_angle() -> None:
    assert run(RotationalSpring(k=18.0, phi_rel0=0.1), phi=0.5).states["wheel.phi"] == pytest.approx(0.1 + 0.4 * np.cos(6.0 * T), rel=1e-8)


def test_a_damper_slows_an_inertia_exponentially() -> None:
    assert run(RotationalDamper(d=2.0), omega=3.0).states["wheel.omega"] == pytest.approx(3.0 * np.exp(-4.0 * T), rel=1e-9)


def test_a_spring_with_damping_gives_a_damped_swing() -> None:
    decay, swing = 1.5, np.sqrt(36.0 - 1.5**2)
    expected = 0.5 * np.exp(-decay * T) * (np.cos(swing * T) + decay / swing * np.sin(swing * T))
    assert run(RotationalSpringDamper(k=18.0, d=1.5), phi=0.5).states["wheel.phi"] == pytest.approx(expected, rel=1e-7, abs=1e-10)


def test_coulomb_friction_stops_an_inertia_and_keeps_it() -> None:
    result = run(RotationalFriction(tau_c=2.0), omega=6.0)  # 4 rad/s2: stops after 1.5 s
    moving = np.minimum(T, 1.5)
    assert result.states["wheel.phi"] == pytest.approx(6.0 * moving - 2.0 * moving**2, abs=1e-6)
    assert np.abs(run(RotationalFriction(tau_c=2.0), torque=1.9).states["wheel.phi"]).max() < 1e-5


def test_viscous_friction_is_a_damper() -> None:
    assert run(RotationalFriction(d=2.0), omega=3.0).states["wheel.omega"] == pytest.approx(3.0 * np.exp(-4.0 * T), rel=1e-9)


def test_a_constant_torque_at_a_body_is_a_load() -> None:
    assert run(ConstantTorque(tau=1.0), torque=3.0).states["wheel.omega"] == pytest.approx(4.0 * T, rel=1e-10, abs=1e-12)


def test_a_rigid_shaft_adds_the_inertias() -> None:
    model = Model(
        name="pair",
        components={"motor": Torque(), "a": Inertia(J=0.5), "shaft": RotationalRigid(), "b": Inertia(J=1.5)},
        connections=[("motor.flange", "a.flange"), ("a.flange", "shaft.flange_a"), ("shaft.flange_b", "b.flange")],
        inputs={"T": "motor.tau"},
        outputs={"omega": "b.omega", "tau": "shaft.tau"},
    )
    result = simulate(compile_model(model), T, {"T": 4.0})
    assert result.outputs["omega"] == pytest.approx(2.0 * T, rel=1e-10, abs=1e-13)
    assert result.outputs["tau"] == pytest.approx(np.full(len(T), 3.0))


def test_a_gear_between_elastic_shafts_passes_power_without_loss() -> None:
    model = Model(
        name="shafts",
        components={
            "a": Inertia(J=0.2),
            "in_": RotationalSpring(k=30.0),
            "gear": Gear(ratio=-3.0),
            "out": RotationalSpring(k=90.0),
            "b": Inertia(J=2.0),
        },
        connections=[
            ("a.flange", "in_.flange_a"),
            ("in_.flange_b", "gear.flange_a"),
            ("gear.flange_b", "out.flange_a"),
            ("out.flange_b", "b.flange"),
        ],
        outputs={"twist_in": "in_.phi_rel", "twist_out": "out.phi_rel"},
    )
    dae = compile_model(model)
    assert [q.name for q in dae.states] == ["a.phi", "a.omega", "b.phi", "b.omega"]
    result = simulate(dae, T, initial={"a.phi": 0.4, "b.omega": 1.0})
    energy = (
        0.1 * result.states["a.omega"] ** 2
        + 1.0 * result.states["b.omega"] ** 2
        + 15.0 * result.outputs["twist_in"] ** 2
        + 45.0 * result.outputs["twist_out"] ** 2
    )
    assert energy == pytest.approx(np.full(len(T), energy[0]), rel=1e-9)
    series = 1.0 / (1.0 / 30.0 + 9.0 / 90.0)  # at shaft a
    frequency = np.sqrt(series * (1 / 0.2 + 9 / 2.0))  # of phi_a + 3 phi_b
    across = 0.4 * np.cos(frequency * T) + 3.0 / frequency * np.sin(frequency * T)
    assert result.states["a.phi"] + 3.0 * result.states["b.phi"] == pytest.approx(across, rel=1e-7, abs=1e-9)


def test_a_rack_turns_torque_into_force() -> None:
    model = Model(
        name="belt",
        components={"motor": Torque(), "wheel": Inertia(J=0.02), "belt": Rack(r=0.1), "slide": Mass(m=3.0)},
        connections=[("motor.flange", "wheel.flange"), ("wheel.flange", "belt.wheel"), ("belt.rack", "slide.flange")],
        inputs={"T": "motor.tau"},
        outputs={"x": "slide.s", "phi": "wheel.phi"},
    )
    result = simulate(compile_model(model), T, {"T": 0.5})
    assert result.outputs["x"] == pytest.approx(0.5 * 0.1 * 0.5 / (0.02 + 3.0 * 0.01) * T**2, rel=1e-10, abs=1e-14)
    assert result.outputs["x"] == pytest.approx(0.1 * result.outputs["phi"], rel=1e-12, abs=1e-15)


def test_sensors_read_angle_velocity_and_acceleration() -> None:
    model = wheel_with(RotationalSpring(k=18.0))
    for name, sensor in {"angle": AngleSensor(), "speed": AngularVelocitySensor(), "shake": AngularAccelerationSensor()}.items():
        model = model.insert("wheel", sensor, name=name)
    model = Model(
        name="seen",
        components=model.components,
        connections=model.connections,
        inputs=model.inputs,
        outputs={"phi": "angle.phi", "omega": "speed.omega", "alpha": "shake.alpha"},
    )
    result = simulate(compile_model(model), T, {"T": 0.0}, initial={"wheel.phi": 0.4})
    assert result.outputs["phi"] == pytest.approx(0.4 * np.cos(6.0 * T), rel=1e-7, abs=1e-10)
    assert result.outputs["omega"] == pytest.approx(-2.4 * np.sin(6.0 * T), rel=1e-7, abs=1e-9)
    assert result.outputs["alpha"] == pytest.approx(-14.4 * np.cos(6.0 * T), rel=1e-7, abs=1e-8)


def test_ground_takes_the_torque_of_what_is_fixed_to_it() -> None:
    model = Model(
        name="held",
        components={"motor": Torque(), "ground": RotationalFixed()},
        connections=[("motor.flange", "ground.flange")],
        inputs={"T": "motor.tau"},
        outputs={"reaction": "ground.flange.tau"},
    )
    assert simulate(compile_model(model), [0.0, 1.0], {"T": [2.0, 3.0]}).outputs["reaction"].tolist() == [2.0, 3.0]
