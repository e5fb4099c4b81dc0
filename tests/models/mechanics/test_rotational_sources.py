"""Sources of torque and rotation against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, run_wheel

from backsight.models import Component, Model, compile_model, simulate
from backsight.models.mechanics.rotational import (
    Angle,
    AngularAcceleration,
    AngularSpeed,
    ConstantTorque,
    Inertia,
    RotationalFixed,
    RotationalSpring,
    RotationalSpringDamper,
    TorqueSensor,
)


def test_a_constant_torque_at_a_body_is_a_load() -> None:
    assert run_wheel(ConstantTorque(tau=1.0), torque=3.0).states["wheel.omega"] == pytest.approx(4.0 * T, rel=1e-10, abs=1e-12)


def turned(source: Component, word: str, element: Component) -> Model:
    """A source, a torque cell, and an element to ground."""
    return Model(
        name="turned",
        components={"source": source, "cell": TorqueSensor(), "element": element, "ground": RotationalFixed()},
        connections=[("source.flange", "cell.flange_a"), ("cell.flange_b", "element.flange_a"), ("element.flange_b", "ground.flange")],
        inputs={"u": f"source.{word}"},
        outputs={"tau": "cell.tau"},
    )


def test_an_angle_source_twists_a_spring() -> None:
    u = np.sin(3.0 * T)
    assert simulate(compile_model(turned(Angle(), "phi", RotationalSpring(k=20.0))), T, {"u": u}).outputs["tau"] == pytest.approx(20.0 * u)


def test_a_speed_source_twists_a_spring_and_a_damper() -> None:
    result = simulate(compile_model(turned(AngularSpeed(), "omega", RotationalSpringDamper(k=20.0, d=3.0))), T, {"u": 0.5})
    assert result.outputs["tau"] == pytest.approx(10.0 * T + 1.5, rel=1e-9)


def test_an_acceleration_source_turns_a_body_with_the_torque_that_it_needs() -> None:
    model = Model(
        name="carried",
        components={"source": AngularAcceleration(), "cell": TorqueSensor(), "body": Inertia(J=4.0)},
        connections=[("source.flange", "cell.flange_a"), ("cell.flange_b", "body.flange")],
        inputs={"u": "source.alpha"},
        outputs={"tau": "cell.tau", "phi": "body.phi"},
    )
    result = simulate(compile_model(model), T, {"u": 1.5}, initial={"source.omega": 1.0})
    assert result.outputs["phi"] == pytest.approx(T + 0.75 * T**2, rel=1e-9, abs=1e-12)
    assert result.outputs["tau"] == pytest.approx(np.full(len(T), 6.0))
