"""Sensors of an inertial measurement unit: they take no force.   reading = gain * S^T quantity + bias

S = R_z(angle_z) R_y(angle_y) R_x(angle_x), from the axes of the sensor to those of the body, is its misalignment; every axis has its own
gain and bias.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...connectors import BodyFrame
from ...language import Component, Equation, Parameter, Shared, SignalOutput, equal
from .bodies import RigidBody
from .rotation import Vector, rotation, specific_force, velocities


class BodySensor(Component):
    """Base of the sensors on a body in space: three axes with a gain each, and a misalignment.

    Connectors: frame (takes no force)
    Parameters: gain_x, gain_y, gain_z [1], 1 by default; angle_x, angle_y, angle_z [rad] misalignment, 0 by default
    """

    frame = BodyFrame()
    gain_x = Parameter("1", 1.0, description="gain along x")
    gain_y = Parameter("1", 1.0, description="gain along y")
    gain_z = Parameter("1", 1.0, description="gain along z")
    angle_x = Parameter("rad", 0.0, nominal=1.0, description="misalignment about x")
    angle_y = Parameter("rad", 0.0, nominal=1.0, description="misalignment about y")
    angle_z = Parameter("rad", 0.0, nominal=1.0, description="misalignment about z")

    def readings(self, c: Any, quantity: Vector) -> Vector:
        """What it shows of a quantity in the axes of the body."""
        gain, bias = ca.vertcat(c.gain_x, c.gain_y, c.gain_z), ca.vertcat(c.bias_x, c.bias_y, c.bias_z)
        return gain * (rotation(c.angle_x, c.angle_y, c.angle_z).T @ quantity) + bias

    def equations(self, c: Any) -> dict[str, Equation]:
        flows = ("f_x", "f_y", "f_z", "tau_x", "tau_y", "tau_z")
        return {f"no {flow}": equal(getattr(c.frame, flow), 0) for flow in flows}


class Accelerometer(BodySensor):
    """Specific force at a point of a body: all forces but gravity over the mass.   s = nu' + omega x nu - g R^T e_z at the centre of mass

    At r = (x_c, y_c, z_c) from there:   s + omega' x r + omega x (omega x r).

    Signals:    a_x, a_y, a_z [m/s2]
    Connectors: frame (takes no force)
    Parameters: x_c, y_c, z_c [m] the point in the frame, 0 by default; gain_x, gain_y, gain_z [1], 1 by default; bias_x, bias_y, bias_z
                [m/s2], 0 by default; angle_x, angle_y, angle_z [rad] misalignment, 0 by default
    Shared:     body, its attitude and gravity
    """

    a_x = SignalOutput("m/s2", description="measured specific force along x")
    a_y = SignalOutput("m/s2", description="measured specific force along y")
    a_z = SignalOutput("m/s2", description="measured specific force along z")
    body = Shared(RigidBody)
    x_c = Parameter("m", 0.0, description="the point in the frame")
    y_c = Parameter("m", 0.0, description="the point in the frame")
    z_c = Parameter("m", 0.0, description="the point in the frame")
    bias_x = Parameter("m/s2", 0.0, description="bias along x")
    bias_y = Parameter("m/s2", 0.0, description="bias along y")
    bias_z = Parameter("m/s2", 0.0, description="bias along z")

    def equations(self, c: Any) -> dict[str, Equation]:
        a = self.readings(c, specific_force(c, ca.vertcat(c.x_c, c.y_c, c.z_c)))
        return {**super().equations(c), "reading x": equal(c.a_x, a[0]), "reading y": equal(c.a_y, a[1]), "reading z": equal(c.a_z, a[2])}


class Gyro(BodySensor):
    """Angular velocity of a body.   (p, q, r) = gain * S^T omega + bias

    Signals:    p, q, r [rad/s]
    Connectors: frame (takes no force)
    Parameters: gain_x, gain_y, gain_z [1], 1 by default; bias_x, bias_y, bias_z [rad/s], 0 by default; angle_x, angle_y, angle_z [rad]
                misalignment, 0 by default
    """

    p = SignalOutput("rad/s", description="measured roll rate")
    q = SignalOutput("rad/s", description="measured pitch rate")
    r = SignalOutput("rad/s", description="measured yaw rate")
    bias_x = Parameter("rad/s", 0.0, description="bias about x")
    bias_y = Parameter("rad/s", 0.0, description="bias about y")
    bias_z = Parameter("rad/s", 0.0, description="bias about z")

    def equations(self, c: Any) -> dict[str, Equation]:
        omega = self.readings(c, velocities(c.frame)[1])
        return {
            **super().equations(c),
            "reading p": equal(c.p, omega[0]),
            "reading q": equal(c.q, omega[1]),
            "reading r": equal(c.r, omega[2]),
        }
