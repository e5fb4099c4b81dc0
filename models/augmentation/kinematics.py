"""A position whose rate is its velocity but for a residual:  s' - v = w."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from ..dae import Dae, Place
from ..errors import InputError, suggestion


def relaxed_kinematics(dae: Dae, state: str) -> Dae:
    """The model with a residual in the row that says that the state's rate is its velocity, at the place `kinematics:<state>`.

    Both stay states, and each becomes a trajectory of its own; w has the unit of the velocity. As its std goes to 0 the two agree again.

    Raises InputError where no row says so of the state, or it has a residual already.
    """
    place = f"kinematics:{state}"
    if place in [p.name for p in dae.places]:
        raise InputError(f"relaxed_kinematics({state!r}): there is a residual already; give it one only.")
    positions = {dae.states[i].name: (i, j, row) for i, j, row in dae.kinematics}
    if state not in positions:
        raise InputError(
            f"relaxed_kinematics({state!r}): {dae.name} has no position of that name with a velocity beside it; "
            f"{suggestion(state, positions)}"
        )
    i, j, row = positions[state]
    w = ca.SX.sym(f"w[{place}]")
    residual = ca.SX(dae.residual)
    residual[row] -= w
    origin = f"{state}: its rate is {dae.states[j].name}"
    told = replace(dae.equations[row], place=len(dae.places))
    return replace(
        dae,
        w=ca.vertcat(dae.w, w),
        places=(*dae.places, Place(name=place, unit=dae.states[j].unit, kind="law", enabled=True, origin=origin)),
        residual=residual,
        equations=(*dae.equations[:row], told, *dae.equations[row + 1 :]),
        kinematics=tuple(k for k in dae.kinematics if k != (i, j, row)),
    )
