"""Equations of motion from energies: for a mechanism that is easier to describe by its motion than by the forces in its joints.

With coordinates q, velocities v = q', kinetic energy T(q, v) and potential energy V(q), the forces that the coordinates need are

    Q = d/dt (dT/dv) - dT/dq + dV/dq                      (Lagrange's equations of the second kind)

and a force F along a displacement r(q), known from the coordinates, acts on them with F dr/dq (virtual work), so that the power of the
coordinates' forces is that of F and what the energies store.
H. Goldstein, C. Poole, J. Safko, Classical Mechanics, 3rd ed., 2002, eqs. 1.49 and 1.57.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca

Expression = Any  # a casadi SX scalar
Symbol = Any  # a casadi SX scalar symbol


def generalised_forces(
    c: Any, q: Sequence[Symbol], v: Sequence[Symbol], kinetic: Expression, potential: Expression = 0.0
) -> list[Expression]:
    """d/dt (dT/dv_i) - dT/dq_i + dV/dq_i, one per coordinate.

    c           symbols of the component, for its time derivative
    q, v        (n,) coordinates and their velocities; the component says v = q' in equations of its own
    kinetic     T(q, v) [J]
    potential   V(q) [J], none by default
    """
    lagrangian = ca.SX(kinetic) - ca.SX(potential)
    return [c.der(ca.gradient(ca.SX(kinetic), rate)) - ca.gradient(lagrangian, place) for place, rate in zip(q, v, strict=True)]


def virtual_work(q: Sequence[Symbol], work: Sequence[tuple[Expression, Expression]]) -> list[Expression]:
    """sum_k F_k dr_k/dq_i, one per coordinate.

    q      (n,) coordinates
    work   pairs (r_k(q), F_k) of a displacement [m] or angle [rad] and the force [N] or torque [N.m] that acts along it
    """
    return [sum((force * ca.gradient(ca.SX(way), place) for way, force in work), start=ca.SX(0)) for place in q]
