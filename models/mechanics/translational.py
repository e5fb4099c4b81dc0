"""Components that slide along one line.

A body has one flange; any number of elements may be connected to it. Elements have two, and follow the sign convention of `connectors`.
"""

from typing import Any

import casadi as ca

from ..connectors import Translational
from ..language import Component, Equation, Parameter, Variable, balance, equal, law
from ..model import ground_of


class Mass(Component):
    """A sliding body.   m v' = f

    Variables:  s [m] position, v [m/s] velocity
    Connectors: flange
    Parameters: m [kg] mass, 1 by default
    """

    s = Variable("m", state=True, description="position")
    v = Variable("m/s", state=True, description="velocity")
    flange = Translational()
    m = Parameter("kg", 1.0, min=0.0, description="mass")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "position": equal(c.s, c.flange.s),
            "velocity": equal(c.v, c.der(c.s)),
            "force balance": balance(c.m * c.der(c.v), c.flange.f),
        }


@ground_of(Translational)
class Fixed(Component):
    """The ground: the origin of positions, which takes any force.   s = 0

    Connectors: flange
    """

    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"position": equal(c.flange.s, 0)}


class Rigid(Component):
    """A rigid coupling: the place where a compliance or backlash may enter later.   s_a = s_b

    Variables:  f [N] force from flange_a to flange_b
    Connectors: flange_a, flange_b
    """

    f = Variable("N", description="force from flange_a to flange_b")
    flange_a = Translational()
    flange_b = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "rigidity": law(c.flange_a.s, c.flange_b.s, unit="m"),
            "force at flange_a": equal(c.flange_a.f, c.f),
            "force at flange_b": equal(c.flange_b.f, -c.f),
        }


class Element(Component):
    """Base of the elements with two flanges: relative position s_rel [m] and force f [N] from flange_a to flange_b."""

    s_rel = Variable("m", description="position of flange_a relative to flange_b")
    f = Variable("N", description="force from flange_a to flange_b")
    flange_a = Translational()
    flange_b = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "relative position": equal(c.s_rel, c.flange_a.s - c.flange_b.s),
            "force at flange_a": equal(c.flange_a.f, c.f),
            "force at flange_b": equal(c.flange_b.f, -c.f),
        }


class Spring(Element):
    """A linear spring.   f = k (s_rel - s_rel0)

    Variables:  s_rel [m], f [N]
    Connectors: flange_a, flange_b
    Parameters: k [N/m] stiffness, 1 by default; s_rel0 [m] unstretched s_rel, 0 by default
    """

    k = Parameter("N/m", 1.0, min=0.0, description="stiffness")
    s_rel0 = Parameter("m", 0.0, description="unstretched relative position")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "spring law": law(c.f, c.k * (c.s_rel - c.s_rel0))}


class Damper(Element):
    """A linear damper.   f = d s_rel'

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] damping, 1 by default
    """

    v_rel = Variable("m/s", description="velocity of flange_a relative to flange_b")
    d = Parameter("N.s/m", 1.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "relative velocity": equal(c.v_rel, c.der(c.s_rel)),
            "damper law": law(c.f, c.d * c.v_rel),
        }


class Friction(Element):
    """Viscous and Coulomb friction.   f = d v_rel + f_c tanh(v_rel / width)

    The sign of the Coulomb law is rounded over `width`: the answer must not depend on it, and it is no physics.

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] viscous friction, 0 by default (absent); f_c [N] Coulomb friction, 0 by default (absent);
                width [m/s] smoothing, 1e-3 by default
    """

    v_rel = Variable("m/s", description="velocity of flange_a relative to flange_b")
    d = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction")
    f_c = Parameter("N", 0.0, min=0.0, description="Coulomb friction")
    width = Parameter("m/s", 1e-3, min=1e-12, description="rounding of the sign in the Coulomb law", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "relative velocity": equal(c.v_rel, c.der(c.s_rel)),
            "friction law": law(c.f, c.d * c.v_rel + c.f_c * ca.tanh(c.v_rel / c.width)),
        }


class ConstantForce(Component):
    """A constant force that pushes flange_a back and flange_b forth.   flange_a.f = f

    Between a body (flange_a) and ground it is a load: a weight, or the offset of a friction law.

    Connectors: flange_a, flange_b
    Parameters: f [N] force, 0 by default (absent)
    """

    flange_a = Translational()
    flange_b = Translational()
    f = Parameter("N", 0.0, description="force from flange_a to flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"constant force": law(c.flange_a.f, c.f), "force at flange_b": equal(c.flange_b.f, -c.flange_a.f)}


class Force(Component):
    """A force source: pushes its flange in the positive direction with the force f, an input of the model.   flange.f = -f

    Variables:  f [N] force, to be named as an input
    Connectors: flange
    """

    f = Variable("N", description="force on the flange")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.f, -c.f)}


class PositionSensor(Component):
    """An ideal position sensor.   s = flange.s

    Variables:  s [m]
    Connectors: flange (takes no force)
    """

    s = Variable("m", description="measured position")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no force": equal(c.flange.f, 0), "reading": equal(c.s, c.flange.s)}


class VelocitySensor(Component):
    """An ideal velocity sensor.   v = flange.s'

    Variables:  v [m/s]
    Connectors: flange (takes no force)
    """

    v = Variable("m/s", description="measured velocity")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no force": equal(c.flange.f, 0), "reading": equal(c.v, c.der(c.flange.s))}


class AccelerationSensor(Component):
    """An ideal acceleration sensor.   a = flange.s''

    Variables:  v [m/s], a [m/s2]
    Connectors: flange (takes no force)
    """

    v = Variable("m/s", description="velocity of the flange")
    a = Variable("m/s2", description="measured acceleration")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no force": equal(c.flange.f, 0), "velocity": equal(c.v, c.der(c.flange.s)), "reading": equal(c.a, c.der(c.v))}
