"""Ideal sensors along one line: they take no force, or no way.   reading = gain * quantity + bias

Lags and delays of a sensor are blocks of `signals` behind it.
"""

from typing import Any

from ...connectors import Translational
from ...language import Component, Equation, Parameter, SignalOutput, Variable, equal


class FlangeSensor(Component):
    """Base of the sensors on one flange, which take no force."""

    flange = Translational()
    gain = Parameter("1", 1.0, description="reading over quantity")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no force": equal(c.flange.f, 0)}


class PositionSensor(FlangeSensor):
    """A position sensor.   s = gain flange.s + bias

    Signals:    s [m] (output)
    Connectors: flange (takes no force)
    Parameters: gain [1] 1 by default; bias [m] 0 by default
    """

    s = SignalOutput("m", description="measured position")
    bias = Parameter("m", 0.0, description="reading at zero")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.s, c.gain * c.flange.s + c.bias)}


class VelocitySensor(FlangeSensor):
    """A velocity sensor.   v = gain flange.s' + bias

    Signals:    v [m/s] (output)
    Connectors: flange (takes no force)
    Parameters: gain [1] 1 by default; bias [m/s] 0 by default
    """

    v = SignalOutput("m/s", description="measured velocity")
    bias = Parameter("m/s", 0.0, description="reading at rest")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.v, c.gain * c.der(c.flange.s) + c.bias)}


class AccelerationSensor(FlangeSensor):
    """An acceleration sensor.   a = gain flange.s'' + bias

    Variables:  v [m/s] velocity of the flange
    Signals:    a [m/s2] (output)
    Connectors: flange (takes no force)
    Parameters: gain [1] 1 by default; bias [m/s2] 0 by default
    """

    v = Variable("m/s", description="velocity of the flange")
    a = SignalOutput("m/s2", description="measured acceleration")
    bias = Parameter("m/s2", 0.0, description="reading without acceleration")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "velocity": equal(c.v, c.der(c.flange.s)),
            "reading": equal(c.a, c.gain * c.der(c.v) + c.bias),
        }


class SeriesSensor(Component):
    """Base of the sensors between two flanges, which are rigid.   s_a = s_b"""

    flange_a = Translational()
    flange_b = Translational()
    gain = Parameter("1", 1.0, description="reading over quantity")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rigidity": equal(c.flange_a.s, c.flange_b.s),
            "force at flange_b": equal(c.flange_a.f + c.flange_b.f, 0),
        }


class ForceSensor(SeriesSensor):
    """A load cell.   f = gain flange_a.f + bias

    It reads a push of flange_a along the axis as positive: compression where flange_b is further along it, tension the other way round.

    Signals:    f [N] (output)
    Connectors: flange_a, flange_b
    Parameters: gain [1] 1 by default; bias [N] 0 by default
    """

    f = SignalOutput("N", description="measured force from flange_a to flange_b")
    bias = Parameter("N", 0.0, description="reading without force")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.f, c.gain * c.flange_a.f + c.bias)}


class PowerSensor(SeriesSensor):
    """A meter of the power that flows from flange_a to flange_b.   power = gain flange_a.f flange_a.s' + bias

    Signals:    power [W] (output)
    Connectors: flange_a, flange_b
    Parameters: gain [1] 1 by default; bias [W] 0 by default
    """

    power = SignalOutput("W", description="measured power from flange_a to flange_b")
    bias = Parameter("W", 0.0, description="reading without power")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.power, c.gain * c.flange_a.f * c.der(c.flange_a.s) + c.bias)}
