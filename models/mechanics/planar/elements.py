"""Rigid pieces between frames, and forces of the world on a frame."""

from __future__ import annotations

from typing import Any

from ...connectors import Frame
from ...language import Component, Equation, Parameter, SignalInput, equal, law
from .turned import turned


class FixedTranslation(Component):
    """A massless rigid piece: frame_b stands at (r_x, r_y) in frame_a, parallel to it.   b = a + R(phi) r

    Connectors: frame_a, frame_b
    Parameters: r_x, r_y [m] position of frame_b in frame_a, 0 by default
    """

    frame_a = Frame()
    frame_b = Frame()
    r_x = Parameter("m", 0.0, description="position of frame_b in frame_a")
    r_y = Parameter("m", 0.0, description="position of frame_b in frame_a")

    def equations(self, c: Any) -> dict[str, Equation]:
        a, b = c.frame_a, c.frame_b
        d_x, d_y = turned(c.r_x, c.r_y, a.phi)
        return {
            "position x": equal(b.x, a.x + d_x),
            "position y": equal(b.y, a.y + d_y),
            "angle": equal(b.phi, a.phi),
            "force balance x": equal(a.f_x + b.f_x, 0),
            "force balance y": equal(a.f_y + b.f_y, 0),
            "torque balance": equal(a.tau + b.tau + d_x * b.f_y - d_y * b.f_x, 0),
        }


class FixedRotation(Component):
    """A massless rigid piece: frame_b stands at frame_a, turned by a fixed angle.   frame_b.phi = frame_a.phi + angle

    Connectors: frame_a, frame_b
    Parameters: angle [rad] of frame_b in frame_a, 0 by default
    """

    frame_a = Frame()
    frame_b = Frame()
    angle = Parameter("rad", 0.0, nominal=1.0, description="angle of frame_b in frame_a")

    def equations(self, c: Any) -> dict[str, Equation]:
        a, b = c.frame_a, c.frame_b
        return {
            "position x": equal(b.x, a.x),
            "position y": equal(b.y, a.y),
            "angle": equal(b.phi, a.phi + c.angle),
            "force balance x": equal(a.f_x + b.f_x, 0),
            "force balance y": equal(a.f_y + b.f_y, 0),
            "torque balance": equal(a.tau + b.tau, 0),
        }


class WorldForce(Component):
    """A force source in the axes of the world.   frame.f = -f,  frame.tau = 0

    Signals:    f_x, f_y [N] force on the frame
    Connectors: frame
    """

    f_x = SignalInput("N", description="force along x on the frame")
    f_y = SignalInput("N", description="force along y on the frame")
    frame = Frame()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "drive x": equal(c.frame.f_x, -c.f_x),
            "drive y": equal(c.frame.f_y, -c.f_y),
            "no torque": equal(c.frame.tau, 0),
        }


class WorldTorque(Component):
    """A torque source.   frame.tau = -tau,  frame.f = 0

    Signals:    tau [N.m] torque on the frame
    Connectors: frame
    """

    tau = SignalInput("N.m", description="torque on the frame")
    frame = Frame()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "no force x": equal(c.frame.f_x, 0),
            "no force y": equal(c.frame.f_y, 0),
            "drive": equal(c.frame.tau, -c.tau),
        }


class ConstantWorldForce(Component):
    """A constant force at a point of a body, in the axes of the world, and a torque.   frame.f = -f,  frame.tau = -tau - r x f

    Connectors: frame
    Parameters: f_x, f_y [N] force, tau [N.m] torque, 0 by default (absent); x_c, y_c [m] the point in the frame, 0 by default
    """

    frame = Frame()
    f_x = Parameter("N", 0.0, description="force along x")
    f_y = Parameter("N", 0.0, description="force along y")
    tau = Parameter("N.m", 0.0, description="torque")
    x_c = Parameter("m", 0.0, description="the point in the frame")
    y_c = Parameter("m", 0.0, description="the point in the frame")

    def equations(self, c: Any) -> dict[str, Equation]:
        r_x, r_y = turned(c.x_c, c.y_c, c.frame.phi)
        return {
            "force x": law(-c.frame.f_x, c.f_x, place="x", unit="N"),
            "force y": law(-c.frame.f_y, c.f_y, place="y", unit="N"),
            "torque": law(-c.frame.tau + r_x * c.frame.f_y - r_y * c.frame.f_x, c.tau, place="phi", unit="N.m"),
        }
