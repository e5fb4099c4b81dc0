"""A gantry: a slideway carried by two slides, and a carriage along it, described by its energies.

      x ^     slide 1                 slide 2       x_1, x_2  positions of the slides, b apart
        |        |                       |          y         position of the carriage, counted from slide 1
        |        o-------[tool]----------o          alpha     angle of the slideway, small
        |        |<- y ->|               |
        +--------|<--------- b --------->|---> y

alpha = (x_1 - x_2)/b         tool:  x = x_1 + (x_2 - x_1) y/b,   y,   phi = alpha
T = 1/2 [m_y x_c'^2 + (m_y c^2/12) alpha'^2],      x_c = (x_1 + x_2)/2 the middle of the slideway
"""

from typing import Any

from ..connectors import Frame, Translational
from ..language import Component, Equation, Parameter, Variable, equal
from .lagrange import generalised_forces, virtual_work


class Gantry(Component):
    """A slideway between two slides, and a carriage without mass of its own along it.   d/dt dT/dv - dT/dq = forces

    The slideway is rigid and its angle small, so that it does not grow longer when it turns. The slides are masses at `slide_1` and
    `slide_2`; what is mounted on the carriage (a tool, a sensor) is joined to the frame `tool`, whose axes turn with the slideway.

    Variables:  v_1, v_2, v_y [m/s] velocities of the slides and of the carriage along the slideway
    Connectors: slide_1, slide_2, carriage (translational); tool (frame)
    Parameters: m_y [kg] mass of the slideway, 1 by default; b [m] distance of the slides, 1 by default; c [m] length of the slideway,
                1 by default
    """

    v_1 = Variable("m/s", description="velocity of slide 1")
    v_2 = Variable("m/s", description="velocity of slide 2")
    v_y = Variable("m/s", description="velocity of the carriage along the slideway")
    slide_1 = Translational()
    slide_2 = Translational()
    carriage = Translational()
    tool = Frame()
    m_y = Parameter("kg", 1.0, min=0.0, description="mass of the slideway")
    b = Parameter("m", 1.0, min=1e-9, description="distance of the slides")
    c = Parameter("m", 1.0, min=0.0, description="length of the slideway")

    def equations(self, c: Any) -> dict[str, Equation]:
        q, v = (c.slide_1.s, c.slide_2.s, c.carriage.s), (c.v_1, c.v_2, c.v_y)
        x_1, x_2, y = q
        x, alpha = x_1 + (x_2 - x_1) * y / c.b, (x_1 - x_2) / c.b
        middle, turn = (c.v_1 + c.v_2) / 2, (c.v_1 - c.v_2) / c.b
        needed = generalised_forces(c, q, v, kinetic=(c.m_y * middle**2 + c.m_y * c.c**2 / 12 * turn**2) / 2)
        tool = virtual_work(q, [(x, c.tool.f_x), (y, c.tool.f_y), (alpha, c.tool.tau)])
        return {
            "velocity of slide 1": equal(c.v_1, c.der(x_1)),
            "velocity of slide 2": equal(c.v_2, c.der(x_2)),
            "velocity of the carriage": equal(c.v_y, c.der(y)),
            "tool position x": equal(c.tool.x, x),
            "tool position y": equal(c.tool.y, y),
            "tool angle": equal(c.tool.phi, alpha),
            "force on slide 1": equal(c.slide_1.f, needed[0] - tool[0]),
            "force on slide 2": equal(c.slide_2.f, needed[1] - tool[1]),
            "force on the carriage": equal(c.carriage.f, needed[2] - tool[2]),
        }
