"""Electrical sources, told by a signal. Pin p is the positive one: the source lifts the voltage there and sends current out of it."""

from typing import Any

from ..connectors import Electrical
from ..language import Component, Equation, SignalInput, equal


class Voltage(Component):
    """A voltage source: an amplifier without internal resistance.   p.v - n.v = v

    Signals:    v [V] voltage from p to n (input)
    Connectors: p, n
    """

    v = SignalInput("V", description="voltage from p to n")
    p = Electrical()
    n = Electrical()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"source voltage": equal(c.p.v - c.n.v, c.v), "current at n": equal(c.p.i + c.n.i, 0)}


class Current(Component):
    """A current source: a current-controlled amplifier.   p.i = -i,   n.i = i

    Signals:    i [A] current that leaves the source at p (input)
    Connectors: p, n
    """

    i = SignalInput("A", description="current out of p")
    p = Electrical()
    n = Electrical()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"source current": equal(c.p.i, -c.i), "current at n": equal(c.p.i + c.n.i, 0)}
