"""Joints in the plane, each with a 1-D flange for what acts along its one freedom.

The flange `axis` moves as frame_b does relative to frame_a: friction, springs and drives are 1-D elements between it and ground, which
stands for frame_a there. It may stay open: then nothing acts along the freedom. The law along the axis is a place for a residual, with the
joint's name; it is switched on by `Model(residuals=...)`, and unasked where the balances of all that moves along the axis were merged into
it, as those of a cart on its slide. A loop is closed by connecting its last joint; `Model(states=...)` then names the
coordinates to keep, and `Model(start=...)` gives the guesses that decide how the loop is assembled.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...connectors import Frame, Rotational, Translational
from ...language import Component, Equation, Parameter, Variable, equal, law


class Revolute(Component):
    """A hinge: frame_b turns against frame_a about their common origin.   phi = frame_b.phi - frame_a.phi,   -frame_b.tau = axis.tau

    Variables:  phi [rad] angle of frame_b against frame_a, omega [rad/s] its rate
    Connectors: frame_a, frame_b; axis (phi; its torque acts on frame_b and against frame_a), may stay open
    Place:      the joint's name, a torque [N.m]
    """

    phi = Variable("rad", preferred=True, description="angle of frame_b against frame_a")
    omega = Variable("rad/s", preferred=True, description="angular velocity of frame_b against frame_a")
    frame_a = Frame()
    frame_b = Frame()
    axis = Rotational(optional=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        a, b = c.frame_a, c.frame_b
        return {
            "angle": equal(c.phi, b.phi - a.phi),
            "angular velocity": equal(c.omega, c.der(c.phi)),
            "axis": equal(c.axis.phi, c.phi),
            "common origin x": equal(b.x, a.x),
            "common origin y": equal(b.y, a.y),
            "force balance x": equal(a.f_x + b.f_x, 0),
            "force balance y": equal(a.f_y + b.f_y, 0),
            "torque balance": equal(a.tau + b.tau, 0),
            "torque about the axis": law(-b.tau, c.axis.tau, unit="N.m"),
        }


class Prismatic(Component):
    """A slide: frame_b moves along a line fixed to frame_a, without turning.   b - a = s n,   -n . f_b = axis.f

    n is the direction of the line, at the angle `direction` in frame_a.

    Variables:  s [m] position of frame_b along the line, v [m/s] its rate
    Connectors: frame_a, frame_b; axis (s; its force acts on frame_b and against frame_a), may stay open
    Parameters: direction [rad] of the line in frame_a, 0 by default (x axis)
    Place:      the joint's name, a force [N]
    """

    s = Variable("m", preferred=True, description="position of frame_b along the line")
    v = Variable("m/s", preferred=True, description="velocity of frame_b along the line")
    frame_a = Frame()
    frame_b = Frame()
    axis = Translational(optional=True)
    direction = Parameter("rad", 0.0, nominal=1.0, description="direction of the line in frame_a")

    def equations(self, c: Any) -> dict[str, Equation]:
        a, b = c.frame_a, c.frame_b
        n_x, n_y = ca.cos(a.phi + c.direction), ca.sin(a.phi + c.direction)
        return {
            "position x": equal(b.x, a.x + c.s * n_x),
            "position y": equal(b.y, a.y + c.s * n_y),
            "angle": equal(b.phi, a.phi),
            "velocity": equal(c.v, c.der(c.s)),
            "axis": equal(c.axis.s, c.s),
            "force balance x": equal(a.f_x + b.f_x, 0),
            "force balance y": equal(a.f_y + b.f_y, 0),
            "torque balance": equal(a.tau + b.tau + c.s * (n_x * b.f_y - n_y * b.f_x), 0),
            "force along the axis": law(-(n_x * b.f_x + n_y * b.f_y), c.axis.f, unit="N"),
        }
