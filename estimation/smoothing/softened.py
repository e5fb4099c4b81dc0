"""Equations without a residual force, given one for a while: then a program has no constraints, and plain steps lead through it.

What ties an attitude to its rates carries no force, so it is a constraint of every program, and not a linear one. Far from the solution the
iterates of a solver with multipliers leave it for steps on end, at any cost. With a residual that is as small beside the equation's own
terms as those of the balances are it is one more row of the squares, and each step has to pay.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from backsight.models import Dae
from backsight.models.dae import Place

from ..problem import Problem


def softened(problem: Problem) -> Problem:
    """The problem with a place in every equation that has none, where one of these is not linear in what moves; else as it is.

    New places come after the model's own, so that the indices of these stay.
    """
    dae = problem.dae
    bare = bare_rows(dae)
    if not bare:
        return problem
    w = [ca.SX.sym(f"w_{r}") for r in bare]
    residual, equations, places = ca.SX(dae.residual), list(dae.equations), list(dae.places)
    for r, force in zip(bare, w, strict=True):
        e = equations[r]
        equations[r] = replace(e, place=len(places))
        name = f"{e.component}: {e.name}"
        places.append(Place(name=name, unit="", kind="law", enabled=True, origin=e.origin))
        residual[r] += force
    soft = replace(dae, w=ca.vertcat(dae.w, *w), residual=residual, equations=tuple(equations), places=tuple(places))
    return replace(problem, model=soft)


def bare_rows(dae: Dae) -> list[int]:
    """Rows without a residual force, but for rates of positions; none where all of them are linear in what moves."""
    exact = {row for _, _, row in dae.kinematics}
    bare = [r for r, e in enumerate(dae.equations) if e.place is None and e.shaped is None and r not in exact]
    moving = ca.vertcat(dae.dx, dae.x, dae.z)
    return bare if ca.depends_on(ca.jacobian(dae.residual[bare], moving), moving) else []
