"""A vector along the axes of a frame, in the world's."""

from __future__ import annotations

import casadi as ca

from ...language import Expression


def turned(x: Expression, y: Expression, phi: Expression) -> tuple[Expression, Expression]:
    """R(phi) (x, y): a vector along the axes of a frame that is turned by phi [rad], along the world's."""
    cos, sin = ca.cos(phi), ca.sin(phi)
    return x * cos - y * sin, x * sin + y * cos
