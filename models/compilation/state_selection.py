"""Minimal coordinates of a closed loop: dummy derivatives (S. E. Mattsson, G. Soderlind, SIAM J. Sci. Comput. 14, 1993).

Index reduction leaves m invariants I(x, t) = 0 between n states x. When n - m of them, x_1, are named as independent, the other m, x_2,
become algebraic variables that the invariants determine, and their derivatives algebraic variables of their own:

    F(x_1', x_2', x_1, x_2, z) = 0,  I(x_1, x_2) = 0        unknown:  x_1', and the algebraics  x_2, x_2', z

as many equations as before and m fewer states; no invariant is left to drift. It is right while I can be solved for x_2, that is while the
mechanism is away from the positions where x_1 cannot move it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from .flat import FlatModel
from .index_reduction import Semi, kinematics
from .singularity import typical
from .structure import fault, incidence

SX = Any


def select_states(flat: FlatModel, system: Semi, wanted: Sequence[str]) -> Semi:
    """The system with the states `wanted`, their rates, and those outside all constraints as its only states, and no invariants.

    Raises ModelError when `wanted` names something that is no state, too many, too few, or dependent coordinates.
    """
    known = [x.name() for x in system.x]
    moving = kinematics(system)
    bound = _names([row.residual for row in system.invariants])
    constrained = [x for x in known if x in bound]
    for state in wanted:
        if state not in known:
            raise ModelError(
                f"model '{flat.name}': states names '{state}', which is no independent coordinate: other equations give it as an "
                f"expression of the states {', '.join(known)}; name one of these, or leave it out"
            )
    if not system.invariants:
        return system
    kept = _with_rates(wanted, moving)
    free = len(constrained) - len(system.invariants)
    chosen = [x for x in constrained if x in kept]
    if len(chosen) != free:
        raise _miscounted(flat, wanted, constrained, chosen, free, moving)
    dependent = [x for x in system.x if x.name() in constrained and x.name() not in kept]
    _refuse_dependent(flat, system, dependent, wanted)
    return _dummies(system, {x.name() for x in dependent}, moving)


def _miscounted(
    flat: FlatModel, wanted: Sequence[str], constrained: list[str], chosen: list[str], free: int, moving: dict[str, tuple[int, SX]]
) -> ModelError:
    """Too many or too few coordinates, counted without their rates where each has one."""
    rates = {rate for x in constrained if x in moving for rate in _with_rates([x], moving) - {x}}
    paired = 2 * len(rates) == len(constrained)
    what, share = ("coordinates", 2) if paired else ("states", 1)
    every = [x for x in constrained if not (paired and x in rates)]
    named, spare = [x for x in every if x in chosen], [x for x in every if x not in chosen]
    number = free // share
    lack, are = number - len(named), "is" if number == 1 else "are"
    remedy = f"name {lack} more of {', '.join(spare)}" if lack > 0 else f"leave out {-lack} of them"
    if number == 0:
        return ModelError(
            f"model '{flat.name}': states = ({', '.join(wanted)}): the closed loops leave none of the {what} {', '.join(every)} free; "
            "remove a coupling that says the same twice, or name no states"
        )
    return ModelError(
        f"model '{flat.name}': states = ({', '.join(wanted)}) names {len(named)} of the {what} in closed loops ({', '.join(every)}), "
        f"of which {number} {are} independent; {remedy}"
    )


def _with_rates(wanted: Sequence[str], moving: dict[str, tuple[int, SX]]) -> set[str]:
    """The names, and of each x with x' = v the v too."""
    kept: set[str] = set()
    front = list(wanted)
    while front:
        state = front.pop()
        kept.add(state)
        rate = moving[state][1] if state in moving else ca.SX(0)
        if rate.is_symbolic() and rate.name() not in kept:
            front.append(rate.name())
    return kept


def _refuse_dependent(flat: FlatModel, system: Semi, dependent: list[SX], wanted: Sequence[str]) -> None:
    """The invariants must determine the dependent states: structurally, and in the numbers at random points."""
    over, _, _, under = fault(incidence(system.invariants, {x.name(): i for i, x in enumerate(dependent)}))
    rows = ca.vertcat(*(row.residual for row in system.invariants))
    singular = bool(over or under) or not regular(flat, ca.jacobian(rows, ca.vertcat(*dependent)))
    if singular:
        left = [dependent[i].name() for i in under] or [x.name() for x in dependent]
        raise ModelError(
            f"model '{flat.name}': states = ({', '.join(wanted)}) are not independent: with them given, the constraints "
            f"{', '.join(repr(row.origin) for row in system.invariants)} do not determine {', '.join(left)}; name other coordinates"
        )


def regular(flat: FlatModel, matrix: SX) -> bool:
    """Whether a square matrix of expressions is regular somewhere: looked up at random points around typical values."""
    symbols = ca.symvar(matrix)
    value = ca.Function("matrix", [ca.vertcat(*symbols)], [ca.densify(matrix)])
    size = np.array([typical(flat, s.name()) for s in symbols])
    generator = np.random.default_rng(0)
    for _ in range(4):
        point: NDArray[np.float64] = value(size * generator.uniform(0.5, 1.5, len(size))).full()
        if not np.all(np.isfinite(point)):
            continue
        scaled = point / np.maximum(np.abs(point).max(axis=1, keepdims=True), 1e-300)
        spread = np.linalg.svd(scaled, compute_uv=False)
        if spread[-1] > 1e-10 * spread[0]:
            return True
    return False


def _dummies(system: Semi, dependent: set[str], moving: dict[str, tuple[int, SX]]) -> Semi:
    """Dependent states and their derivatives as algebraics; x_2' is v_2 where the kinematics say so."""
    gone = {moving[x][0] for x in dependent if x in moving}
    stay = [(x, dx) for x, dx in zip(system.x, system.dx, strict=True) if x.name() not in dependent]
    go = [(x, dx) for x, dx in zip(system.x, system.dx, strict=True) if x.name() in dependent]
    return Semi(
        x=[x for x, _ in stay],
        dx=[dx for _, dx in stay],
        z=[*(x for x, _ in go), *system.z, *(dx for x, dx in go if x.name() not in moving)],
        equations=[
            *(row for i, row in enumerate(system.equations) if i not in gone),
            *(replace(row, kind="equal", slot=None) for row in system.invariants),
        ],
        invariants=[],
        index=system.index,
    )


def _names(expressions: list[SX]) -> set[str]:
    return {s.name() for s in ca.symvar(ca.vertcat(*expressions))} if expressions else set()
