"""Ideal sensors in the plane: they take no force.   reading = gain * quantity + bias"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...connectors import Frame
from ...language import Component, Equation, Expression, Parameter, Shared, SignalOutput, Variable, equal
from .turned import turned
from .world import World


class FrameSensor(Component):
    """Base of the sensors on a frame.

    Connectors: frame (takes no force)
    """

    frame = Frame()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "no force x": equal(c.frame.f_x, 0),
            "no force y": equal(c.frame.f_y, 0),
            "no torque": equal(c.frame.tau, 0),
        }


class PointSensor(FrameSensor):
    """Position of a point of a body in the world: a camera, a tracker.   (x, y) = gain * (frame + R(phi) c) + bias, each axis on its own

    Signals:    x, y [m]
    Connectors: frame (takes no force)
    Parameters: x_c, y_c [m] the point in the frame, 0 by default; gain_x, gain_y, 1 by default; bias_x, bias_y [m], 0 by default
    """

    x = SignalOutput("m", description="measured position")
    y = SignalOutput("m", description="measured position")
    x_c = Parameter("m", 0.0, description="the point in the frame")
    y_c = Parameter("m", 0.0, description="the point in the frame")
    gain_x = Parameter("1", 1.0, description="gain along x")
    gain_y = Parameter("1", 1.0, description="gain along y")
    bias_x = Parameter("m", 0.0, description="bias along x")
    bias_y = Parameter("m", 0.0, description="bias along y")

    def equations(self, c: Any) -> dict[str, Equation]:
        p_x, p_y = _point(c)
        return {
            **super().equations(c),
            "reading x": equal(c.x, c.gain_x * p_x + c.bias_x),
            "reading y": equal(c.y, c.gain_y * p_y + c.bias_y),
        }


class Accelerometer(FrameSensor):
    """Specific force at a point of a body, in the body's axes.   (a_x, a_y) = gain * R(phi)' (p'' - g) + bias, each axis on its own

    p is the point in the world and g the world's gravity in the plane; `gravity=0` leaves it out, which is the acceleration proper.

    Variables:  v_x, v_y [m/s] velocity of the point in the world
    Signals:    a_x, a_y [m/s2]
    Connectors: frame (takes no force)
    Parameters: x_c, y_c [m] the point in the frame, 0 by default; gravity [1] share of gravity in the reading, 1 by default; gain_x,
                gain_y, 1 by default; bias_x, bias_y [m/s2], 0 by default
    Shared:     world, its gravity
    """

    a_x = SignalOutput("m/s2", description="measured specific force along the body's x axis")
    a_y = SignalOutput("m/s2", description="measured specific force along the body's y axis")
    v_x = Variable("m/s", description="velocity of the point")
    v_y = Variable("m/s", description="velocity of the point")
    world = Shared(World)
    x_c = Parameter("m", 0.0, description="the point in the frame")
    y_c = Parameter("m", 0.0, description="the point in the frame")
    gravity = Parameter("1", 1.0, description="share of gravity in the reading")
    gain_x = Parameter("1", 1.0, description="gain along x")
    gain_y = Parameter("1", 1.0, description="gain along y")
    bias_x = Parameter("m/s2", 0.0, description="bias along x")
    bias_y = Parameter("m/s2", 0.0, description="bias along y")

    def equations(self, c: Any) -> dict[str, Equation]:
        p_x, p_y = _point(c)
        s_x, s_y = c.der(c.v_x) - c.gravity * c.world.a_x, c.der(c.v_y) - c.gravity * c.world.a_y
        cos, sin = ca.cos(c.frame.phi), ca.sin(c.frame.phi)
        return {
            **super().equations(c),
            "velocity x": equal(c.v_x, c.der(p_x)),
            "velocity y": equal(c.v_y, c.der(p_y)),
            "reading x": equal(c.a_x, c.gain_x * (cos * s_x + sin * s_y) + c.bias_x),
            "reading y": equal(c.a_y, c.gain_y * (cos * s_y - sin * s_x) + c.bias_y),
        }


class Gyro(FrameSensor):
    """Angular velocity of a body.   omega = gain * frame.phi' + bias

    Signals:    omega [rad/s]
    Connectors: frame (takes no force)
    Parameters: gain, 1 by default; bias [rad/s], 0 by default
    """

    omega = SignalOutput("rad/s", description="measured angular velocity")
    gain = Parameter("1", 1.0, description="gain")
    bias = Parameter("rad/s", 0.0, description="bias")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.omega, c.gain * c.der(c.frame.phi) + c.bias)}


def _point(c: Any) -> tuple[Expression, Expression]:
    """The point (x_c, y_c) of the frame, in the world."""
    r_x, r_y = turned(c.x_c, c.y_c, c.frame.phi)
    return c.frame.x + r_x, c.frame.y + r_y
