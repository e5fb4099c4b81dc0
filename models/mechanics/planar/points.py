"""Points that move in a plane, in Cartesian coordinates: enough for pendulums and trusses with rod forces as algebraic unknowns."""

from typing import Any

from ...connectors import Planar
from ...language import Component, Equation, Parameter, Variable, balance, equal
from ...model import ground_of


class PointMass(Component):
    """A point mass under gravity.   m v_x' = f_x,   m v_y' = f_y - m g

    Variables:  x, y [m] position (y upwards), v_x, v_y [m/s] velocity
    Connectors: point
    Parameters: m [kg] mass, 1 by default; g [m/s2] gravity, 9.81 by default
    """

    x = Variable("m", state=True, description="position")
    y = Variable("m", state=True, description="height")
    v_x = Variable("m/s", state=True, description="velocity")
    v_y = Variable("m/s", state=True, description="velocity upwards")
    point = Planar()
    m = Parameter("kg", 1.0, min=0.0, description="mass")
    g = Parameter("m/s2", 9.81, description="gravity")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "position x": equal(c.x, c.point.x),
            "position y": equal(c.y, c.point.y),
            "velocity x": equal(c.v_x, c.der(c.x)),
            "velocity y": equal(c.v_y, c.der(c.y)),
            "force balance x": balance(c.m * c.der(c.v_x), c.point.f_x, place="x"),
            "force balance y": balance(c.m * c.der(c.v_y), c.point.f_y, -c.m * c.g, place="y"),
        }


@ground_of(Planar)
class PlanarFixed(Component):
    """The ground: the origin of the plane, which takes any force.   x = y = 0

    Connectors: point
    """

    point = Planar()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"position x": equal(c.point.x, 0), "position y": equal(c.point.y, 0)}


class Rod(Component):
    """A massless rod with hinges at its ends.   (x_a - x_b)^2 + (y_a - y_b)^2 = length^2

    Variables:  tension [N/m] tensile force over length, positive when the rod is pulled
    Connectors: point_a, point_b
    Parameters: length [m], 1 by default
    """

    tension = Variable("N/m", description="tensile force over length")
    point_a = Planar()
    point_b = Planar()
    length = Parameter("m", 1.0, min=1e-9, description="length")

    def equations(self, c: Any) -> dict[str, Equation]:
        dx, dy = c.point_a.x - c.point_b.x, c.point_a.y - c.point_b.y
        return {
            "rod length": equal(dx**2 + dy**2, c.length**2),
            "force x at point_a": equal(c.point_a.f_x, c.tension * dx),
            "force y at point_a": equal(c.point_a.f_y, c.tension * dy),
            "force x at point_b": equal(c.point_b.f_x, -c.tension * dx),
            "force y at point_b": equal(c.point_b.f_y, -c.tension * dy),
        }
