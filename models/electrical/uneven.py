"""Motors whose constant is none: it waves with the angle, for teeth and poles, and falls with the current, for iron that saturates.

    k(phi, i) = k (1 + amplitude sin(order phi + phase)) / sqrt(1 + b i^2),    tau = k(phi, i) i,    v = k(phi, i) omega

so that power in still equals power out. order: waves in one turn; the torque comes to an end at k/sqrt(b).
"""

from typing import Any

import casadi as ca

from ..language import Component, Equation, Expression, Parameter, balance, equal, law
from .transmission import EMF, DCMotor, TorqueMotor


class Uneven(Component):
    """Base of these: what the motor constant is at an angle and a current over its mean at small ones.

    Parameters: amplitude of the wave over the mean, 0 by default (absent); order: waves in one turn, 1 by default; phase [rad], 0 by
                default; b [1/A2] saturation, 0 by default (absent)
    """

    amplitude = Parameter("1", 0.0, description="wave of the motor constant over its mean")
    order = Parameter("1", 1.0, min=0.0, description="waves in one turn")
    phase = Parameter("rad", 0.0, nominal=1.0, description="phase of the wave at phi = 0")
    b = Parameter("1/A2", 0.0, min=0.0, description="saturation")

    def share(self, c: Any) -> Expression:
        """k(phi, i)/k."""
        return (1.0 + c.amplitude * ca.sin(c.order * c.flange.phi + c.phase)) / ca.sqrt(1.0 + c.b * c.i**2)


class UnevenEMF(Uneven, EMF):
    """An `EMF` whose constant waves with the angle and saturates.   v = k(phi, i) omega,   tau = k(phi, i) i

    Connectors: p, n (electrical), flange (rotational)
    Parameters: k [N.m/A] its mean, 1 by default; amplitude, order, phase [rad] of the wave; b [1/A2]
    """

    def equations(self, c: Any) -> dict[str, Equation]:
        k = c.k * self.share(c)
        return {
            **super().equations(c),
            "induced voltage": equal(c.v, k * c.der(c.flange.phi)),
            "torque": equal(c.flange.tau, -k * c.i),
        }


class UnevenDCMotor(Uneven, DCMotor):
    """A `DCMotor` whose constant waves with the angle and saturates.   L i' = v - R i - Km(phi, i) omega,   tau = Km(phi, i) i

    Connectors: p, n (electrical), flange (rotational)
    Parameters: L [H], R [ohm], Km [V.s/rad] as there; amplitude, order, phase [rad] of the wave; b [1/A2]
    """

    def equations(self, c: Any) -> dict[str, Equation]:
        k = c.Km * self.share(c)
        return {
            **super().equations(c),
            "voltage balance": balance(c.L * c.der(c.i), c.v, -c.R * c.i, -k * c.der(c.flange.phi), unit="V"),
            "torque": equal(c.flange.tau, -k * c.i),
        }


class UnevenTorqueMotor(Uneven, TorqueMotor):
    """A `TorqueMotor` whose constant waves with the angle and saturates.   tau = K(phi, i) i

    Signals:    i [A] current (input)
    Connectors: flange (rotational)
    Parameters: K [N.m/A] its mean, 1 by default; amplitude, order, phase [rad] of the wave; b [1/A2]
    """

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"torque": law(-c.flange.tau, c.K * self.share(c) * c.i)}
