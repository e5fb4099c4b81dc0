"""Springs, dampers, drag, stops and cogging between two flanges that slide along one line.

Elements follow the sign convention of `connectors`: the force f enters at flange_a and leaves at flange_b.
"""

from typing import Any

import casadi as ca

from ...connectors import Translational
from ...language import Component, Equation, Parameter, Variable, equal, law
from ..contact_laws import contact
from ..friction_laws import drag


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


class MovingElement(Element):
    """Base of the elements whose force depends on the relative velocity v_rel [m/s]."""

    v_rel = Variable("m/s", description="velocity of flange_a relative to flange_b")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "relative velocity": equal(c.v_rel, c.der(c.s_rel))}


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


class CubicSpring(Element):
    """A spring that hardens, or softens with k3 < 0: the spring of Duffing.   f = k x + k3 x^3,   x = s_rel - s_rel0

    G. Duffing, Erzwungene Schwingungen bei veranderlicher Eigenfrequenz, 1918.

    Variables:  s_rel [m], f [N]
    Connectors: flange_a, flange_b
    Parameters: k [N/m] stiffness, 0 by default (absent); k3 [N/m3] cubic stiffness, 0 by default (absent); s_rel0 [m] unstretched s_rel,
                0 by default
    """

    k = Parameter("N/m", 0.0, min=0.0, description="stiffness")
    k3 = Parameter("N/m3", 0.0, description="cubic stiffness")
    s_rel0 = Parameter("m", 0.0, description="unstretched relative position")

    def equations(self, c: Any) -> dict[str, Equation]:
        x = c.s_rel - c.s_rel0
        return {**super().equations(c), "spring law": law(c.f, c.k * x + c.k3 * x**3)}


class Damper(MovingElement):
    """A linear damper.   f = d v_rel

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] damping, 1 by default
    """

    d = Parameter("N.s/m", 1.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "damper law": law(c.f, c.d * c.v_rel)}


class SpringDamper(MovingElement):
    """A compliance: a spring with its own damping.   f = k s_rel + d v_rel

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: k [N/m] stiffness, 1 by default; d [N.s/m] damping, 0 by default (absent)
    """

    k = Parameter("N/m", 1.0, min=0.0, description="stiffness")
    d = Parameter("N.s/m", 0.0, min=0.0, description="damping")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "spring and damper law": law(c.f, c.k * c.s_rel + c.d * c.v_rel)}


class Drag(MovingElement):
    """The resistance of a fluid.   f = d v_rel + c v_rel |v_rel|

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] linear drag, 0 by default (absent); c [N.s2/m2] quadratic drag, 0 by default (absent)
    """

    d = Parameter("N.s/m", 0.0, min=0.0, description="linear drag")
    c = Parameter("N.s2/m2", 0.0, min=0.0, description="quadratic drag")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "drag law": law(c.f, drag(c.v_rel, c.d, c.c))}


class EndStop(MovingElement):
    """An elastic stop that flange_a meets from below.   f = max(0, k (s_rel - x) + d v_rel) for s_rel > x, else 0

    Its corners are rounded (`contact_laws`): it never pulls.

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: x [m] position of the stop, 0 by default; k [N/m] stiffness, 1e6 by default; d [N.s/m] damping, 0 by default (absent);
                width [m] smoothing, 1e-6 by default
    """

    x = Parameter("m", 0.0, description="position of the stop")
    k = Parameter("N/m", 1e6, min=1e-15, description="stiffness of the stop")
    d = Parameter("N.s/m", 0.0, min=0.0, description="damping of the stop")
    width = Parameter("m", 1e-6, min=1e-15, description="rounding of the corners of the contact", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "contact law": law(c.f, contact(c.s_rel - c.x, c.v_rel, c.k, c.d, c.width))}


class LowerEndStop(EndStop):
    """An elastic stop that flange_a meets from above.   f = min(0, k (s_rel - x) + d v_rel) for s_rel < x, else 0

    Variables, connectors and parameters are those of `EndStop`.

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: x [m], k [N/m], d [N.s/m], width [m]
    """

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "contact law": law(c.f, -contact(c.x - c.s_rel, -c.v_rel, c.k, c.d, c.width))}


class Cogging(Element):
    """The force of magnets or teeth, which takes no power on average.   f = amplitude sin(2 pi s_rel/period + phase)

    Variables:  s_rel [m], f [N]
    Connectors: flange_a, flange_b
    Parameters: amplitude [N] 0 by default (absent); period [m] 0.01 by default; phase [rad] 0 by default
    """

    amplitude = Parameter("N", 0.0, description="amplitude of the force")
    period = Parameter("m", 0.01, min=1e-9, description="period of the force")
    phase = Parameter("rad", 0.0, nominal=1.0, description="phase of the force at s_rel = 0")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "cogging": law(c.f, c.amplitude * ca.sin(2 * ca.pi * c.s_rel / c.period + c.phase))}
