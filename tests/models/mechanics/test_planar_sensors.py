"""Planar sensors on a turning arm against kinematics by hand; forces on frames."""

import math

import numpy as np
import pytest

from backsight.models import Model, Trajectory, compile_model, simulate
from backsight.models.mechanics.planar import (
    Accelerometer,
    Body,
    ConstantWorldForce,
    FrameFixed,
    Gyro,
    PointSensor,
    Revolute,
    World,
    WorldForce,
    WorldTorque,
)

G = 9.81
X_C, Y_C = 0.4, -0.1


def arm(accelerometer: Accelerometer, point: PointSensor, gyro: Gyro) -> Model:
    return Model(
        name="arm",
        components={
            "world": World(g=G, tilt=math.pi / 2),
            "ground": FrameFixed(x_0=0.2, y_0=0.3),
            "joint": Revolute(),
            "link": Body(m=1.0, I=0.5),
            "drive": WorldTorque(),
            "imu": accelerometer,
            "camera": point,
            "gyro": gyro,
        },
        connections=[
            ("ground.frame", "joint.frame_a"),
            ("joint.frame_b", "link.frame"),
            *((f"{name}.frame", "link.frame") for name in ("drive", "imu", "camera", "gyro")),
        ],
        inputs={"tau": "drive.tau"},
        outputs={"a_x": "imu.a_x", "a_y": "imu.a_y", "x": "camera.x", "y": "camera.y", "omega": "gyro.omega"},
    )


def run(accelerometer: Accelerometer, point: PointSensor | None = None, gyro: Gyro | None = None) -> Trajectory:
    dae = compile_model(arm(accelerometer, point or PointSensor(), gyro or Gyro()))
    assert (dae.z.shape[0], len(dae.states)) == (0, 2)
    return simulate(dae, np.linspace(0.0, 1.0, 11), {"tau": 0.6}, initial={"joint.phi": 0.7, "joint.omega": 2.0})


def test_an_accelerometer_feels_centripetal_and_tangential_acceleration_and_weight_in_its_own_axes() -> None:
    r = run(Accelerometer(x_c=X_C, y_c=Y_C))
    phi, omega, alpha = r.states["joint.phi"], r.states["joint.omega"], 0.6 / 0.5
    assert r.outputs["a_x"] == pytest.approx(-(omega**2) * X_C - alpha * Y_C + G * np.sin(phi), rel=1e-10)
    assert r.outputs["a_y"] == pytest.approx(-(omega**2) * Y_C + alpha * X_C + G * np.cos(phi), rel=1e-10)


def test_an_accelerometer_may_leave_gravity_out_and_has_gains_and_biases() -> None:
    r = run(Accelerometer(x_c=X_C, gravity=0.0, gain_x=1.1, gain_y=0.9, bias_x=0.3, bias_y=-0.2))
    assert r.outputs["a_x"] == pytest.approx(-1.1 * r.states["joint.omega"] ** 2 * X_C + 0.3, rel=1e-10)
    assert r.outputs["a_y"] == pytest.approx(np.full(11, 0.9 * 1.2 * X_C - 0.2), rel=1e-10)


def test_a_point_sensor_sees_the_point_in_the_world() -> None:
    r = run(Accelerometer(), PointSensor(x_c=X_C, y_c=Y_C, gain_x=2.0, gain_y=3.0, bias_x=0.1, bias_y=0.2))
    cos, sin = np.cos(r.states["joint.phi"]), np.sin(r.states["joint.phi"])
    assert r.outputs["x"] == pytest.approx(2.0 * (0.2 + X_C * cos - Y_C * sin) + 0.1, rel=1e-12)
    assert r.outputs["y"] == pytest.approx(3.0 * (0.3 + X_C * sin + Y_C * cos) + 0.2, rel=1e-12)


def test_a_gyro_reads_the_angular_velocity_with_gain_and_bias() -> None:
    r = run(Accelerometer(), gyro=Gyro(gain=1.02, bias=0.05))
    assert r.outputs["omega"] == pytest.approx(1.02 * r.states["joint.omega"] + 0.05, rel=1e-12)


def test_forces_on_a_free_body_accelerate_it_along_the_axes_of_the_world() -> None:
    model = Model(
        name="pushed",
        components={"world": World(), "body": Body(m=2.0, I=0.5), "push": WorldForce(), "wind": ConstantWorldForce(f_x=1.0, tau=0.2)},
        connections=[("push.frame", "body.frame"), ("wind.frame", "body.frame")],
        inputs={"F_x": "push.f_x", "F_y": "push.f_y"},
    )
    r = simulate(compile_model(model), [0.0, 1.0], {"F_x": 3.0, "F_y": -4.0}, initial={"body.phi": 0.3})
    assert r.states["body.v_x"][1] == pytest.approx((3.0 + 1.0) / 2.0)
    assert r.states["body.v_y"][1] == pytest.approx(-4.0 / 2.0)
    assert r.states["body.omega"][1] == pytest.approx(0.2 / 0.5)


def test_a_constant_force_at_a_point_turns_the_body_about_its_centre_by_its_lever() -> None:
    wind = ConstantWorldForce(f_x=1.5, f_y=-0.5, x_c=0.2, y_c=0.1)
    model = Model(
        name="blown", components={"world": World(), "body": Body(m=2.0, I=0.5), "wind": wind}, connections=[("wind.frame", "body.frame")]
    )
    t, phi_0 = 1e-3, 0.3
    r = simulate(compile_model(model), [0.0, t], {}, initial={"body.phi": phi_0})
    cos, sin = np.cos(phi_0), np.sin(phi_0)
    lever = (0.2 * cos - 0.1 * sin) * -0.5 - (0.2 * sin + 0.1 * cos) * 1.5
    assert r.states["body.omega"][1] == pytest.approx(lever / 0.5 * t, rel=1e-5)
    assert r.states["body.v_x"][1] == pytest.approx(1.5 / 2.0 * t)
    assert r.states["body.v_y"][1] == pytest.approx(-0.5 / 2.0 * t)
