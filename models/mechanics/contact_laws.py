"""Contact and play as formulas, for sliding and turning alike: x is a penetration [m or rad], forces are forces or torques.

    contact   F = max(0, k x + d x')  for x > 0,  else 0           a spring and damper that presses and does not pull
    play      F = contact at +gap/2 and at -gap/2                  M. Nordin, P.-O. Gutman, Automatica 38, 2002 (there gap = 2 alpha)

The corners are rounded over a width w:

    F = (1 + tanh(x/w))/2 * (q + sqrt(q^2 + (k w)^2))/2,    q = k x + d x'

So F is never negative. Without x' it is the force of a spring, which stores energy; what x' adds to it has the sign of x', and takes power,
at every width.
"""

from typing import Any

import casadi as ca

Expression = Any  # a casadi SX scalar or a number


def contact(x: Expression, rate: Expression, k: Expression, d: Expression, width: Expression) -> Expression:
    """The force that presses two bodies apart, from their penetration x, its rate, stiffness k > 0 and damping d."""
    q = k * x + d * rate
    return (1 + ca.tanh(x / width)) / 2 * (q + ca.sqrt(q**2 + (k * width) ** 2)) / 2


def play(x: Expression, rate: Expression, gap: Expression, k: Expression, d: Expression, width: Expression) -> Expression:
    """The force across a gap of total size `gap` whose sides are elastic; none inside it, |x| < gap/2."""
    return contact(x - gap / 2, rate, k, d, width) - contact(-x - gap / 2, -rate, k, d, width)
