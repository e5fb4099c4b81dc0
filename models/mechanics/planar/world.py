"""The world that all planar parts share: its gravity in the plane, and the ground that holds them."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from ...connectors import Frame
from ...language import Component, Equation, Parameter, Variable, equal
from ...model import ground_of


class World(Component):
    """Gravity in the plane of motion, which is tilted against the horizontal.

        a_x = g sin(tilt) cos(direction),   a_y = g sin(tilt) sin(direction)

    The plane is horizontal by default (tilt = 0: no gravity in it); `World(tilt=math.pi / 2)` is vertical with y upwards.

    Variables:  a_x, a_y [m/s2] gravity in the plane
    Connectors: none; bodies and sensors see it as `Shared(World)`
    Parameters: g [m/s2] gravity, 9.81 by default; tilt [rad] of the plane against the horizontal, 0 by default; direction [rad] of
                the steepest descent in the plane, counted from its x axis, -pi/2 by default (-y)
    """

    a_x = Variable("m/s2", nominal=10.0, description="gravity along x")
    a_y = Variable("m/s2", nominal=10.0, description="gravity along y")
    g = Parameter("m/s2", 9.81, min=0.0, description="gravity")
    tilt = Parameter("rad", 0.0, nominal=1.0, description="angle of the plane against the horizontal")
    direction = Parameter("rad", -math.pi / 2, description="direction of the steepest descent in the plane")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "gravity x": equal(c.a_x, c.g * ca.sin(c.tilt) * ca.cos(c.direction)),
            "gravity y": equal(c.a_y, c.g * ca.sin(c.tilt) * ca.sin(c.direction)),
        }


@ground_of(Frame)
class FrameFixed(Component):
    """The ground: a frame held at a place of the world, which takes any force.   x = x_0,   y = y_0,   phi = phi_0

    Connectors: frame
    Parameters: x_0, y_0 [m], phi_0 [rad], 0 by default
    """

    frame = Frame()
    x_0 = Parameter("m", 0.0, description="position of the frame")
    y_0 = Parameter("m", 0.0, description="position of the frame")
    phi_0 = Parameter("rad", 0.0, description="angle of the frame")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "position x": equal(c.frame.x, c.x_0),
            "position y": equal(c.frame.y, c.y_0),
            "angle": equal(c.frame.phi, c.phi_0),
        }
