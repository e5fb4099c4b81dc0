"""Bodies that slide along one line, and the ground."""

from typing import Any

from ...connectors import Translational
from ...language import Component, Equation, Parameter, Variable, balance, equal, law
from ...model import ground_of


class Mass(Component):
    """A sliding body.   m v' = f

    Variables:  s [m] position, v [m/s] velocity
    Connectors: flange
    Parameters: m [kg] mass, 1 by default
    """

    s = Variable("m", state=True, description="position")
    v = Variable("m/s", state=True, description="velocity")
    flange = Translational()
    m = Parameter("kg", 1.0, min=0.0, description="mass")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "position": equal(c.s, c.flange.s),
            "velocity": equal(c.v, c.der(c.s)),
            "force balance": balance(c.m * c.der(c.v), c.flange.f),
        }


class AddedMass(Component):
    """A mass that rides on another body, without a balance of its own: what a model forgot to count.   flange.f = m v'

    Variables:  v [m/s] velocity
    Connectors: flange
    Parameters: m [kg] mass, 0 by default (absent)
    """

    v = Variable("m/s", description="velocity of the flange")
    flange = Translational()
    m = Parameter("kg", 0.0, min=0.0, description="added mass")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"velocity": equal(c.v, c.der(c.flange.s)), "inertial force": law(c.flange.f, c.m * c.der(c.v))}


@ground_of(Translational)
class Fixed(Component):
    """The ground: the origin of positions, which takes any force.   s = 0

    Connectors: flange
    """

    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"position": equal(c.flange.s, 0)}
