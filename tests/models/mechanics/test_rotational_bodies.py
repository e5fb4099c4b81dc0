"""Turning bodies and the ground against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, wheel_with

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.rotational import (
    AddedInertia,
    AngleSensor,
    AngularVelocitySensor,
    RotationalDamper,
    RotationalFixed,
    RotationalSpring,
    Rotor,
    Torque,
)


def rotor(**sensors: AngleSensor | AngularVelocitySensor) -> Model:
    """A driven rotor with bearings, 0.5 kg m2 and 2 N m s/rad."""
    return Model(
        name="rotor",
        components={"motor": Torque(), "rotor": Rotor(J=0.5, d=2.0), **sensors},
        connections=[("motor.flange", "rotor.flange"), *((f"{name}.flange", "rotor.flange") for name in sensors)],
        inputs={"T": "motor.tau"},
        outputs={name: f"{name}.{'phi' if isinstance(sensor, AngleSensor) else 'omega'}" for name, sensor in sensors.items()},
    )


def test_a_rotor_is_braked_by_its_bearings_and_its_angle_is_no_state() -> None:
    dae = compile_model(rotor(speed=AngularVelocitySensor()))
    assert [q.name for q in dae.states] == ["rotor.omega"]
    assert simulate(dae, T, {"T": 3.0}).outputs["speed"] == pytest.approx(1.5 * (1 - np.exp(-4.0 * T)), rel=1e-9, abs=1e-12)


def test_the_angle_of_a_rotor_comes_back_where_it_is_measured() -> None:
    dae = compile_model(rotor(angle=AngleSensor()))
    assert len(dae.states) == 2
    assert simulate(dae, T, {"T": 3.0}).outputs["angle"] == pytest.approx(1.5 * T - 0.375 * (1 - np.exp(-4.0 * T)), rel=1e-8, abs=1e-11)


def test_an_added_inertia_makes_a_body_heavier_and_nothing_else() -> None:
    bare = compile_model(wheel_with(RotationalDamper(d=2.0)))
    dae = compile_model(wheel_with(RotationalDamper(d=2.0)).insert("wheel", AddedInertia(J=1.5), name="extra"))
    assert [q.name for q in dae.states] == [q.name for q in bare.states]
    assert [p.name for p in dae.places] == ["wheel"]
    assert simulate(dae, T, {"T": 0.0}, initial={"wheel.omega": 3.0}).states["wheel.omega"] == pytest.approx(3.0 * np.exp(-T), rel=1e-9)


def test_ground_takes_the_torque_of_what_is_fixed_to_it() -> None:
    model = Model(
        name="held",
        components={"motor": Torque(), "spring": RotationalSpring(), "ground": RotationalFixed()},
        connections=[("motor.flange", "ground.flange"), ("spring.flange_a", "motor.flange"), ("spring.flange_b", "ground.flange")],
        inputs={"T": "motor.tau"},
        outputs={"reaction": "ground.flange.tau"},
    )
    assert simulate(compile_model(model), [0.0, 1.0], {"T": [2.0, 3.0]}).outputs["reaction"].tolist() == [2.0, 3.0]
