"""Friction between two flanges that turn about one axis. The formulas are those of `friction_laws`, with tau for the torque.

Every law has a `width` that rounds its corner at rest: the answer must not depend on it, and it is no physics.
"""

from typing import Any

import casadi as ca

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
from .elements import TurningElement

WIDTH = Parameter("rad/s", 1e-2, min=1e-12, description="rounding of the sign in the friction law", smoothing=True)


class RotationalFriction(TurningElement):
    """Viscous and Coulomb friction.   tau = d omega_rel + tau_c sgn(omega_rel)

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] viscous friction, 0 by default (absent); tau_c [N.m] Coulomb friction, 0 by default (absent);
                width [rad/s] smoothing, 1e-2 by default
    """

    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction")
    tau_c = Parameter("N.m", 0.0, min=0.0, description="Coulomb friction")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.tau, c.d * c.omega_rel + coulomb(c.omega_rel, c.tau_c, c.width))}


class RotationalStribeckFriction(TurningElement):
    """Friction that falls from tau_s to tau_c as the body gets going.   tau = d omega_rel + g sgn(omega_rel)

    g = tau_c + (tau_s - tau_c) exp(-(omega_rel/omega_s)^2)

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] viscous friction, 0 by default (absent); tau_c [N.m] Coulomb friction, 0 by default (absent);
                tau_s [N.m] friction at rest, 0 by default (absent); omega_s [rad/s] velocity of Stribeck, 0.1 by default;
                width [rad/s] smoothing, 1e-2 by default
    """

    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction")
    tau_c = Parameter("N.m", 0.0, min=0.0, description="Coulomb friction")
    tau_s = Parameter("N.m", 0.0, min=0.0, description="friction at rest")
    omega_s = Parameter("rad/s", 0.1, min=1e-9, description="velocity of Stribeck")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        level = stribeck_level(c.omega_rel, c.tau_c, c.tau_s, c.omega_s)
        return {**super().equations(c), "friction law": law(c.tau, c.d * c.omega_rel + coulomb(c.omega_rel, level, c.width))}


class RotationalLogarithmicFriction(TurningElement):
    """Friction that grows with the logarithm of the velocity.   tau = sgn(omega_rel) (b ln|omega_rel/omega0| + c)

    No friction for |omega_rel| < omega_dead. It takes power only while c >= b ln(omega0/omega_dead).

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: b [N.m] growth per factor e, 0 by default (absent); c [N.m] friction at omega0, 0 by default (absent);
                omega0 [rad/s] 1 by default; omega_dead [rad/s] 1e-3 by default; width [rad/s] smoothing, 1e-4 by default
    """

    b = Parameter("N.m", 0.0, min=0.0, description="growth of the friction per factor e of the velocity")
    c = Parameter("N.m", 0.0, min=0.0, description="friction at omega0")
    omega0 = Parameter("rad/s", 1.0, min=1e-9, description="velocity of reference")
    omega_dead = Parameter("rad/s", 1e-3, min=1e-9, description="velocity below which there is no friction")
    width = Parameter("rad/s", 1e-4, min=1e-12, description="rounding of the steps in the friction law", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.tau, logarithmic(c.omega_rel, c.b, c.c, c.omega0, c.omega_dead, c.width))}


class RotationalAsymmetricFriction(TurningElement):
    """Friction that depends on the direction.   tau = d_plus omega_rel + tau_plus forwards,   d_minus omega_rel - tau_minus backwards

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d_plus, d_minus [N.m.s/rad] viscous friction, 0 by default (absent); tau_plus, tau_minus [N.m] Coulomb friction,
                0 by default (absent); width [rad/s] smoothing, 1e-2 by default
    """

    d_plus = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction forwards")
    d_minus = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction backwards")
    tau_plus = Parameter("N.m", 0.0, min=0.0, description="Coulomb friction forwards")
    tau_minus = Parameter("N.m", 0.0, min=0.0, description="Coulomb friction backwards")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        d = one_of_two(c.omega_rel, c.d_plus, c.d_minus, c.width)
        level = one_of_two(c.omega_rel, c.tau_plus, c.tau_minus, c.width)
        return {**super().equations(c), "friction law": law(c.tau, d * c.omega_rel + coulomb(c.omega_rel, level, c.width))}


class RotationalPositionDependentFriction(TurningElement):
    """Friction that changes along the way.   tau = d omega_rel + tau_c (1 + amplitude sin(2 pi phi_rel/period + phase)) sgn(omega_rel)

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: d [N.m.s/rad] viscous friction, 0 by default (absent); tau_c [N.m] Coulomb friction on average, 0 by default (absent);
                amplitude [1] of its change, 0 by default (absent), 1 at most; period [rad] 2 pi by default (one turn);
                phase [rad] 0 by default; width [rad/s] smoothing, 1e-2 by default
    """

    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction")
    tau_c = Parameter("N.m", 0.0, min=0.0, description="Coulomb friction on average")
    amplitude = Parameter("1", 0.0, min=0.0, max=1.0, nominal=1.0, description="change of the Coulomb friction over its average")
    period = Parameter("rad", 2 * ca.pi, min=1e-9, description="period of the change")
    phase = Parameter("rad", 0.0, nominal=1.0, description="phase of the change at phi_rel = 0")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        level = wavy_level(c.phi_rel, c.tau_c, c.amplitude, c.period, c.phase)
        return {**super().equations(c), "friction law": law(c.tau, c.d * c.omega_rel + coulomb(c.omega_rel, level, c.width))}


class RotationalLoadFriction(TurningElement):
    """Coulomb friction under a constant load.   tau = mu load sgn(omega_rel)

    The load is a torque: what a shaft transmits, or the force on a bearing times its radius.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: mu [1] coefficient of friction, 0 by default (absent); load [N.m] 1 by default; width [rad/s] smoothing, 1e-2 by default
    """

    mu = Parameter("1", 0.0, min=0.0, description="coefficient of friction")
    load = Parameter("N.m", 1.0, min=0.0, description="load times its lever")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.tau, coulomb(c.omega_rel, c.mu * c.load, c.width))}


class RotationalLoadDependentFriction(TurningElement):
    """Coulomb friction under a load that is told.   tau = mu |load| sgn(omega_rel)

    The load is a torque: of an element ("shaft.tau"), a measured one, or a bearing's force times its radius, from a block of signals.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Signals:    load [N.m] (input)
    Connectors: flange_a, flange_b
    Parameters: mu [1] coefficient of friction, 0 by default (absent); width [rad/s] smoothing, 1e-2 by default;
                load_width [N.m] smoothing of |load|, 1e-3 by default
    """

    load = SignalInput("N.m", description="load times its lever")
    mu = Parameter("1", 0.0, min=0.0, description="coefficient of friction")
    load_width = Parameter("N.m", 1e-3, min=1e-12, description="rounding of |load|", smoothing=True)
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        level = c.mu * magnitude(c.load, c.load_width)
        return {**super().equations(c), "friction law": law(c.tau, coulomb(c.omega_rel, level, c.width))}


class StickSlip(TurningElement):
    """Coulomb friction tau_sl while sliding; at rest it holds up to tau_st.   tau = tau_sl sgn(omega_rel);  |tau| <= tau_st at rest

    Rounded, the law peaks at tau_st where |omega_rel| = width, so a body that is held creeps at less than that. A tau_st below tau_sl has
    no effect in the limit.   D. Karnopp, J. Dyn. Sys. Meas. Control 107, 1985.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]
    Connectors: flange_a, flange_b
    Parameters: tau_sl [N.m] sliding friction, 0 by default (absent); tau_st [N.m] breakaway torque, 0 by default (absent);
                width [rad/s] smoothing, 1e-2 by default
    """

    tau_sl = Parameter("N.m", 0.0, min=0.0, description="friction while sliding")
    tau_st = Parameter("N.m", 0.0, min=0.0, description="friction at breakaway")
    width = WIDTH

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "friction law": law(c.tau, stick_slip(c.omega_rel, c.tau_sl, c.tau_st, c.width))}


class RotationalDahlFriction(TurningElement):
    """Coulomb friction with elastic presliding.   tau = sigma_0 z + d omega_rel,   z' = omega_rel - sigma_0 |omega_rel| z/tau_c

    P. R. Dahl, A solid friction model, Aerospace Corp. TOR-158, 1968.

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]; z [rad] bending of the asperities (state)
    Connectors: flange_a, flange_b
    Parameters: sigma_0 [N.m/rad] presliding stiffness, 1e3 by default; tau_c [N.m] Coulomb friction, 1 by default;
                d [N.m.s/rad] viscous friction, 0 by default (absent); width [rad/s] smoothing of |omega_rel|, 1e-3 by default
    """

    z = Variable("rad", nominal=1e-3, state=True, description="bending of the asperities")
    sigma_0 = Parameter("N.m/rad", 1e3, min=0.0, description="presliding stiffness")
    tau_c = Parameter("N.m", 1.0, min=1e-9, description="Coulomb friction")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction")
    width = Parameter("rad/s", 1e-3, min=1e-12, description="rounding of |omega_rel|", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            **super().equations(c),
            "bending": equal(c.der(c.z), bristle_rate(c.omega_rel, c.z, c.sigma_0, c.tau_c, c.width)),
            "friction law": law(c.tau, c.sigma_0 * c.z + c.d * c.omega_rel),
        }


class RotationalLuGreFriction(TurningElement):
    """Stribeck friction with elastic presliding.   tau = sigma_0 z + sigma_1 z' + d omega_rel,   z' = omega_rel - sigma_0 |omega_rel| z/g

    g = tau_c + (tau_s - tau_c) exp(-(omega_rel/omega_s)^2). At higher velocities sigma_1 gives way, so that the law takes power only
    (`bristle_damping`).
    C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Automatic Control 40, 1995, eqs. 1 to 4 (d is their sigma_2).

    Variables:  phi_rel [rad], omega_rel [rad/s], tau [N.m]; z [rad] mean bending of the bristles (state)
    Connectors: flange_a, flange_b
    Parameters: sigma_0 [N.m/rad] stiffness of the bristles, 1e3 by default; sigma_1 [N.m.s/rad] their damping, 0 by default (absent);
                tau_c [N.m] Coulomb friction, 1 by default; tau_s [N.m] friction at rest, 1 by default; omega_s [rad/s] velocity of
                Stribeck, 0.1 by default; d [N.m.s/rad] viscous friction, 0 by default (absent); width [rad/s] smoothing of |omega_rel|,
                1e-3 by default
    """

    z = Variable("rad", nominal=1e-3, state=True, description="mean bending of the bristles")
    sigma_0 = Parameter("N.m/rad", 1e3, min=0.0, description="stiffness of the bristles")
    sigma_1 = Parameter("N.m.s/rad", 0.0, min=0.0, description="damping of the bristles")
    tau_c = Parameter("N.m", 1.0, min=1e-9, description="Coulomb friction")
    tau_s = Parameter("N.m", 1.0, min=1e-9, description="friction at rest")
    omega_s = Parameter("rad/s", 0.1, min=1e-9, description="velocity of Stribeck")
    d = Parameter("N.m.s/rad", 0.0, min=0.0, description="viscous friction")
    width = Parameter("rad/s", 1e-3, min=1e-12, description="rounding of |omega_rel|", smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        v, level = c.omega_rel, stribeck_level(c.omega_rel, c.tau_c, c.tau_s, c.omega_s)
        rate, sigma_1 = bristle_rate(v, c.z, c.sigma_0, level, c.width), bristle_damping(v, c.sigma_1, level, c.width)
        return {
            **super().equations(c),
            "bending": equal(c.der(c.z), rate),
            "friction law": law(c.tau, c.sigma_0 * c.z + sigma_1 * rate + c.d * v),
        }
