"""Sources of torque and motion about one axis. A signal tells them what to do; the constant torque is a parameter."""

from typing import Any

from ...connectors import Rotational
from ...language import Component, Equation, Parameter, SignalInput, Variable, equal, law


class Torque(Component):
    """A torque source: turns its flange in the positive direction with the torque tau.   flange.tau = -tau

    Signals:    tau [N.m] torque (input)
    Connectors: flange
    """

    tau = SignalInput("N.m", description="torque on the flange")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.tau, -c.tau)}


class ConstantTorque(Component):
    """A constant torque that turns flange_a back and flange_b forth.   flange_a.tau = tau

    Between a body (flange_a) and ground it is a load.

    Connectors: flange_a, flange_b
    Parameters: tau [N.m] torque, 0 by default (absent)
    """

    flange_a = Rotational()
    flange_b = Rotational()
    tau = Parameter("N.m", 0.0, description="torque from flange_a to flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"constant torque": law(c.flange_a.tau, c.tau), "torque at flange_b": equal(c.flange_b.tau, -c.flange_a.tau)}


class Angle(Component):
    """An angle source: turns its flange with any torque.   flange.phi = phi

    What hangs on the flange must not need its velocity, for an input has no derivative: springs, not inertias or dampers.

    Signals:    phi [rad] angle (input)
    Connectors: flange
    """

    phi = SignalInput("rad", description="angle of the flange")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.phi, c.phi)}


class AngularSpeed(Component):
    """An angular velocity source: turns its flange with any torque.   flange.phi' = omega

    What hangs on the flange must not need its acceleration, for an input has no derivative: springs and dampers, not inertias.

    Variables:  phi [rad] angle of the flange (state)
    Signals:    omega [rad/s] angular velocity (input)
    Connectors: flange
    """

    phi = Variable("rad", state=True, description="angle of the flange")
    omega = SignalInput("rad/s", description="angular velocity of the flange")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"angle": equal(c.phi, c.flange.phi), "drive": equal(c.der(c.phi), c.omega)}


class AngularAcceleration(Component):
    """An angular acceleration source: turns its flange, and all that hangs on it, with any torque.   flange.phi'' = alpha

    Variables:  phi [rad] angle, omega [rad/s] angular velocity of the flange (states)
    Signals:    alpha [rad/s2] angular acceleration (input)
    Connectors: flange
    """

    phi = Variable("rad", state=True, description="angle of the flange")
    omega = Variable("rad/s", state=True, description="angular velocity of the flange")
    alpha = SignalInput("rad/s2", description="angular acceleration of the flange")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "angle": equal(c.phi, c.flange.phi),
            "angular velocity": equal(c.omega, c.der(c.phi)),
            "drive": equal(c.der(c.omega), c.alpha),
        }
