"""Components that turn about one axis, and the two that tie a rotation to another motion: `Gear` and `Rack`.

The same physics as `translational`, angle for position and torque for force; the sign convention of `connectors` holds.
"""

from typing import Any

import casadi as ca

from ..connectors import Rotational, Translational
from ..language import Component, Equation, Parameter, Variable, balance, equal, law
from ..model import ground_of


class Inertia(Component):
    """A turning body.   J omega' = tau

    Variables:  phi [rad] angle, omega [rad/s] angular velocity
    Connectors: flange
    Parameters: J [kg.m2] moment of inertia, 1 by default
    """

    phi = Variable("rad", state=True, description="angle")
    omega = Variable("rad/s", state=True, description="angular velocity")
    flange = Rotational()
    J = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "angle": equal(c.phi, c.flange.phi),
            "angular velocity": equal(c.omega, c.der(c.phi)),
            "torque balance": balance(c.J * c.der(c.omega), c.flange.tau),
        }


@ground_of(Rotational)
class RotationalFixed(Component):
    """The ground: the origin of angles, which takes any torque.   phi = 0

    Connectors: flange
    """

    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"angle": equal(c.flange.phi, 0)}


class RotationalRigid(Component):
    """A rigid shaft: the place where a torsional compliance or backlash may enter later.   phi_a = phi_b

    Variables:  tau [N.m] torque from flange_a to flange_b
    Connectors: flange_a, flange_b
    """

    tau = Variable("N.m", description="torque from flange_a to flange_b")
    flange_a = Rotational()
    flange_b = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rigidity": law(c.flange_a.phi, c.flange_b.phi, unit="rad"),
            "torque at flange_a": equal(c.flange_a.tau, c.tau),
            "torque at flange_b": equal(c.flange_b.tau, -c.tau),
        }


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


class RotationalDamper(RotationalElement):
    """A linear damper.   tau = d phi_rel'

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] damping, 1 by default
    """

    omega_rel = Variable("rad/s", description="angular velocity of flange_a relative to flange_b")
    d = Parameter("N.m.s/rad", 1.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "relative velocity": equal(c.omega_rel, c.der(c.phi_rel)),
            "damper law": law(c.tau, c.d * c.omega_rel),
        }


class RotationalSpringDamper(RotationalElement):
    """A torsion spring with its own damping: a spindle, a shaft.   tau = k phi_rel + d phi_rel'

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: k [N.m/rad] stiffness, 1 by default; d [N.m.s/rad] damping, 0 by default (absent)
    """

    omega_rel = Variable("rad/s", description="angular velocity of flange_a relative to flange_b")
    k = Parameter("N.m/rad", 1.0, min=0.0, description="stiffness")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "relative velocity": equal(c.omega_rel, c.der(c.phi_rel)),
            "spring and damper law": law(c.tau, c.k * c.phi_rel + c.d * c.omega_rel),
        }


class RotationalFriction(RotationalElement):
    """Viscous and Coulomb friction.   tau = d omega_rel + tau_c tanh(omega_rel / width)

    The sign of the Coulomb law is rounded over `width`: the answer must not depend on it, and it is no physics.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] viscous friction, 0 by default (absent); tau_c [N.m] Coulomb friction, 0 by default (absent);
                width [rad/s] smoothing, 1e-2 by default
    """

    omega_rel = Variable("rad/s", description="angular velocity of flange_a relative to flange_b")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction")
    tau_c = Parameter("N.m", 0.0, min=0.0, description="Coulomb friction")
    width = Parameter("rad/s", 1e-2, min=1e-12, description="rounding of the sign in the Coulomb law", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "relative velocity": equal(c.omega_rel, c.der(c.phi_rel)),
            "friction law": law(c.tau, c.d * c.omega_rel + c.tau_c * ca.tanh(c.omega_rel / c.width)),
        }


class ConstantTorque(Component):
    """A constant torque that turns flange_a back and flange_b forth: between a body and ground, a load.   flange_a.tau = tau

    Connectors: flange_a, flange_b
    Parameters: tau [N.m] torque, 0 by default (absent)
    """

    flange_a = Rotational()
    flange_b = Rotational()
    tau = Parameter("N.m", 0.0, description="torque from flange_a to flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"constant torque": law(c.flange_a.tau, c.tau), "torque at flange_b": equal(c.flange_b.tau, -c.flange_a.tau)}


class Torque(Component):
    """A torque source: turns its flange in the positive direction with the torque tau, an input of the model.   flange.tau = -tau

    Variables:  tau [N.m] torque, to be named as an input
    Connectors: flange
    """

    tau = Variable("N.m", description="torque on the flange")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.tau, -c.tau)}


class Gear(Component):
    """An ideal gear: no inertia, no loss.   phi_a = ratio phi_b,   ratio tau_a + tau_b = 0

    Connectors: flange_a (fast side for ratio > 1), flange_b
    Parameters: ratio [1] 1 by default
    """

    flange_a = Rotational()
    flange_b = Rotational()
    ratio = Parameter("1", 1.0, description="angle of flange_a per angle of flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "gear ratio": equal(c.flange_a.phi, c.ratio * c.flange_b.phi),
            "torque ratio": equal(c.ratio * c.flange_a.tau + c.flange_b.tau, 0),
        }


class Rack(Component):
    """A wheel rolling on a rack, belt or rope: no inertia, no loss.   s = r phi,   tau + r f = 0

    Connectors: wheel (rotational), rack (translational)
    Parameters: r [m] radius of the wheel, 1 by default
    """

    wheel = Rotational()
    rack = Translational()
    r = Parameter("m", 1.0, description="radius of the wheel")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rolling": equal(c.rack.s, c.r * c.wheel.phi),
            "power balance": equal(c.wheel.tau + c.r * c.rack.f, 0),
        }


class AngleSensor(Component):
    """An ideal angle sensor.   phi = flange.phi

    Variables:  phi [rad]
    Connectors: flange (takes no torque)
    """

    phi = Variable("rad", description="measured angle")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no torque": equal(c.flange.tau, 0), "reading": equal(c.phi, c.flange.phi)}


class AngularVelocitySensor(Component):
    """An ideal angular velocity sensor.   omega = flange.phi'

    Variables:  omega [rad/s]
    Connectors: flange (takes no torque)
    """

    omega = Variable("rad/s", description="measured angular velocity")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no torque": equal(c.flange.tau, 0), "reading": equal(c.omega, c.der(c.flange.phi))}


class AngularAccelerationSensor(Component):
    """An ideal angular acceleration sensor.   alpha = flange.phi''

    Variables:  omega [rad/s], alpha [rad/s2]
    Connectors: flange (takes no torque)
    """

    omega = Variable("rad/s", description="angular velocity of the flange")
    alpha = Variable("rad/s2", description="measured angular acceleration")
    flange = Rotational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "no torque": equal(c.flange.tau, 0),
            "velocity": equal(c.omega, c.der(c.flange.phi)),
            "reading": equal(c.alpha, c.der(c.omega)),
        }
