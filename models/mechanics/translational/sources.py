"""Sources of force and motion along one line. A signal tells them what to do; the constant force is a parameter."""

from typing import Any

from ...connectors import Translational
from ...language import Component, Equation, Parameter, SignalInput, Variable, equal, law


class Force(Component):
    """A force source: pushes its flange in the positive direction with the force f.   flange.f = -f

    Signals:    f [N] force (input)
    Connectors: flange
    """

    f = SignalInput("N", description="force on the flange")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.f, -c.f)}


class ConstantForce(Component):
    """A constant force that pushes flange_a back and flange_b forth.   flange_a.f = f

    Between a body (flange_a) and ground it is a load: a weight, or the offset of a friction law.

    Connectors: flange_a, flange_b
    Parameters: f [N] force, 0 by default (absent)
    """

    flange_a = Translational()
    flange_b = Translational()
    f = Parameter("N", 0.0, description="force from flange_a to flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"constant force": law(c.flange_a.f, c.f), "force at flange_b": equal(c.flange_b.f, -c.flange_a.f)}


class Position(Component):
    """A position source: moves its flange with any force.   flange.s = s

    What hangs on the flange must not need its velocity, for an input has no derivative: springs, not masses or dampers.

    Signals:    s [m] position (input)
    Connectors: flange
    """

    s = SignalInput("m", description="position of the flange")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.s, c.s)}


class Speed(Component):
    """A velocity source: moves its flange with any force.   flange.s' = v

    What hangs on the flange must not need its acceleration, for an input has no derivative: springs and dampers, not masses.

    Variables:  s [m] position of the flange (state)
    Signals:    v [m/s] velocity (input)
    Connectors: flange
    """

    s = Variable("m", state=True, description="position of the flange")
    v = SignalInput("m/s", description="velocity of the flange")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"position": equal(c.s, c.flange.s), "drive": equal(c.der(c.s), c.v)}


class Acceleration(Component):
    """An acceleration source: moves its flange, and all that hangs on it, with any force.   flange.s'' = a

    Variables:  s [m] position, v [m/s] velocity of the flange (states)
    Signals:    a [m/s2] acceleration (input)
    Connectors: flange
    """

    s = Variable("m", state=True, description="position of the flange")
    v = Variable("m/s", state=True, description="velocity of the flange")
    a = SignalInput("m/s2", description="acceleration of the flange")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"position": equal(c.s, c.flange.s), "velocity": equal(c.v, c.der(c.s)), "drive": equal(c.der(c.v), c.a)}
