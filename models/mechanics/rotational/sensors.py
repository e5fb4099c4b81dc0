"""Ideal sensors about one axis: they take no torque, or no angle.   reading = gain * quantity + bias

Lags and delays of a sensor are blocks of `signals` behind it.
"""

from typing import Any

from ...connectors import Rotational
from ...language import Component, Equation, Parameter, SignalOutput, Variable, equal


class RotationalFlangeSensor(Component):
    """Base of the sensors on one flange, which take no torque."""

    flange = Rotational()
    gain = Parameter("1", 1.0, description="reading over quantity")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no torque": equal(c.flange.tau, 0)}


class AngleSensor(RotationalFlangeSensor):
    """An angle sensor.   phi = gain flange.phi + bias

    Signals:    phi [rad] (output)
    Connectors: flange (takes no torque)
    Parameters: gain [1] 1 by default; bias [rad] 0 by default
    """

    phi = SignalOutput("rad", description="measured angle")
    bias = Parameter("rad", 0.0, description="reading at zero")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.phi, c.gain * c.flange.phi + c.bias)}


class AngularVelocitySensor(RotationalFlangeSensor):
    """An angular velocity sensor.   omega = gain flange.phi' + bias

    Signals:    omega [rad/s] (output)
    Connectors: flange (takes no torque)
    Parameters: gain [1] 1 by default; bias [rad/s] 0 by default
    """

    omega = SignalOutput("rad/s", description="measured angular velocity")
    bias = Parameter("rad/s", 0.0, description="reading at rest")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.omega, c.gain * c.der(c.flange.phi) + c.bias)}


class AngularAccelerationSensor(RotationalFlangeSensor):
    """An angular acceleration sensor.   alpha = gain flange.phi'' + bias

    Variables:  omega [rad/s] angular velocity of the flange
    Signals:    alpha [rad/s2] (output)
    Connectors: flange (takes no torque)
    Parameters: gain [1] 1 by default; bias [rad/s2] 0 by default
    """

    omega = Variable("rad/s", description="angular velocity of the flange")
    alpha = SignalOutput("rad/s2", description="measured angular acceleration")
    bias = Parameter("rad/s2", 0.0, description="reading without acceleration")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "angular velocity": equal(c.omega, c.der(c.flange.phi)),
            "reading": equal(c.alpha, c.gain * c.der(c.omega) + c.bias),
        }


class RotationalSeriesSensor(Component):
    """Base of the sensors between two flanges, which are rigid.   phi_a = phi_b"""

    flange_a = Rotational()
    flange_b = Rotational()
    gain = Parameter("1", 1.0, description="reading over quantity")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rigidity": equal(c.flange_a.phi, c.flange_b.phi),
            "torque at flange_b": equal(c.flange_a.tau + c.flange_b.tau, 0),
        }


class TorqueSensor(RotationalSeriesSensor):
    """A torque cell.   tau = gain flange_a.tau + bias

    Signals:    tau [N.m] (output)
    Connectors: flange_a, flange_b
    Parameters: gain [1] 1 by default; bias [N.m] 0 by default
    """

    tau = SignalOutput("N.m", description="measured torque from flange_a to flange_b")
    bias = Parameter("N.m", 0.0, description="reading without torque")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.tau, c.gain * c.flange_a.tau + c.bias)}


class RotationalPowerSensor(RotationalSeriesSensor):
    """A meter of the power that flows from flange_a to flange_b.   power = gain flange_a.tau flange_a.phi' + bias

    Signals:    power [W] (output)
    Connectors: flange_a, flange_b
    Parameters: gain [1] 1 by default; bias [W] 0 by default
    """

    power = SignalOutput("W", description="measured power from flange_a to flange_b")
    bias = Parameter("W", 0.0, description="reading without power")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.power, c.gain * c.flange_a.tau * c.der(c.flange_a.phi) + c.bias)}
