"""Algebraic variables along a trajectory, from the equations that must hold exactly: the angles inside a closed loop, say.

    G(x', x, z, u, p, t) = 0:  the rows of F without residual force in which z appears

A loop can be closed in more than one way, and between two of them its equations are singular. So the first instant starts at the
variables' own start values, and each of the others at the instant before: Newton steps in the order of time.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from backsight.models import Dae

from .polynomials import Array

NEWTON_STEPS = 8  # an instant; from the one before, two or three reach rounding
SOLVED = 1e-6  # of the size of the variables: largest last step of Newton's


def algebraics_along(dae: Dae, dx: Array, x: Array, u: Array, parameters: Array, times: Array) -> Array:
    """z (nz, M) at M instants in the order of time, from x', x (nx, M), u (nu, M), parameters (np_all,) and the model's time (M,).

    The start values where these equations do not determine z, or from where on no solution is found.
    """
    start = np.array([q.start for q in dae.algebraics], dtype=np.float64)
    level = np.repeat(start[:, None], len(times), axis=1)
    F = dae.undisturbed(dae.residual)
    rows = [r for r in sorted(set(ca.jacobian_sparsity(F, dae.z).row())) if dae.equations[r].place is None]
    if len(rows) != len(start) or not rows:
        return level
    G = F[rows]
    slope = ca.jacobian(G, dae.z)
    if ca.sprank(slope) < len(rows):
        return level
    step = ca.Function("step", [dae.z, dae.dx, dae.x, dae.u, dae.p, dae.t], [dae.z - ca.solve(slope, G)])
    inputs = [ca.MX.sym(name, *step.size_in(i)) for i, name in enumerate(("z", "dx", "x", "u", "p", "t"))]
    before, z = inputs[0], inputs[0]
    for _ in range(NEWTON_STEPS):
        before, z = z, step(z, *inputs[1:])
    sweep = ca.Function("instant", inputs, [z, z - before]).mapaccum("sweep", len(times))
    repeated = np.tile(parameters[:, None], len(times))
    found, last = (np.asarray(a, dtype=np.float64) for a in sweep(start, dx, x, u, repeated, times[None, :]))
    lost = ~np.all(np.abs(last) <= SOLVED * (1.0 + np.abs(found)), axis=0)
    return np.where(np.logical_or.accumulate(lost), level, found)
