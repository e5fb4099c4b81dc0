"""What carries a torque from one part to the next: shafts, gears, and wheels on racks or belts.

A torsional compliance between two angles is a `RotationalSpringDamper` of elements. None but the string and the play takes power.
"""

from typing import Any

import casadi as ca

from ...connectors import Rotational, Translational
from ...language import Component, Equation, Parameter, Variable, equal, law
from ..contact_laws import play
from .elements import TurningElement


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


class TorsionString(Component):
    """A long torsion spring of which only the twist is known: its ends may turn any number of times.   tau = k dphi + d dphi'

    Variables:  dphi [rad] twist, flange_a against flange_b (state); omega_rel [rad/s] its rate; tau [N.m] torque from flange_a to flange_b
    Connectors: flange_a, flange_b
    Parameters: k [N.m/rad] stiffness, 1 by default; d [N.m.s/rad] damping, 0 by default (absent)
    """

    dphi = Variable("rad", state=True, description="twist of flange_a against flange_b")
    omega_rel = Variable("rad/s", description="angular velocity of flange_a relative to flange_b")
    tau = Variable("N.m", description="torque from flange_a to flange_b")
    flange_a = Rotational()
    flange_b = Rotational()
    k = Parameter("N.m/rad", 1.0, min=0.0, description="stiffness")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "relative velocity": equal(c.omega_rel, c.der(c.flange_a.phi) - c.der(c.flange_b.phi)),
            "twist": equal(c.der(c.dphi), c.omega_rel),
            "torsion law": law(c.tau, c.k * c.dphi + c.d * c.omega_rel),
            "torque at flange_a": equal(c.flange_a.tau, c.tau),
            "torque at flange_b": equal(c.flange_b.tau, -c.tau),
        }


class RotationalBacklash(TurningElement):
    """A coupling with play.   tau = 0 for |phi_rel| < gap/2;   k (phi_rel -+ gap/2) + d omega_rel beyond, as long as that does not pull

    Its corners are rounded (`contact_laws`).

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: gap [rad] total play, 0 by default (absent); k [N.m/rad] stiffness of the contact, 1e3 by default; d [N.m.s/rad] damping of
                the contact, 0 by default (absent); width [rad] smoothing, 1e-5 by default
    """

    gap = Parameter("rad", 0.0, min=0.0, description="total play")
    k = Parameter("N.m/rad", 1e3, min=1e-9, description="stiffness of the contact")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping of the contact")
    width = Parameter("rad", 1e-5, min=1e-15, description="rounding of the corners of the contact", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "backlash law": law(c.tau, play(c.phi_rel, c.omega_rel, c.gap, c.k, c.d, c.width))}


class Gear(Component):
    """An ideal gear: no inertia, no loss.   phi_a = ratio phi_b,   ratio tau_a + tau_b = 0

    Connectors: flange_a (fast side for ratio > 1), flange_b
    Parameters: ratio [1] 1 by default
    """

    flange_a = Rotational()
    flange_b = Rotational()
    ratio = Parameter("1", 1.0, nonzero=True, description="angle of flange_a per angle of flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "gear ratio": equal(c.flange_a.phi, c.ratio * c.flange_b.phi),
            "torque ratio": equal(c.ratio * c.flange_a.tau + c.flange_b.tau, 0),
        }


class GearWithError(Gear):
    """A gear with a kinematic error: eccentric or uneven teeth.   phi_a = ratio phi_b + amplitude (sin(order phi_b + phase) - sin(phase))

    No inertia, no loss: the torques follow by virtual work, tau_a dphi_a/dphi_b + tau_b = 0.
    Similar to T. D. Tuttle, W. P. Seering, IEEE Trans. Robotics and Automation 12, 1996, section III, there as a sum of such terms.

    Connectors: flange_a (fast side for ratio > 1), flange_b
    Parameters: ratio [1] 1 by default; amplitude [rad] of the error at flange_a, 0 by default (absent); order [1] periods per turn of
                flange_b, 1 by default (twice per turn of flange_a: 2 ratio); phase [rad] 0 by default
    """

    amplitude = Parameter("rad", 0.0, description="amplitude of the error at flange_a")
    order = Parameter("1", 1.0, min=0.0, description="periods of the error per turn of flange_b")
    phase = Parameter("rad", 0.0, nominal=1.0, description="phase of the error at flange_b.phi = 0")

    def equations(self, c: Any) -> dict[str, Equation]:
        at = c.order * c.flange_b.phi + c.phase
        slope = c.ratio + c.amplitude * c.order * ca.cos(at)
        return {
            "gear ratio": equal(c.flange_a.phi, c.ratio * c.flange_b.phi + c.amplitude * (ca.sin(at) - ca.sin(c.phase))),
            "torque ratio": equal(slope * c.flange_a.tau + c.flange_b.tau, 0),
        }


class Rack(Component):
    """A wheel rolling on a rack, belt or rope: no inertia, no loss.   s = r phi,   tau + r f = 0

    Connectors: wheel (rotational), rack (translational)
    Parameters: r [m] radius of the wheel, 1 by default
    """

    wheel = Rotational()
    rack = Translational()
    r = Parameter("m", 1.0, nonzero=True, description="radius of the wheel")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rolling": equal(c.rack.s, c.r * c.wheel.phi),
            "power balance": equal(c.wheel.tau + c.r * c.rack.f, 0),
        }


class EccentricRack(Rack):
    """A wheel on a rack or belt whose axis is off its centre.   s = r phi + amplitude (sin(phi + phase) - sin(phase))

    No inertia, no loss: the torque follows by virtual work, tau + f ds/dphi = 0.

    Connectors: wheel (rotational), rack (translational)
    Parameters: r [m] radius of the wheel, 1 by default; amplitude [m] distance of the axis from the centre, 0 by default (absent);
                phase [rad] 0 by default
    """

    amplitude = Parameter("m", 0.0, description="distance of the axis from the centre")
    phase = Parameter("rad", 0.0, nominal=1.0, description="direction of the centre at phi = 0")

    def equations(self, c: Any) -> dict[str, Equation]:
        at = c.wheel.phi + c.phase
        return {
            "rolling": equal(c.rack.s, c.r * c.wheel.phi + c.amplitude * (ca.sin(at) - ca.sin(c.phase))),
            "power balance": equal(c.wheel.tau + (c.r + c.amplitude * ca.cos(at)) * c.rack.f, 0),
        }
