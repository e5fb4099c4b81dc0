"""Direct collocation at Radau points: every equation holds exactly there, residual forces are unknowns.

States are continuous polynomials of degree K on every interval, through their values at its start and at the K right Radau
points tau_j; z and w have values at the Radau points:

    F(x'(tau_j), x_j, z_j, u_j, p, w_j) = 0,     j = 1 .. K           cost  1/2 sum_j b_j h (w_j / std)^2

Order 2 K - 1 at the knots (Hairer & Wanner II, section IV.5). u_j is the held input's projection on polynomials of degree K - 1,
so that steps of the input inside an interval act with their full impulse.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae

from .interpolation import Interpolation, collocation_interpolation
from .pieces import Pieces
from .polynomials import Array, radau, radau_weights
from .terms import Term, stacked


def interpolation(dae: Dae, degree: int, forces: int) -> Interpolation:
    """Polynomials through values at the Radau points for every variable and residual force."""
    return collocation_interpolation(degree, dae.x.shape[0], dae.z.shape[0], forces)


def dynamics(pieces: Pieces, degree: int, std: Array) -> list[Term]:
    """All equations at the Radau points (constraints) and the residual forces there (cost)."""
    dae, steps, places = pieces.dae, pieces.steps(), radau(degree)
    count = len(steps)
    data = stacked(np.hstack([h.point_data(degree, places) for h in pieces.horizons]), count)
    soft = pieces.rows_of(pieces.soft)
    hard = [row for row in range(dae.residual.shape[0]) if row not in soft]
    equations = ca.vertcat(dae.residual[hard], pieces.balances() - dae.w[list(pieces.soft)]) if soft else dae.residual
    zero = np.zeros((degree * dae.residual.shape[0], count))
    common: dict[str, Any] = {"interval": np.arange(count), "nodes": places, "data": data}
    terms = [Term(name="equations", function=pieces.function("equations", equations), target=zero, scale=zero + 1, equality=True, **common)]
    if len(std):
        weight = np.sqrt(radau_weights(degree)[:, None] * steps)
        forces = pieces.function("forces", pieces.dae.w[list(pieces.soft)])
        scale = (weight[:, None, :] / std[:, None]).reshape(-1, count)
        terms.append(Term(name="residual forces", function=forces, target=np.zeros(scale.shape), scale=scale, **common))
    return terms
