"""Which variable of a component is the velocity whose sign its friction law rounds.

Those of the library have one name. In a law f(v/width, ...) of a user's own it is found by its equations: what the width does to a balance
hangs on the motion by way of v alone, so along the states and their rates the gradients

    d/d(x', x, z) dF/dwidth   and   dv/d(x', x, z)

are parallel everywhere, and v is linear in them.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae

VELOCITIES = ("v_rel", "w_rel", "omega_rel")  # in the library
POINTS = 5  # at which gradients are compared
PARALLEL = 1e-6  # of one beside another: what is left across it


def velocity_of(dae: Dae, component: str, width: int, slope: Any) -> str | None:
    """Its name among the model's variables; None where no variable of the component is it.

    width: index of the rounding parameter; slope: the residual's derivative in it, other parameters as numbers or symbols.
    """
    known = next((f"{component}.{v}" for v in VELOCITIES if f"{component}.{v}" in dae.variables), None)
    if known is not None:
        return known
    own = {name: e for name, e in dae.variables.items() if name.rpartition(".")[0] == component}
    if not own:
        return None
    motion = ca.vertcat(dae.dx, dae.x, dae.z)
    asked = [ca.jacobian(ca.sum1(slope), motion), *(ca.jacobian(e, motion) for e in own.values())]
    gradients = ca.Function("gradients", [motion, dae.u, dae.p, dae.w, dae.t], [ca.densify(g) for g in asked])
    rng, parts = np.random.default_rng(0), []
    for _ in range(POINTS):
        p = np.array([q.value or q.nominal for q in dae.parameters])
        p[width] = 1.0  # as large as the motion, or the law is flat wherever one looks
        at = rng.standard_normal(motion.shape[0]), rng.standard_normal(dae.u.shape[0]), p, np.zeros(dae.w.shape[0]), 0.0
        parts.append([np.asarray(g, dtype=np.float64).ravel() for g in gradients(*at)])
    law, *rest = (np.array(g) for g in zip(*parts, strict=True))
    for name, v in zip(own, rest, strict=True):
        linear = np.allclose(v, v[0]) and np.any(v[0])
        if linear and _parallel(law, v):
            return name
    return None


def _parallel(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> bool:
    """Whether the rows of a lie along those of b, and are not all nothing."""
    if not np.isfinite(a).all() or not np.any(a):
        return False
    along = np.sum(a * b, axis=1, keepdims=True) / np.sum(b * b, axis=1, keepdims=True) * b
    return bool(np.all(np.linalg.norm(a - along, axis=1) <= PARALLEL * np.linalg.norm(a, axis=1)))
