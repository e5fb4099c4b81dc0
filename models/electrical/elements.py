"""Electrical elements between two pins, and the ground.

The voltage v = p.v - n.v drops from pin p to pin n; the current i enters at p and leaves at n. A circuit needs one ground.
"""

from typing import Any

import casadi as ca

from ..connectors import Electrical
from ..language import Component, Equation, Parameter, Variable, balance, equal, law
from ..model import ground_of


@ground_of(Electrical)
class ElectricalGround(Component):
    """The ground: the origin of voltages, which takes any current.   v = 0

    Connectors: pin
    """

    pin = Electrical()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"voltage": equal(c.pin.v, 0)}


class TwoPin(Component):
    """Base of the elements with two pins: voltage v [V] from p to n and current i [A] from p to n."""

    v = Variable("V", description="voltage from p to n")
    i = Variable("A", description="current from p to n")
    p = Electrical()
    n = Electrical()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "voltage": equal(c.v, c.p.v - c.n.v),
            "current at p": equal(c.p.i, c.i),
            "current at n": equal(c.n.i, -c.i),
        }


class Resistor(TwoPin):
    """A resistor.   v = R i

    Variables:  v [V], i [A]
    Connectors: p, n
    Parameters: R [ohm] resistance, 1 by default
    """

    R = Parameter("ohm", 1.0, min=0.0, description="resistance")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "Ohm's law": law(c.v, c.R * c.i, unit="V")}


class Inductor(TwoPin):
    """An inductor: the balance of its flux linkage, which carries a residual voltage.   L i' = v

    Variables:  v [V], i [A] state
    Connectors: p, n
    Parameters: L [H] inductance, 1 by default
    """

    i = Variable("A", state=True, description="current from p to n")
    L = Parameter("H", 1.0, min=0.0, description="inductance")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "voltage balance": balance(c.L * c.der(c.i), c.v, unit="V")}


class Capacitor(TwoPin):
    """A capacitor: the balance of its charge, which carries a residual current.   C v' = i

    Variables:  v [V] state, i [A]
    Connectors: p, n
    Parameters: C [F] capacitance, 1 by default
    """

    v = Variable("V", state=True, description="voltage from p to n")
    C = Parameter("F", 1.0, min=0.0, description="capacitance")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "charge balance": balance(c.C * c.der(c.v), c.i, unit="A")}


class VoltageDrop(TwoPin):
    """A voltage that is lost whichever way the current flows: at the brushes of a motor, in the dead time of an inverter.

        v = v_d tanh(i/i_0)

    Variables:  v [V], i [A]
    Connectors: p, n
    Parameters: v_d [V] the drop, 0 by default (absent); i_0 [A] current at which it is there, 1e-2 by default
    """

    v_d = Parameter("V", 0.0, min=0.0, description="voltage that is lost")
    i_0 = Parameter("A", 1e-2, min=1e-12, description="current at which it is there")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "drop": law(c.v, c.v_d * ca.tanh(c.i / c.i_0), unit="V")}
