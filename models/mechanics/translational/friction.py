"""Friction between two flanges that slide along one line. The formulas are those of `friction_laws`, with f for the force.

Every law has a `width` that rounds its corner at rest: the answer must not depend on it, and it is no physics.
"""

from typing import Any

from ...language import Equation, Parameter, SignalInput, Variable, equal, law
from ..friction_laws import (
    bristle_damping,
    bristle_rate,
    coulomb,
    logarithmic,
    magnitude,
    one_of_two,
    stick_slip,
    stribeck_level,
    wavy_level,
)
from .elements import MovingElement

WIDTH = Parameter("m/s", 1e-3, min=1e-12, description="rounding of the sign in the friction law", smoothing=True)


class Friction(MovingElement):
    """Viscous and Coulomb friction.   f = d v_rel + f_c sgn(v_rel)

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] viscous friction, 0 by default (absent); f_c [N] Coulomb friction, 0 by default (absent);
                width [m/s] smoothing, 1e-3 by default
    """

    d = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction")
    f_c = Parameter("N", 0.0, min=0.0, description="Coulomb friction")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.f, c.d * c.v_rel + coulomb(c.v_rel, c.f_c, c.width))}


class StribeckFriction(MovingElement):
    """Friction that falls from f_s to f_c as the body gets going.   f = d v_rel + (f_c + (f_s - f_c) exp(-(v_rel/v_s)^2)) sgn(v_rel)

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] viscous friction, 0 by default (absent); f_c [N] Coulomb friction, 0 by default (absent); f_s [N] friction at
                rest, 0 by default (absent); v_s [m/s] velocity of Stribeck, 1e-2 by default; width [m/s] smoothing, 1e-3 by default
    """

    d = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction")
    f_c = Parameter("N", 0.0, min=0.0, description="Coulomb friction")
    f_s = Parameter("N", 0.0, min=0.0, description="friction at rest")
    v_s = Parameter("m/s", 1e-2, min=1e-9, description="velocity of Stribeck")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        level = stribeck_level(c.v_rel, c.f_c, c.f_s, c.v_s)
        return {**super().equations(c), "friction law": law(c.f, c.d * c.v_rel + coulomb(c.v_rel, level, c.width))}


class LogarithmicFriction(MovingElement):
    """Friction that grows with the logarithm of the velocity.   f = sgn(v_rel) (b ln|v_rel/v0| + c) for |v_rel| >= v_dead, else 0

    As measured on an electromechanical actuator with v0 = 1 in/s and v_dead = 0.001 in/s. It takes power only while c >= b ln(v0/v_dead).

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: b [N] growth per factor e, 0 by default (absent); c [N] friction at v0, 0 by default (absent); v0 [m/s] 0.0254 by default;
                v_dead [m/s] 2.54e-5 by default; width [m/s] smoothing, 1e-5 by default
    """

    b = Parameter("N", 0.0, min=0.0, description="growth of the friction per factor e of the velocity")
    c = Parameter("N", 0.0, min=0.0, description="friction at v0")
    v0 = Parameter("m/s", 0.0254, min=1e-9, description="velocity of reference")
    v_dead = Parameter("m/s", 2.54e-5, min=1e-9, description="velocity below which there is no friction")
    width = Parameter("m/s", 1e-5, min=1e-12, description="rounding of the steps in the friction law", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.f, logarithmic(c.v_rel, c.b, c.c, c.v0, c.v_dead, c.width))}


class AsymmetricFriction(MovingElement):
    """Friction that depends on the direction.   f = d_plus v_rel + f_plus  for v_rel > 0,   d_minus v_rel - f_minus  for v_rel < 0

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d_plus, d_minus [N.s/m] viscous friction, 0 by default (absent); f_plus, f_minus [N] Coulomb friction,
                0 by default (absent); width [m/s] smoothing, 1e-3 by default
    """

    d_plus = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction forwards")
    d_minus = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction backwards")
    f_plus = Parameter("N", 0.0, min=0.0, description="Coulomb friction forwards")
    f_minus = Parameter("N", 0.0, min=0.0, description="Coulomb friction backwards")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        d = one_of_two(c.v_rel, c.d_plus, c.d_minus, c.width)
        level = one_of_two(c.v_rel, c.f_plus, c.f_minus, c.width)
        return {**super().equations(c), "friction law": law(c.f, d * c.v_rel + coulomb(c.v_rel, level, c.width))}


class PositionDependentFriction(MovingElement):
    """Friction that changes along the way.   f = d v_rel + f_c (1 + amplitude sin(2 pi s_rel/period + phase)) sgn(v_rel)

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: d [N.s/m] viscous friction, 0 by default (absent); f_c [N] Coulomb friction on average, 0 by default (absent);
                amplitude [1] of its change, 0 by default (absent), 1 at most; period [m] 0.1 by default; phase [rad] 0 by default;
                width [m/s] smoothing, 1e-3 by default
    """

    d = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction")
    f_c = Parameter("N", 0.0, min=0.0, description="Coulomb friction on average")
    amplitude = Parameter("1", 0.0, min=0.0, max=1.0, nominal=1.0, description="change of the Coulomb friction over its average")
    period = Parameter("m", 0.1, min=1e-9, description="period of the change")
    phase = Parameter("rad", 0.0, nominal=1.0, description="phase of the change at s_rel = 0")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        level = wavy_level(c.s_rel, c.f_c, c.amplitude, c.period, c.phase)
        return {**super().equations(c), "friction law": law(c.f, c.d * c.v_rel + coulomb(c.v_rel, level, c.width))}


class LoadFriction(MovingElement):
    """Coulomb friction under a constant load.   f = mu load sgn(v_rel)

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: mu [1] coefficient of friction, 0 by default (absent); load [N] 1 by default; width [m/s] smoothing, 1e-3 by default
    """

    mu = Parameter("1", 0.0, min=0.0, description="coefficient of friction")
    load = Parameter("N", 1.0, min=0.0, description="force that presses the bodies together")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.f, coulomb(c.v_rel, c.mu * c.load, c.width))}


class LoadDependentFriction(MovingElement):
    """Coulomb friction under a load that is told.   f = mu |load| sgn(v_rel)

    The load may be the force of an element ("screw.f"), a measured force, or a block of signals.

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Signals:    load [N] (input)
    Connectors: flange_a, flange_b
    Parameters: mu [1] coefficient of friction, 0 by default (absent); width [m/s] smoothing, 1e-3 by default; load_width [N] smoothing of
                |load|, 1e-3 by default
    """

    load = SignalInput("N", description="force that presses the bodies together")
    mu = Parameter("1", 0.0, min=0.0, description="coefficient of friction")
    load_width = Parameter("N", 1e-3, min=1e-12, description="rounding of |load|", smoothing=True)
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        level = c.mu * magnitude(c.load, c.load_width)
        return {**super().equations(c), "friction law": law(c.f, coulomb(c.v_rel, level, c.width))}


class StickSlip(MovingElement):
    """Coulomb friction f_sl while sliding; at rest it holds up to f_st.   f = f_sl sgn(v_rel) for v_rel != 0,  |f| <= f_st for v_rel = 0

    Rounded, the law peaks at f_st where |v_rel| = width, so a body that is held creeps at less than that. An f_st below f_sl has
    no effect in the limit.   D. Karnopp, J. Dyn. Sys. Meas. Control 107, 1985.

    Variables:  s_rel [m], v_rel [m/s], f [N]
    Connectors: flange_a, flange_b
    Parameters: f_sl [N] sliding friction, 0 by default (absent); f_st [N] breakaway force, 0 by default (absent);
                width [m/s] smoothing, 1e-3 by default
    """

    f_sl = Parameter("N", 0.0, min=0.0, description="friction while sliding")
    f_st = Parameter("N", 0.0, min=0.0, description="friction at breakaway")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.f, stick_slip(c.v_rel, c.f_sl, c.f_st, c.width))}


class DahlFriction(MovingElement):
    """Coulomb friction with elastic presliding.   f = sigma_0 z + d v_rel,   z' = v_rel - sigma_0 |v_rel| z/f_c

    P. R. Dahl, A solid friction model, Aerospace Corp. TOR-158, 1968.

    Variables:  s_rel [m], v_rel [m/s], f [N]; z [m] bending of the asperities (state)
    Connectors: flange_a, flange_b
    Parameters: sigma_0 [N/m] presliding stiffness, 1e5 by default; f_c [N] Coulomb friction, 1 by default; d [N.s/m] viscous friction,
                0 by default (absent); width [m/s] smoothing of |v_rel|, 1e-4 by default
    """

    z = Variable("m", nominal=1e-5, state=True, description="bending of the asperities")
    sigma_0 = Parameter("N/m", 1e5, min=0.0, description="presliding stiffness")
    f_c = Parameter("N", 1.0, min=1e-9, description="Coulomb friction")
    d = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction")
    width = Parameter("m/s", 1e-4, min=1e-12, description="rounding of |v_rel|", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "bending": equal(c.der(c.z), bristle_rate(c.v_rel, c.z, c.sigma_0, c.f_c, c.width)),
            "friction law": law(c.f, c.sigma_0 * c.z + c.d * c.v_rel),
        }


class LuGreFriction(MovingElement):
    """Stribeck friction with elastic presliding.   f = sigma_0 z + sigma_1 z' + d v_rel,   z' = v_rel - sigma_0 |v_rel| z/g

    g = f_c + (f_s - f_c) exp(-(v_rel/v_s)^2). At higher velocities sigma_1 gives way, so that the law takes power only (`bristle_damping`).
    C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Automatic Control 40, 1995, eqs. 1 to 4 (d is their sigma_2).

    Variables:  s_rel [m], v_rel [m/s], f [N]; z [m] mean bending of the bristles (state)
    Connectors: flange_a, flange_b
    Parameters: sigma_0 [N/m] stiffness of the bristles, 1e5 by default; sigma_1 [N.s/m] their damping, 0 by default (absent);
                f_c [N] Coulomb friction, 1 by default; f_s [N] friction at rest, 1 by default; v_s [m/s] velocity of Stribeck, 1e-2 by
                default; d [N.s/m] viscous friction, 0 by default (absent); width [m/s] smoothing of |v_rel|, 1e-4 by default
    """

    z = Variable("m", nominal=1e-5, state=True, description="mean bending of the bristles")
    sigma_0 = Parameter("N/m", 1e5, min=0.0, description="stiffness of the bristles")
    sigma_1 = Parameter("N.s/m", 0.0, min=0.0, description="damping of the bristles")
    f_c = Parameter("N", 1.0, min=1e-9, description="Coulomb friction")
    f_s = Parameter("N", 1.0, min=1e-9, description="friction at rest")
    v_s = Parameter("m/s", 1e-2, min=1e-9, description="velocity of Stribeck")
    d = Parameter("N.s/m", 0.0, min=0.0, description="viscous friction")
    width = Parameter("m/s", 1e-4, min=1e-12, description="rounding of |v_rel|", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        v, level = c.v_rel, stribeck_level(c.v_rel, c.f_c, c.f_s, c.v_s)
        rate, sigma_1 = bristle_rate(v, c.z, c.sigma_0, level, c.width), bristle_damping(v, c.sigma_1, level, c.width)
        return {
            **super().equations(c),
            "bending": equal(c.der(c.z), rate),
            "friction law": law(c.f, c.sigma_0 * c.z + sigma_1 * rate + c.d * v),
        }
