"""Which places keep a residual of their own, and which stands for a place whose balance was merged into other equations.

A balance that is merged hands its residual on to the equations that held the force it was solved for, and these, when used up, to others.
Where that ends in no residual, a law on the way (that of the slide which carries the body) is switched on, so that no degree of freedom of
a mechanism loses its residual. A law whose residual would move nothing that the others do not move already, such as another joint of the
same closed loop, stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..dae import Place
from ..errors import ModelError
from .eliminate import Heirs, Reduced
from .index_reduction import Semi
from .singularity import sample

SX = Any


def keep_freedoms(
    slots: dict[str, SX], available: Mapping[str, Place], reduce: Callable[[Mapping[str, SX]], tuple[Semi, Reduced]]
) -> tuple[Semi, Reduced, dict[str, SX]]:
    """The reduced system and its residuals w by place, with those laws switched on that alone stand for merged balances.

    reduce  residuals w by place -> the reduced system
    """
    system, reduced = reduce(slots)
    tried = set(slots)
    while fresh := [place for place in _asleep(reduced.merged, system, slots) if place not in tried]:
        place = fresh[0]
        tried.add(place)
        more = {other: slots.get(other, ca.SX.sym(f"w[{other}]")) for other in available if other in slots or other == place}
        grown, by_more = reduce(more)
        if _moved(grown, by_more, more) > _moved(system, reduced, slots):
            system, reduced, slots = grown, by_more, more
    return system, reduced, slots


def heirs_of(merged: Mapping[str, Heirs], system: Semi) -> dict[str, list[str]]:
    """For every place that was dropped the places of the equations left that its force acts on, nearest first.

    Where these have none, those of the equations that share algebraic variables (forces) with them.
    """
    rows = {e.origin: e for e in system.equations}
    algebraics = {z.name() for z in system.z}
    shared = {origin: {*e.held} & algebraics for origin, e in rows.items()} if merged else {}

    def places(origins: Sequence[str]) -> list[str]:
        return [slot[0] for origin in origins if origin in rows and (slot := rows[origin].slot)]

    found = {}
    for dropped, heirs in merged.items():
        near = [origin for origin in heirs.left if origin in rows]
        if not places(near):
            for origin in near:  # which grows
                near += [other for other in rows if other not in near and shared[origin] & shared[other]]
        found[dropped] = places(near)
    return found


def standing(heirs: Mapping[str, Sequence[str]], kept: Collection[str]) -> dict[str, str]:
    """For every place that was dropped the first that has a residual in its stead; "" for none."""
    return {place: next((other for other in others if other in kept), "") for place, others in heirs.items()}


def refuse_dropped(place: str, heirs: Sequence[str], available: Mapping[str, Place]) -> ModelError:
    """The error for a place that was asked for and has no row of its own."""
    if not heirs:
        return ModelError(f"place '{place}' has no residual: what holds it takes any force there; ask for another place")
    names = " and ".join(f"'{other}'" for other in heirs)
    units = ", ".join(dict.fromkeys(available[other].unit for other in heirs))
    whose = "whose residual" if len(heirs) == 1 else "whose residuals"
    stands = "stands" if len(heirs) == 1 else "stand"
    return ModelError(
        f"place '{place}' has no residual of its own: it moves with {names}, {whose} [{units}] {stands} for it too; ask for {names} instead"
    )


def _asleep(merged: Mapping[str, Heirs], system: Semi, slots: Collection[str]) -> list[str]:
    """The laws without a residual that the forces of merged balances went into, where these have no residual in their stead."""
    heirs = heirs_of(merged, system)
    lost = [place for place, others in heirs.items() if not any(other in slots for other in others)]
    laws = [law for place in lost for law in (*heirs[place], *merged[place].laws)]
    return [law for law in dict.fromkeys(laws) if law not in slots]


def _moved(system: Semi, reduced: Reduced, slots: Mapping[str, SX]) -> int:
    """How many independent motions the residuals cause: the rank of d(dx)/dw."""
    rows = ca.vertcat(*(e.residual for e in system.equations))
    columns = [i for i, e in enumerate(system.equations) if e.slot and e.slot[0] in slots]
    for matrix in sample(reduced.flat, rows, ca.vertcat(*system.dx, *system.z)):
        dense = matrix.toarray()
        if np.linalg.matrix_rank(dense) == len(dense):
            effect = np.linalg.solve(dense, np.eye(len(dense))[:, columns])[: len(system.dx)]
            scaled = effect / np.maximum(np.abs(effect).max(axis=0, initial=0.0), 1e-300)
            return int(np.linalg.matrix_rank(scaled, tol=1e-9)) if scaled.size else 0
    return 0
