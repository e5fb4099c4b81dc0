"""Every translational component against a solution by hand."""

import numpy as np
import pytest
from scipy.integrate import simpson

from backsight.models import Component, Model, Trajectory, compile_model, simulate
from backsight.models.mechanics.translational import (
    AccelerationSensor,
    ConstantForce,
    Damper,
    Fixed,
    Force,
    Friction,
    Mass,
    PositionSensor,
    Rigid,
    Spring,
    VelocitySensor,
)

T = np.linspace(0.0, 2.0, 81)


def body_with(element: Component, mass: float = 2.0) -> Model:
    """A driven mass, with an element between it and ground."""
    return Model(
        name="body",
        components={"motor": Force(), "body": Mass(m=mass)},
        connections=[("motor.flange", "body.flange")],
        inputs={"F": "motor.f"},
        outputs={"x": "body.s"},
    ).insert("body", element, name="element")


def run(element: Component, force: float = 0.0, s: float = 0.0, v: float = 0.0, **parameters: float) -> Trajectory:
    values = {name.replace("__", "."): value for name, value in parameters.items()}
    return simulate(compile_model(body_with(element)), T, {"F": force}, values, {"body.s": s, "body.v": v})


def test_a_mass_falls_with_constant_acceleration() -> None:
    model = Model(
        name="free",
        components={"motor": Force(), "body": Mass(m=4.0)},
        connections=[("motor.flange", "body.flange")],
        inputs={"F": "motor.f"},
    )
    result = simulate(compile_model(model), T, {"F": 6.0}, initial={"body.s": 1.0, "body.v": -2.0})
    assert result.states["body.s"] == pytest.approx(1.0 - 2.0 * T + 0.75 * T**2, rel=1e-10)
    assert result.states["body.v"] == pytest.approx(-2.0 + 1.5 * T, rel=1e-10, abs=1e-12)


def test_a_spring_swings_a_mass_harmonically_about_its_natural_length() -> None:
    result = run(Spring(k=50.0, s_rel0=0.3), s=0.5)
    assert result.states["body.s"] == pytest.approx(0.3 + 0.2 * np.cos(5.0 * T), rel=1e-8)


def test_a_spring_and_a_mass_keep_their_energy() -> None:
    result = run(Spring(k=50.0), s=0.5, v=-1.0)
    energy = 0.5 * 2.0 * result.states["body.v"] ** 2 + 0.5 * 50.0 * result.states["body.s"] ** 2
    assert energy == pytest.approx(np.full(len(T), 7.25), rel=1e-9)


def test_a_damper_lets_the_velocity_decay_exponentially() -> None:
    result = run(Damper(d=6.0), v=3.0)
    assert result.states["body.v"] == pytest.approx(3.0 * np.exp(-3.0 * T), rel=1e-9)
    assert result.states["body.s"] == pytest.approx(1.0 - np.exp(-3.0 * T), abs=1e-10)


def test_viscous_friction_is_a_damper() -> None:
    assert run(Friction(d=6.0), v=3.0).states["body.v"] == pytest.approx(3.0 * np.exp(-3.0 * T), rel=1e-9)


def test_coulomb_friction_stops_a_body_after_the_distance_of_constant_deceleration() -> None:
    result = run(Friction(f_c=4.0), v=3.0)  # 2 m/s2: stops after 1.5 s, 2.25 m
    moving = np.minimum(T, 1.5)
    assert result.states["body.s"] == pytest.approx(3.0 * moving - moving**2, abs=2.25e-6)
    assert result.states["body.v"] == pytest.approx(3.0 - 2.0 * moving, abs=3e-6)


def test_a_force_below_coulomb_friction_does_not_move_a_body() -> None:
    result = run(Friction(f_c=4.0), force=3.9)
    assert np.abs(result.states["body.s"]).max() < 1e-6


def test_friction_only_takes_power_from_a_body_and_as_much_as_its_energy_loses() -> None:
    base = body_with(Friction(d=1.5, f_c=4.0))
    model = Model(
        name="body",
        components=base.components,
        connections=base.connections,
        inputs=base.inputs,
        outputs={"f": "element.f", "v": "element.v_rel"},
    )
    t = np.linspace(0.0, 2.0, 2001)
    result = simulate(compile_model(model), t, {"F": 0.0}, {"element.width": 0.1}, {"body.v": -2.0})
    power = result.outputs["f"] * result.outputs["v"]
    assert power.min() >= 0.0
    lost = 0.5 * 2.0 * (4.0 - result.states["body.v"][-1] ** 2)
    assert simpson(power, x=t) == pytest.approx(lost, rel=1e-9)


def test_a_constant_force_at_a_body_is_a_load() -> None:
    result = run(ConstantForce(f=3.0), force=5.0)
    assert result.states["body.v"] == pytest.approx(1.0 * T, rel=1e-10, abs=1e-13)


def test_a_rigid_coupling_adds_the_masses() -> None:
    model = Model(
        name="pair",
        components={"motor": Force(), "a": Mass(m=2.0), "joint": Rigid(), "b": Mass(m=3.0)},
        connections=[("motor.flange", "a.flange"), ("a.flange", "joint.flange_a"), ("joint.flange_b", "b.flange")],
        inputs={"F": "motor.f"},
        outputs={"v": "b.v", "f": "joint.f"},
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0]) == (2, 0)
    result = simulate(dae, T, {"F": 10.0})
    assert result.outputs["v"] == pytest.approx(2.0 * T, rel=1e-10, abs=1e-13)
    assert result.outputs["f"] == pytest.approx(np.full(len(T), 6.0))


def test_two_masses_on_a_spring_beat_at_their_reduced_mass_and_keep_momentum() -> None:
    model = Model(
        name="pair",
        components={"a": Mass(m=2.0), "spring": Spring(k=60.0), "b": Mass(m=3.0)},
        connections=[("a.flange", "spring.flange_a"), ("spring.flange_b", "b.flange")],
        outputs={"gap": "spring.s_rel"},
    )
    result = simulate(compile_model(model), T, initial={"a.s": 0.2})
    assert result.outputs["gap"] == pytest.approx(0.2 * np.cos(np.sqrt(60.0 / 1.2) * T), rel=1e-8, abs=1e-12)
    assert 2.0 * result.states["a.v"] + 3.0 * result.states["b.v"] == pytest.approx(np.zeros(len(T)), abs=1e-11)


def test_sensors_read_position_velocity_and_acceleration_and_take_no_force() -> None:
    model = body_with(Spring(k=50.0))
    for name, sensor in {"position": PositionSensor(), "speed": VelocitySensor(), "shake": AccelerationSensor()}.items():
        model = model.insert("body", sensor, name=name)
    model = Model(
        name="seen",
        components=model.components,
        connections=model.connections,
        inputs=model.inputs,
        outputs={"s": "position.s", "v": "speed.v", "a": "shake.a"},
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0]) == (2, 0)
    result = simulate(dae, T, {"F": 1.0}, initial={"body.s": 0.4})
    swing = 0.4 - 0.02
    assert result.outputs["s"] == pytest.approx(0.02 + swing * np.cos(5.0 * T), rel=1e-8)
    assert result.outputs["v"] == pytest.approx(-5.0 * swing * np.sin(5.0 * T), rel=1e-8, abs=1e-10)
    assert result.outputs["a"] == pytest.approx(-25.0 * swing * np.cos(5.0 * T), rel=1e-8, abs=1e-9)


def test_ground_takes_the_force_of_what_is_fixed_to_it() -> None:
    model = Model(
        name="held",
        components={"motor": Force(), "ground": Fixed()},
        connections=[("motor.flange", "ground.flange")],
        inputs={"F": "motor.f"},
        outputs={"reaction": "ground.flange.f"},
    )
    assert simulate(compile_model(model), [0.0, 1.0], {"F": [2.0, 3.0]}).outputs["reaction"].tolist() == [2.0, 3.0]
