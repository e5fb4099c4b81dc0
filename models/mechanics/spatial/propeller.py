"""Propellers fixed to a rigid body: thrust upwards (-z) at the end of an arm, and its reaction torque.

A motor and rotor of first order, Omega' = (K u - Omega)/tau, with the thrust T = k_r Omega^2, and gain = K sqrt(k_r):

    T' = (2/tau) (gain sqrt(T) u - T)            settles at (gain u)^2
    place r = arm (cos(azimuth), sin(azimuth), 0),   force = (0, 0, -T),   torque = r x force - spin torque_ratio T e_z

M. Back, Grey-box Modelling of a Quadrotor Using Closed-loop Data, Linkoping University, 2015, eqs. 4.25, 4.30 - 4.34. The root of the
thrust is rounded near rest, (T^2 + rest^2)^(1/4): off by T^(-3/2) rest^2/4, and a rotor at rest starts as its speed says. With
rest = 1e-7 gain^2 the rounding scales with the thrust, so it tells nothing that the recording does not.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...language import Equation, Expression, Parameter, SignalInput, Variable, balance
from .elements import BodyElement
from .rotation import Vector, velocities

REST = 1e-7  # thrust below which its root is rounded, over gain^2


def root(thrust: Expression, rest: Expression) -> Expression:
    """The square root of a thrust [N], rounded below `rest` [N], with derivatives down to zero and below."""
    return ca.sqrt(ca.sqrt(thrust**2 + rest**2))


class Propeller(BodyElement):
    """A propeller with its motor.   tau/2 T' = gain sqrt(T) u - T

    Variables:  thrust [N] (T)
    Signals:    u [1] command, 0 to 1
    Connectors: frame, of the body: its centre of mass
    Parameters: tau [s] time constant of the speed, 0.05 by default; gain [sqrt(N)] root of the thrust at full command, 1 by default;
                torque_ratio [m] reaction torque over thrust, 0 by default; arm [m] distance from the centre of mass, 0 by default;
                azimuth [rad] of the arm from x towards y, 0 by default; spin [1] sense of rotation about z, 1 (clockwise seen from
                above) or -1, 1 by default
    Place:      the propeller's name, a thrust [N]
    """

    thrust = Variable("N", state=True, description="thrust")
    u = SignalInput("1", description="command, 0 to 1")
    tau = Parameter("s", 0.05, min=1e-9, description="time constant of the speed")
    gain = Parameter("sqrt(N)", 1.0, min=0.0, description="root of the thrust at full command")
    torque_ratio = Parameter("m", 0.0, min=0.0, description="reaction torque over thrust")
    arm = Parameter("m", 0.0, min=0.0, description="distance from the centre of mass")
    azimuth = Parameter("rad", 0.0, nominal=1.0, description="direction of the arm, from x towards y")
    spin = Parameter("1", 1.0, min=-1.0, max=1.0, description="sense of rotation about z")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        lift = ca.vertcat(0, 0, -c.thrust)
        place = c.arm * ca.vertcat(ca.cos(c.azimuth), ca.sin(c.azimuth), 0)
        return lift, ca.cross(place, lift) + c.spin * c.torque_ratio * lift

    def lag(self, c: Any) -> Equation:
        return balance(c.tau / 2 * c.der(c.thrust), c.gain * root(c.thrust, REST * c.gain**2) * c.u, -c.thrust, unit="N")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "thrust lag": self.lag(c)}


class AsymmetricPropeller(Propeller):
    """A propeller that spins up faster than down, having no brake.   tau/2 T' = gain sqrt(T) u - T = e,  tau_down for tau where e < 0

    The corner at e = 0 is rounded, and stays where it is:

        tau tau_down/(tau + tau_down) T' = e + (tau_down - tau)/(tau_down + tau) e tanh(e/width)

    Variables:  thrust [N] (T)
    Signals:    u [1] command, 0 to 1
    Connectors: frame, of the body: its centre of mass
    Parameters: those of `Propeller`, tau being that of spinning up; tau_down [s] time constant of spinning down, 0.05 by default;
                width [N] smoothing, 1e-3 by default
    Place:      the propeller's name, a thrust [N]
    """

    tau_down = Parameter("s", 0.05, min=1e-9, description="time constant of the speed when it falls")
    width = Parameter("N", 1e-3, min=1e-12, description="rounding of the corner where the thrust settles", smoothing=True)

    def lag(self, c: Any) -> Equation:
        e = c.gain * root(c.thrust, REST * c.gain**2) * c.u - c.thrust
        both = c.tau + c.tau_down
        return balance(c.tau * c.tau_down / both * c.der(c.thrust), e, (c.tau_down - c.tau) / both * e * ca.tanh(e / c.width), unit="N")


class PropellerInertia(BodyElement):
    """The angular momentum of a propeller about its axis, relative to the body: gyroscopic and counter torque.

        h = spin J Omega,   Omega = sqrt(T/k_r)          torque = -(h' e_z + omega x h e_z) = (-q h, p h, -h')

    It stands beside the propeller, whose thrust T it is told: `model.insert("body", PropellerInertia(J=1e-4), "inertia_1")`
    `.connect("rotor_1.thrust", "inertia_1.thrust")`. The inertia at rest relative to the body is part of the body's.

    Signals:    thrust [N] of the propeller
    Connectors: frame
    Parameters: J [kg.m2] moment of inertia about the axis, 0 by default (absent); k_r [N.s2] thrust over squared speed, 1e-5 by default;
                spin [1] sense of rotation about z, 1 or -1, 1 by default; rounded below 1 rad/s
    """

    thrust = SignalInput("N", description="thrust of the propeller")
    J = Parameter("kg.m2", 0.0, min=0.0, description="moment of inertia about the axis")
    k_r = Parameter("N.s2", 1e-5, min=1e-12, description="thrust over squared speed")
    spin = Parameter("1", 1.0, min=-1.0, max=1.0, description="sense of rotation about z")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        momentum = c.spin * c.J * root(c.thrust, c.k_r) / ca.sqrt(c.k_r) * ca.vertcat(0, 0, 1)
        _, omega = velocities(c.frame)
        return ca.SX.zeros(3), -(c.der(momentum) + ca.cross(omega, momentum))
