"""An inertial measurement unit against the motion of its point in earth axes, at rest, in free fall and turning."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from backsight.models import Model, Trajectory, compile_model, simulate
from backsight.models.mechanics.spatial import Accelerometer, BodyForce, BodyTorque, Gyro, RigidBody

Array = NDArray[np.float64]
FORCE, TORQUE = np.array([0.7, -0.4, -9.0]), np.array([0.02, -0.03, 0.01])
DOWN = np.array([0.0, 0.0, 9.81])
START = {"body.u": 2.0, "body.v": -1.0, "body.p": 0.9, "body.q": -0.7, "body.r": 1.1, "body.phi": 0.2, "body.theta": -0.3}


def flown(t: Array, accelerometer: Accelerometer, gyro: Gyro, force: Array = FORCE, start: Mapping[str, float] = START) -> Trajectory:
    """A pushed and turned body with an inertial measurement unit."""
    body = RigidBody(m=1.3, Ixx=0.3, Iyy=0.5, Izz=0.7, drag_u=0.2)
    parts = {"body": body, "push": BodyForce(), "turn": BodyTorque(), "accelerometer": accelerometer, "gyro": gyro}
    model = Model(
        name="flown",
        components=parts,
        connections=[("body.frame", f"{part}.frame") for part in parts if part != "body"],
        inputs={f"f_{a}": f"push.f_{a}" for a in "xyz"} | {f"tau_{a}": f"turn.tau_{a}" for a in "xyz"},
        outputs={f"a_{a}": f"accelerometer.a_{a}" for a in "xyz"} | {rate: f"gyro.{rate}" for rate in "pqr"},
    )
    inputs = dict(zip(("f_x", "f_y", "f_z", "tau_x", "tau_y", "tau_z"), [*force, *TORQUE], strict=True))
    return simulate(compile_model(model), t, inputs, initial=start)


def readings(run: Trajectory, *names: str) -> Array:
    return np.array([run.outputs[name] for name in names]).T


def states(run: Trajectory, *names: str) -> Array:
    return np.array([run.states[f"body.{name}"] for name in names]).T


def second_difference(values: Array, h: float) -> Array:
    """Second derivative by central differences of sixth order; the three rows at each end are left out."""
    weights = np.array([2, -27, 270, -490, 270, -27, 2]) / 180 / h**2
    return np.array([weights @ values[i - 3 : i + 4] for i in range(3, len(values) - 3)])


def test_in_the_centre_of_mass_it_feels_all_forces_but_gravity_over_the_mass() -> None:
    run = flown(np.linspace(0.0, 1.0, 11), Accelerometer(), Gyro())
    expected = (FORCE - np.outer(run.states["body.u"], [0.2, 0.0, 0.0])) / 1.3
    assert readings(run, "a_x", "a_y", "a_z") == pytest.approx(expected, abs=1e-10)
    assert readings(run, "p", "q", "r") == pytest.approx(states(run, "p", "q", "r"), abs=1e-14)


def test_held_level_it_feels_its_support_upwards_and_tilted_a_part_of_it_along_the_plane() -> None:
    for phi, theta in ((0.0, 0.0), (0.3, -0.5)):
        held = -1.3 * Rotation.from_euler("ZYX", [0.0, theta, phi]).inv().apply(DOWN)
        run = flown(np.array([0.0]), Accelerometer(), Gyro(), held, {"body.phi": phi, "body.theta": theta})
        expected = [9.81 * np.sin(theta), -9.81 * np.cos(theta) * np.sin(phi), -9.81 * np.cos(theta) * np.cos(phi)]
        assert readings(run, "a_x", "a_y", "a_z")[0] == pytest.approx(expected, abs=1e-10)


def test_beside_the_centre_it_feels_how_its_own_point_moves() -> None:
    h, r = 2e-3, np.array([0.2, -0.1, 0.3])
    run = flown(np.arange(60) * h, Accelerometer(x_c=r[0], y_c=r[1], z_c=r[2]), Gyro())
    turned = Rotation.from_euler("ZYX", states(run, "psi", "theta", "phi"))
    point = states(run, "x", "y", "z") + turned.apply(r)
    felt = turned[3:-3].apply(second_difference(point, h) - DOWN, inverse=True)
    assert readings(run, "a_x", "a_y", "a_z")[3:-3] == pytest.approx(felt, abs=2e-7)
    assert np.abs(felt - readings(flown(run.t[3:-3], Accelerometer(), Gyro()), "a_x", "a_y", "a_z")).max() > 0.1


def test_gain_bias_and_misalignment_are_those_of_the_sensors_own_axes() -> None:
    t, angles = np.linspace(0.0, 0.5, 3), {"angle_x": 0.02, "angle_y": -0.05, "angle_z": 0.4}
    gain, bias = np.array([1.1, 0.9, 1.2]), np.array([0.3, -0.2, 0.1])
    values = angles | dict(zip(("gain_x", "gain_y", "gain_z", "bias_x", "bias_y", "bias_z"), [*gain, *bias], strict=True))
    true, shown = flown(t, Accelerometer(), Gyro()), flown(t, Accelerometer(**values), Gyro(**values))
    mounted = Rotation.from_euler("ZYX", [0.4, -0.05, 0.02])
    for names in (("a_x", "a_y", "a_z"), ("p", "q", "r")):
        expected = gain * mounted.apply(readings(true, *names), inverse=True) + bias
        assert readings(shown, *names) == pytest.approx(expected, abs=1e-10)


def test_a_sensor_turned_a_quarter_about_z_reads_right_as_forward() -> None:
    run = flown(np.array([0.0]), Accelerometer(angle_z=np.pi / 2), Gyro())
    assert readings(run, "a_x", "a_y")[0] == pytest.approx([FORCE[1] / 1.3, -(FORCE[0] - 0.2 * 2.0) / 1.3], abs=1e-10)
