"""Drag of a body that moves in a plane, through air that rests or in oil: a force at a point of it, against that point's velocity."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...connectors import Frame
from ...language import Component, Equation, Expression, Parameter, Variable, equal
from .turned import turned


class Drag(Component):
    """Base of the drags: the force per velocity, -force = resistance * v, is a subclass's.

    Variables:  v_x, v_y [m/s] velocity of the point in the world
    Connectors: frame
    Parameters: x_c, y_c [m] the point in the frame, 0 by default
    """

    v_x = Variable("m/s", description="velocity of the point")
    v_y = Variable("m/s", description="velocity of the point")
    frame = Frame()
    x_c = Parameter("m", 0.0, description="the point in the frame")
    y_c = Parameter("m", 0.0, description="the point in the frame")

    def resistance(self, c: Any) -> Expression:
        """Force over velocity [N.s/m]."""
        raise NotImplementedError(f"{type(self).__name__} declares no resistance")

    def equations(self, c: Any) -> dict[str, Equation]:
        frame, d = c.frame, self.resistance(c)
        r_x, r_y = turned(c.x_c, c.y_c, frame.phi)
        return {
            "velocity x": equal(c.v_x, c.der(frame.x + r_x)),
            "velocity y": equal(c.v_y, c.der(frame.y + r_y)),
            "drag x": equal(frame.f_x, d * c.v_x),
            "drag y": equal(frame.f_y, d * c.v_y),
            "torque": equal(frame.tau, r_x * frame.f_y - r_y * frame.f_x),
        }


class LinearDrag(Drag):
    """Drag in proportion to the velocity, as in oil.   force = -d v

    Variables:  v_x, v_y [m/s] velocity of the point in the world
    Connectors: frame
    Parameters: d [N.s/m], 0 by default (absent); x_c, y_c [m] the point in the frame, 0 by default
    """

    d = Parameter("N.s/m", 0.0, min=0.0, description="drag over velocity")

    def resistance(self, c: Any) -> Expression:
        return c.d


class QuadraticDrag(Drag):
    """Drag in proportion to the squared speed, against the velocity, as in air.   force = -c |v| v

    The corner at rest is rounded:   |v| = sqrt(v_x^2 + v_y^2 + width^2).

    Variables:  v_x, v_y [m/s] velocity of the point in the world
    Connectors: frame
    Parameters: c [N.s2/m2], 0 by default (absent); x_c, y_c [m] the point in the frame, 0 by default; width [m/s] smoothing, 1e-3 by
                default
    """

    c = Parameter("N.s2/m2", 0.0, min=0.0, description="drag over squared speed")
    width = Parameter("m/s", 1e-3, min=1e-12, description="rounding of the speed at rest", smoothing=True)

    def resistance(self, c: Any) -> Expression:
        return c.c * ca.sqrt(c.v_x**2 + c.v_y**2 + c.width**2)
