"""Sensors about one axis against a motion by hand."""

import numpy as np
import pytest
from one_dimensional import T, wheel_with

from backsight.models import Component, Model, compile_model, simulate
from backsight.models.mechanics.rotational import (
    AngleSensor,
    AngularAccelerationSensor,
    AngularVelocitySensor,
    Inertia,
    RotationalPowerSensor,
    RotationalSpring,
    Torque,
    TorqueSensor,
)


def test_sensors_read_angle_velocity_and_acceleration() -> None:
    model = wheel_with(RotationalSpring(k=18.0))
    sensors = {"angle": AngleSensor(), "speed": AngularVelocitySensor(), "shake": AngularAccelerationSensor()}
    for name, sensor in sensors.items():
        model = model.insert("wheel", sensor, name=name)
    model = Model(
        name="seen",
        components=model.components,
        connections=model.connections,
        inputs=model.inputs,
        outputs={"phi": "angle.phi", "omega": "speed.omega", "alpha": "shake.alpha"},
    )
    dae = compile_model(model)
    phi, omega, alpha = 0.4 * np.cos(6.0 * T), -2.4 * np.sin(6.0 * T), -14.4 * np.cos(6.0 * T)
    result = simulate(dae, T, {"T": 0.0}, initial={"wheel.phi": 0.4})
    assert result.outputs["phi"] == pytest.approx(phi, rel=1e-7, abs=1e-10)
    assert result.outputs["omega"] == pytest.approx(omega, rel=1e-7, abs=1e-9)
    assert result.outputs["alpha"] == pytest.approx(alpha, rel=1e-7, abs=1e-8)
    errors = {f"{name}.gain": 0.9 for name in sensors} | {"angle.bias": 0.2, "speed.bias": 0.3, "shake.bias": 0.4}
    result = simulate(dae, T, {"T": 0.0}, errors, initial={"wheel.phi": 0.4})
    assert result.outputs["phi"] == pytest.approx(0.9 * phi + 0.2, rel=1e-7, abs=1e-9)
    assert result.outputs["omega"] == pytest.approx(0.9 * omega + 0.3, rel=1e-7, abs=1e-8)
    assert result.outputs["alpha"] == pytest.approx(0.9 * alpha + 0.4, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize(
    ("sensor", "reading", "expected"),
    [(TorqueSensor(), "tau", np.full(len(T), 6.0)), (RotationalPowerSensor(), "power", 12.0 * T)],
    ids=["torque", "power"],
)
def test_a_sensor_in_the_shaft_reads_what_the_second_body_takes(sensor: Component, reading: str, expected: np.ndarray) -> None:
    model = Model(
        name="pair",
        components={"motor": Torque(), "a": Inertia(J=2.0), "sensor": sensor, "b": Inertia(J=3.0)},
        connections=[("motor.flange", "a.flange"), ("a.flange", "sensor.flange_a"), ("sensor.flange_b", "b.flange")],
        inputs={"T": "motor.tau"},
        outputs={"y": f"sensor.{reading}"},
    )
    dae = compile_model(model)
    assert simulate(dae, T, {"T": 10.0}).outputs["y"] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    wrong = simulate(dae, T, {"T": 10.0}, {"sensor.gain": 0.9, "sensor.bias": -1.0})
    assert wrong.outputs["y"] == pytest.approx(0.9 * expected - 1.0, rel=1e-9)
