"""What ties a circuit to a shaft: the electromotive force, and motors made of it. Their housings stand on the ground."""

from typing import Any

from ..connectors import Rotational
from ..language import Component, Equation, Parameter, SignalInput, Variable, balance, equal, law
from .elements import TwoPin


class EMF(TwoPin):
    """An ideal electromechanical transducer: power in equals power out.   v = k omega,   tau = k i

    Variables:  v [V] induced voltage from p to n, i [A] current from p to n
    Connectors: p, n (electrical), flange (rotational)
    Parameters: k [N.m/A] transducer constant (the same number in V.s/rad), 1 by default
    """

    flange = Rotational()
    k = Parameter("N.m/A", 1.0, description="torque per current, and voltage per angular velocity")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "induced voltage": equal(c.v, c.k * c.der(c.flange.phi)),
            "torque": equal(c.flange.tau, -c.k * c.i),
        }


class DCMotor(TwoPin):
    """A separately excited direct-current motor without inertia.   L i' = v - R i - Km omega,   tau = Km i

    Its residual is a voltage of the armature.

    Variables:  v [V] armature voltage, i [A] armature current (state)
    Connectors: p, n (electrical), flange (rotational)
    Parameters: L [H] inductance, 1e-3 by default; R [ohm] resistance, 1 by default; Km [V.s/rad] motor constant (the same number in
                N.m/A), 1 by default
    """

    i = Variable("A", state=True, description="armature current")
    flange = Rotational()
    L = Parameter("H", 1e-3, min=0.0, description="armature inductance")
    R = Parameter("ohm", 1.0, min=0.0, description="armature resistance")
    Km = Parameter("V.s/rad", 1.0, description="motor constant")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "voltage balance": balance(c.L * c.der(c.i), c.v, -c.R * c.i, -c.Km * c.der(c.flange.phi), unit="V"),
            "torque": equal(c.flange.tau, -c.Km * c.i),
        }


class TorqueMotor(Component):
    """A motor behind a current amplifier that is faster than all else.   tau = K i

    Signals:    i [A] current (input)
    Connectors: flange (rotational)
    Parameters: K [N.m/A] torque constant, 1 by default
    """

    i = SignalInput("A", description="motor current")
    flange = Rotational()
    K = Parameter("N.m/A", 1.0, description="torque per current")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"torque": law(-c.flange.tau, c.K * c.i)}
