"""Bodies that turn about one axis, and the ground."""

from typing import Any

from ...connectors import Rotational
from ...language import Component, Equation, Parameter, Variable, balance, equal, law
from ...model import ground_of


class Inertia(Component):
    """A turning body.   J omega' = tau

    Variables:  phi [rad] angle, omega [rad/s] angular velocity
    Connectors: flange
    Parameters: J [kg.m2] moment of inertia, 1 by default
    """

    phi = Variable("rad", state=True, description="angle")
    omega = Variable("rad/s", state=True, description="angular velocity")
    flange = Rotational()
    J = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "angle": equal(c.phi, c.flange.phi),
            "angular velocity": equal(c.omega, c.der(c.phi)),
            "torque balance": balance(c.J * c.der(c.omega), c.flange.tau),
        }


class Rotor(Component):
    """A body that turns in damped bearings, and whose angle is no state unless something else needs it.   J omega' = tau - d omega

    Variables:  omega [rad/s] angular velocity
    Connectors: flange
    Parameters: J [kg.m2] moment of inertia, 1 by default; d [N.m.s/rad] damping of the bearings, 0 by default (absent)
    """

    omega = Variable("rad/s", state=True, description="angular velocity")
    flange = Rotational()
    J = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping of the bearings")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "angular velocity": equal(c.omega, c.der(c.flange.phi)),
            "torque balance": balance(c.J * c.der(c.omega), c.flange.tau, -c.d * c.omega),
        }


class AddedInertia(Component):
    """An inertia that turns with another body, without a balance of its own: what a model forgot to count.   flange.tau = J omega'

    Variables:  omega [rad/s] angular velocity
    Connectors: flange
    Parameters: J [kg.m2] moment of inertia, 0 by default (absent)
    """

    omega = Variable("rad/s", description="angular velocity of the flange")
    flange = Rotational()
    J = Parameter("kg.m2", 0.0, min=0.0, description="added moment of inertia")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "angular velocity": equal(c.omega, c.der(c.flange.phi)),
            "inertial torque": law(c.flange.tau, c.J * c.der(c.omega)),
        }


@ground_of(Rotational)
class RotationalFixed(Component):
    """The ground: the origin of angles, which takes any torque.   phi = 0

    Connectors: flange
    """

    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"angle": equal(c.flange.phi, 0)}
