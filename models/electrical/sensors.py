"""Electrical sensors: reading = gain * quantity + bias. A current sensor is in series, a voltage sensor in parallel; both are ideal."""

from typing import Any

from ..connectors import Electrical
from ..language import Component, Equation, Parameter, SignalOutput, equal


class CurrentSensor(Component):
    """A current sensor in series, without voltage drop.   i = gain p.i + bias

    Signals:    i [A] reading of the current from p to n (output)
    Connectors: p, n
    Parameters: gain [1] 1 by default; bias [A] 0 by default
    """

    i = SignalOutput("A", description="measured current from p to n")
    p = Electrical()
    n = Electrical()
    gain = Parameter("1", 1.0, description="reading over current")
    bias = Parameter("A", 0.0, description="reading without current")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "no voltage drop": equal(c.p.v, c.n.v),
            "current at n": equal(c.p.i + c.n.i, 0),
            "reading": equal(c.i, c.gain * c.p.i + c.bias),
        }


class VoltageSensor(Component):
    """A voltage sensor in parallel, without current.   v = gain (p.v - n.v) + bias

    Signals:    v [V] reading of the voltage from p to n (output)
    Connectors: p, n
    Parameters: gain [1] 1 by default; bias [V] 0 by default
    """

    v = SignalOutput("V", description="measured voltage from p to n")
    p = Electrical()
    n = Electrical()
    gain = Parameter("1", 1.0, description="reading over voltage")
    bias = Parameter("V", 0.0, description="reading without voltage")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "no current": equal(c.p.i, 0),
            "no current at n": equal(c.n.i, 0),
            "reading": equal(c.v, c.gain * (c.p.v - c.n.v) + c.bias),
        }
