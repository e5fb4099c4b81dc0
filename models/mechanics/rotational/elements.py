"""Springs, dampers, drag, stops, weight and cogging between two flanges that turn about one axis.

Elements follow the sign convention of `connectors`: the torque tau enters at flange_a and leaves at flange_b.
"""

from typing import Any

import casadi as ca

from ...connectors import Rotational
from ...language import Component, Equation, Parameter, Variable, equal, law
from ..contact_laws import contact
from ..friction_laws import drag


class RotationalElement(Component):
    """Base of the elements with two flanges: relative angle phi_rel [rad] and torque tau [N.m] from flange_a to flange_b."""

    phi_rel = Variable("rad", description="angle of flange_a relative to flange_b")
    tau = Variable("N.m", description="torque from flange_a to flange_b")
    flange_a = Rotational()
    flange_b = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "relative angle": equal(c.phi_rel, c.flange_a.phi - c.flange_b.phi),
            "torque at flange_a": equal(c.flange_a.tau, c.tau),
            "torque at flange_b": equal(c.flange_b.tau, -c.tau),
        }


class TurningElement(RotationalElement):
    """Base of the elements whose torque depends on the relative angular velocity omega_rel [rad/s]."""

    omega_rel = Variable("rad/s", description="angular velocity of flange_a relative to flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "relative velocity": equal(c.omega_rel, c.der(c.phi_rel))}


class RotationalSpring(RotationalElement):
    """A linear torsion spring.   tau = k (phi_rel - phi_rel0)

    Variables:  phi_rel [rad], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: k [N.m/rad] stiffness, 1 by default; phi_rel0 [rad] untwisted phi_rel, 0 by default
    """

    k = Parameter("N.m/rad", 1.0, min=0.0, description="stiffness")
    phi_rel0 = Parameter("rad", 0.0, description="untwisted relative angle")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "spring law": law(c.tau, c.k * (c.phi_rel - c.phi_rel0))}


class RotationalCubicSpring(RotationalElement):
    """A torsion spring that hardens, or softens with k3 < 0.   tau = k x + k3 x^3,   x = phi_rel - phi_rel0

    G. Duffing, Erzwungene Schwingungen bei veranderlicher Eigenfrequenz, 1918.

    Variables:  phi_rel [rad], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: k [N.m/rad] stiffness, 0 by default (absent); k3 [N.m/rad3] cubic stiffness, 0 by default (absent); phi_rel0 [rad] untwisted
                phi_rel, 0 by default
    """

    k = Parameter("N.m/rad", 0.0, min=0.0, description="stiffness")
    k3 = Parameter("N.m/rad3", 0.0, description="cubic stiffness")
    phi_rel0 = Parameter("rad", 0.0, description="untwisted relative angle")

    def equations(self, c: Any) -> dict[str, Equation]:
        x = c.phi_rel - c.phi_rel0
        return {**super().equations(c), "spring law": law(c.tau, c.k * x + c.k3 * x**3)}


class RotationalDamper(TurningElement):
    """A linear damper.   tau = d omega_rel

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] damping, 1 by default
    """

    d = Parameter("N.m.s/rad", 1.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "damper law": law(c.tau, c.d * c.omega_rel)}


class RotationalSpringDamper(TurningElement):
    """A torsion spring with its own damping: a spindle, a shaft.   tau = k phi_rel + d omega_rel

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: k [N.m/rad] stiffness, 1 by default; d [N.m.s/rad] damping, 0 by default (absent)
    """

    k = Parameter("N.m/rad", 1.0, min=0.0, description="stiffness")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "spring and damper law": law(c.tau, c.k * c.phi_rel + c.d * c.omega_rel)}


class RotationalDrag(TurningElement):
    """The resistance of a fluid: a fan, a propeller.   tau = d omega_rel + c omega_rel |omega_rel|

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] linear drag, 0 by default (absent); c [N.m.s2/rad2] quadratic drag, 0 by default (absent)
    """

    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="linear drag")
    c = Parameter("N.m.s2/rad2", 0.0, min=0.0, description="quadratic drag")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "drag law": law(c.tau, drag(c.omega_rel, c.d, c.c))}


class RotationalEndStop(TurningElement):
    """An elastic stop that flange_a meets from below.   tau = max(0, k (phi_rel - x) + d omega_rel) for phi_rel > x, else 0

    Its corners are rounded (`contact_laws`): it never pulls.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: x [rad] angle of the stop, 0 by default; k [N.m/rad] stiffness, 1e3 by default; d [N.m.s/rad] damping,
                0 by default (absent); width [rad] smoothing, 1e-5 by default
    """

    x = Parameter("rad", 0.0, description="angle of the stop")
    k = Parameter("N.m/rad", 1e3, min=1e-15, description="stiffness of the stop")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping of the stop")
    width = Parameter("rad", 1e-5, min=1e-15, description="rounding of the corners of the contact", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "contact law": law(c.tau, contact(c.phi_rel - c.x, c.omega_rel, c.k, c.d, c.width))}


class RotationalLowerEndStop(RotationalEndStop):
    """An elastic stop that flange_a meets from above.   tau = min(0, k (phi_rel - x) + d omega_rel) for phi_rel < x, else 0

    Variables, connectors and parameters are those of `RotationalEndStop`.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: x [rad], k [N.m/rad], d [N.m.s/rad], width [rad]
    """

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "contact law": law(c.tau, -contact(c.x - c.phi_rel, -c.omega_rel, c.k, c.d, c.width))}


class EccentricWeight(RotationalElement):
    """The weight of a body whose centre lies beside the axis.   tau = tau_sin sin(phi_rel) + tau_cos cos(phi_rel)

    An arm of mass m, its centre at l from the axis and at alpha from the horizontal where phi_rel = 0, has tau_sin = -m g l sin(alpha) and
    tau_cos = m g l cos(alpha).

    Variables:  phi_rel [rad], tau [N.m]
    Connectors: flange_a on the body, flange_b at rest
    Parameters: tau_sin, tau_cos [N.m] 0 by default (absent)
    """

    tau_sin = Parameter("N.m", 0.0, description="torque at a quarter turn")
    tau_cos = Parameter("N.m", 0.0, description="torque at phi_rel = 0")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "weight": law(c.tau, c.tau_sin * ca.sin(c.phi_rel) + c.tau_cos * ca.cos(c.phi_rel))}


class RotationalCogging(RotationalElement):
    """The torque of magnets or teeth, which takes no power on average.   tau = amplitude sin(2 pi phi_rel/period + phase)

    Variables:  phi_rel [rad], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: amplitude [N.m] 0 by default (absent); period [rad] 2 pi by default (one turn); phase [rad] 0 by default
    """

    amplitude = Parameter("N.m", 0.0, description="amplitude of the torque")
    period = Parameter("rad", 2 * ca.pi, min=1e-9, description="period of the torque")
    phase = Parameter("rad", 0.0, nominal=1.0, description="phase of the torque at phi_rel = 0")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "cogging": law(c.tau, c.amplitude * ca.sin(2 * ca.pi * c.phi_rel / c.period + c.phase))}
