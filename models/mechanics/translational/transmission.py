"""What carries a force from one sliding part to the next: rigidly, or with play.

A compliance is a `SpringDamper` of elements.
"""

from typing import Any

from ...connectors import Translational
from ...language import Component, Equation, Parameter, Variable, equal, law
from ..contact_laws import play
from .elements import MovingElement


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


class Backlash(MovingElement):
    """A coupling with play.   f = 0 for |s_rel| < gap/2;   k (s_rel -+ gap/2) + d v_rel beyond, as long as that does not pull

    Its corners are rounded (`contact_laws`).

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: gap [m] total play, 0 by default (absent); k [N/m] stiffness of the contact, 1e6 by default; d [N.s/m] damping of the
                contact, 0 by default (absent); width [m] smoothing, 1e-6 by default
    """

    gap = Parameter("m", 0.0, min=0.0, description="total play")
    k = Parameter("N/m", 1e6, min=1e-9, description="stiffness of the contact")
    d = Parameter("N.s/m", 0.0, min=0.0, description="damping of the contact")
    width = Parameter("m", 1e-6, min=1e-15, description="rounding of the corners of the contact", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "backlash law": law(c.f, play(c.s_rel, c.v_rel, c.gap, c.k, c.d, c.width))}
