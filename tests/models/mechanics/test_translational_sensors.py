"""Sensors along one line against a motion by hand: what they read, and that they take neither force nor way."""

import numpy as np
import pytest
from one_dimensional import T, body_with

from backsight.models import Component, Model, compile_model, simulate
from backsight.models.mechanics.translational import (
    AccelerationSensor,
    Force,
    ForceSensor,
    Mass,
    PositionSensor,
    PowerSensor,
    Spring,
    VelocitySensor,
)


def test_sensors_read_position_velocity_and_acceleration_and_take_no_force() -> None:
    model = body_with(Spring(k=50.0))
    sensors = {"position": PositionSensor(), "speed": VelocitySensor(), "shake": AccelerationSensor()}
    for name, sensor in sensors.items():
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
    swing = 0.4 - 0.02
    s, v, a = 0.02 + swing * np.cos(5.0 * T), -5.0 * swing * np.sin(5.0 * T), -25.0 * swing * np.cos(5.0 * T)
    result = simulate(dae, T, {"F": 1.0}, initial={"body.s": 0.4})
    assert result.outputs["s"] == pytest.approx(s, rel=1e-8)
    assert result.outputs["v"] == pytest.approx(v, rel=1e-8, abs=1e-10)
    assert result.outputs["a"] == pytest.approx(a, rel=1e-8, abs=1e-9)
    errors = {f"{name}.gain": 1.1 for name in sensors} | {"position.bias": 0.2, "speed.bias": 0.3, "shake.bias": 0.4}
    result = simulate(dae, T, {"F": 1.0}, errors, initial={"body.s": 0.4})
    assert result.outputs["s"] == pytest.approx(1.1 * s + 0.2, rel=1e-8)
    assert result.outputs["v"] == pytest.approx(1.1 * v + 0.3, rel=1e-8, abs=1e-10)
    assert result.outputs["a"] == pytest.approx(1.1 * a + 0.4, rel=1e-8, abs=1e-9)


def pair(sensor: Component, reading: str) -> Model:
    """Two bodies, 2 and 3 kg, with a sensor between them, pushed at the first."""
    return Model(
        name="pair",
        components={"motor": Force(), "a": Mass(m=2.0), "sensor": sensor, "b": Mass(m=3.0)},
        connections=[("motor.flange", "a.flange"), ("a.flange", "sensor.flange_a"), ("sensor.flange_b", "b.flange")],
        inputs={"F": "motor.f"},
        outputs={"y": f"sensor.{reading}"},
    )


def test_a_load_cell_reads_the_force_that_it_passes_on() -> None:
    dae = compile_model(pair(ForceSensor(), "f"))
    assert dae.x.shape[0] == 2
    assert simulate(dae, T, {"F": 10.0}).outputs["y"] == pytest.approx(np.full(len(T), 6.0))
    wrong = simulate(dae, T, {"F": 10.0}, {"sensor.gain": 0.9, "sensor.bias": -1.0})
    assert wrong.outputs["y"] == pytest.approx(np.full(len(T), 0.9 * 6.0 - 1.0))


def test_a_power_sensor_reads_what_the_second_body_gains() -> None:
    dae = compile_model(pair(PowerSensor(), "power"))
    assert simulate(dae, T, {"F": 10.0}).outputs["y"] == pytest.approx(6.0 * 2.0 * T, rel=1e-9, abs=1e-12)
    wrong = simulate(dae, T, {"F": 10.0}, {"sensor.gain": 0.9, "sensor.bias": -1.0})
    assert wrong.outputs["y"] == pytest.approx(0.9 * 12.0 * T - 1.0, rel=1e-9)
