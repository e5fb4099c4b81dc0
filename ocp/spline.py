"""Implicit splines: the equations of motion in weak form, with soft or hard balances.

On every interval of length h the residual w(t) = F(x', x, z, u, p) of an equation is projected on the first K Legendre
polynomials L_j, orthonormal on [0, 1]:

    eps_j = 1/(std sqrt(h)) * integral over the interval of L_j(tau) w dt,        j = 0 .. K - 1

White noise of spectral density std^2 gives independent eps_j of variance one, so the cost 1/2 sum eps_j^2 is
1/2 int (w/std)^2 dt for what the interval can resolve, j = 0 being the impulse. An equation without residual force has
all its K moments at zero. Unknowns and moments are equal in number (`interpolation.py`), so as std -> 0 only the initial
values and the parameters stay free, and the method becomes the Petrov-Galerkin method with C1 trial functions: collocation at
Gauss points when the integrand is smooth, of order 2 K at the knots (de Boor & Swartz, SIAM J. Numer. Anal. 10, 1973).
The integrals are taken with K + 1 Gauss points, which is exact for a linear model. The held input enters by its projection on
polynomials of degree K - 1, whose moments are exactly those of the steps, wherever in the interval they fall.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backsight.models import Dae

from .interpolation import Interpolation, spline_interpolation
from .pieces import Pieces
from .polynomials import Array, gauss, legendre
from .terms import Term, stacked


def pairs(dae: Dae) -> tuple[tuple[int, int, int], ...]:
    """Positions with their velocities and the kinematic row that says so; no state is used twice."""
    taken: set[int] = set()
    chosen = []
    for i, j, row in dae.kinematics:
        if not {i, j} & taken:
            chosen.append((i, j, row))
            taken |= {i, j}
    return tuple(chosen)


def rows(dae: Dae, places: Sequence[int]) -> tuple[list[int], list[int]]:
    """Rows of the residual whose moments are in the cost, with residual forces of these places, and of which they are constraints."""
    soft, identities = dae.rows_of(places), {row for _, _, row in pairs(dae)}
    return soft, [row for row in range(dae.residual.shape[0]) if row not in identities and row not in soft]


def interpolation(dae: Dae, degree: int, forces: int) -> Interpolation:
    """Splines for every variable; residual forces are not unknowns but what the balances leave over."""
    del forces
    return spline_interpolation(degree, dae.x.shape[0], dae.z.shape[0], [(i, j) for i, j, _ in pairs(dae)])


def dynamics(pieces: Pieces, degree: int, std: Array) -> list[Term]:
    """Moments of the balances with a residual force (cost) and of all other equations (constraints)."""
    dae = pieces.dae
    soft, hard = rows(dae, pieces.soft)
    steps, (places, weights) = pieces.steps(), gauss(degree + 1)
    moments = (weights * legendre(degree, places)).T
    data = np.hstack([h.point_data(degree, places) for h in pieces.horizons])
    terms = []
    for name, some, scale in (("balances", soft, 1.0 / std), ("equations", hard, np.ones(len(hard)))):
        if some:
            expression = pieces.balances() if name == "balances" else dae.residual[some]
            terms.append(
                Term(
                    name=name,
                    function=pieces.function(name, expression),
                    interval=np.arange(len(steps)),
                    nodes=places,
                    moments=moments,
                    data=stacked(data, len(steps)),
                    target=np.zeros((degree * len(some), len(steps))),
                    scale=np.tile(scale, degree)[:, None] * np.sqrt(steps),
                    equality=name == "equations",
                    heavy=name == "balances",
                )
            )
    return terms
