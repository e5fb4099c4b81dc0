"""Friction laws as formulas, for sliding and turning alike: v is a relative velocity [m/s or rad/s], forces are forces or torques.

The sign of a velocity is rounded, sgn(v) -> tanh(v/width), and |v| likewise. The width is no physics: as it goes to zero every law becomes
the textbook one, and at every width it takes power only (F v >= 0), for levels and coefficients that are not negative.
All laws have derivatives of every order, but for the drag, whose second one jumps at rest.
"""

from typing import Any

import casadi as ca

Expression = Any  # a casadi SX scalar or a number


def coulomb(v: Expression, level: Expression, width: Expression) -> Expression:
    """F = level sgn(v)."""
    return level * ca.tanh(v / width)


def stribeck_level(v: Expression, f_c: Expression, f_s: Expression, v_s: Expression) -> Expression:
    """f_c + (f_s - f_c) exp(-(v/v_s)^2): from f_s at rest down to f_c.

    B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30, 1994: the Gaussian form of the Stribeck curve.
    """
    return f_c + (f_s - f_c) * ca.exp(-((v / v_s) ** 2))


def logarithmic(v: Expression, b: Expression, c: Expression, v0: Expression, v_dead: Expression, width: Expression) -> Expression:
    """F = sgn(v) (b ln|v/v0| + c) for |v| >= v_dead, else 0.

    Rounded: the step at +-v_dead to tanh, and |v| in the logarithm to m >= max(|v|, v_dead),
    2 m^2 = v^2 + v_dead^2 + sqrt((v^2 - v_dead^2)^2 + width^4). It is passive as the textbook law is: while c >= b ln(v0/v_dead), b >= 0.
    """
    moving = (ca.tanh((v - v_dead) / width) + ca.tanh((v + v_dead) / width)) / 2
    m2 = (v**2 + v_dead**2 + ca.sqrt((v**2 - v_dead**2) ** 2 + width**4)) / 2
    return moving * (b * ca.log(m2 / v0**2) / 2 + c)


def one_of_two(v: Expression, plus: Expression, minus: Expression, width: Expression) -> Expression:
    """plus for v > 0, minus for v < 0, and between them in between."""
    return (plus + minus) / 2 + (plus - minus) / 2 * ca.tanh(v / width)


def stick_slip_level(v: Expression, sliding: Expression, breakaway: Expression, width: Expression) -> Expression:
    """sliding + (breakaway - sliding) h(v/width),   h(s) = s^2 exp(1 - s^2): a peak of height one at |s| = 1."""
    s2 = (v / width) ** 2
    return sliding + (breakaway - sliding) * s2 * ca.exp(1 - s2)


def stick_slip(v: Expression, sliding: Expression, breakaway: Expression, width: Expression) -> Expression:
    """F = sliding sgn(v) while moving; up to `breakaway` at rest.   F = level tanh(8 v/width)

    The law rises steeply from rest to `breakaway` at |v| = width (to 3e-7, for tanh(8) is not quite one) and falls to `sliding` within four
    widths. So a body that is held creeps at less than one width, and breaks away at `breakaway`. A breakaway below the sliding level has
    no effect in the limit: the body is then held up to the sliding level.
    """
    return stick_slip_level(v, sliding, breakaway, width) * ca.tanh(8 * v / width)


def bristle_rate(v: Expression, z: Expression, sigma_0: Expression, level: Expression, width: Expression) -> Expression:
    """z' = v - sigma_0 |v| z / level: the mean bending of bristles, |z| <= level/sigma_0 once it is so.   |v| -> v tanh(v/width)

    P. R. Dahl, Aerospace Corp. TOR-158, 1968 (with a constant level); C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky,
    IEEE Trans. Automatic Control 40, 1995, eqs. 1 to 4 (with the level of Stribeck).
    """
    return v - sigma_0 * v * ca.tanh(v / width) * z / level


def bristle_damping(v: Expression, sigma_1: Expression, level: Expression, width: Expression) -> Expression:
    """sigma_1 / (1 + sigma_1 |v| / (4 level)): the damping of the bristles, which has to vanish with speed.

    With the energy sigma_0 z^2/2 and a = sigma_0 |v|/level, the power of F = sigma_0 z + sigma z' that is not stored is
    sigma_0 a z^2 - sigma a z v + sigma v^2. It is not negative for all z and v while sigma <= 4 level/|v|, which this keeps. (H. Olsson,
    K. J. Astrom, C. Canudas de Wit, M. Gafvert, P. Lischinsky, European J. Control 4, 1998, let it vanish as a Gaussian, for this reason.)
    """
    return sigma_1 / (1 + sigma_1 * v * ca.tanh(v / width) / (4 * level))


def drag(v: Expression, d: Expression, c: Expression) -> Expression:
    """F = d v + c v |v|: the resistance of a fluid, laminar and turbulent."""
    return d * v + c * v * ca.fabs(v)


def wavy_level(s: Expression, level: Expression, amplitude: Expression, period: Expression, phase: Expression) -> Expression:
    """level (1 + amplitude sin(2 pi s/period + phase)): a level that changes with the position s."""
    return level * (1 + amplitude * ca.sin(2 * ca.pi * s / period + phase))


def magnitude(load: Expression, rounding: Expression) -> Expression:
    """|load|, rounded so that it is zero at zero and never above |load|: sqrt(load^2 + rounding^2) - rounding."""
    return ca.sqrt(load**2 + rounding**2) - rounding
