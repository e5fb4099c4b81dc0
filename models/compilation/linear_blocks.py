"""Algebraic variables that a few equations give linearly are solved for: velocities, accelerations and forces of a closed loop.

Algebraics are matched with equations, x and x' counting as known; the strong components of the matching are blocks that can be solved one
after the other (block triangular form: I. S. Duff, A. M. Erisman, J. K. Reid, Direct Methods for Sparse Matrices, 1986, ch. 6). A block

    A y + b = 0        A, b free of y, at most 4 by 4, A regular

is used up as y := -A^-1 b, by cofactors; a block that is larger or nonlinear (the angles of a loop) stays. Equations with a residual w stay
as well, but for balances of bodies that move with others: such a force of constraint is what their residual would add to, so w is dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from .eliminate import Heirs, Reduced
from .flat import FlatEquation, FlatModel
from .index_reduction import Semi
from .rows import steps
from .state_selection import regular
from .structure import incidence

SX = Any
LARGEST = 4


def solve_linear_blocks(flat: FlatModel, system: Semi, reduced: Reduced, slots: Mapping[str, SX]) -> tuple[Semi, Reduced]:
    """The system without the algebraics of its small linear blocks, which join the definitions. `slots` are the residuals w by place."""
    mate = _matching(system, slots)
    rows, z = list(system.equations), system.z
    definitions: dict[str, SX] = {}
    merged = dict(reduced.merged)
    used: set[int] = set()
    for block in _blocks(system, mate):
        y, own = ca.vertcat(*(z[j] for j in block)), [mate[j] for j in block]
        places = [place for i in own if (place := _place(rows[i], slots))]
        left = ca.vertcat(*(rows[i].residual for i in own))
        if places:
            left = ca.substitute(left, ca.vertcat(*(slots[place] for place in places)), ca.DM.zeros(len(places)))
        matrix = ca.jacobian(left, y)
        if len(block) > LARGEST or ca.depends_on(matrix, y) or steps(left) & {z[j].name() for j in block} or not regular(flat, matrix):
            continue
        value = -ca.mtimes(ca.inv_minor(ca.densify(matrix)), ca.substitute(left, y, ca.DM.zeros(len(block))))
        definitions |= dict(zip((z[j].name() for j in block), ca.vertsplit(value), strict=True))
        used.update(own)
        touched = [i for i, row in enumerate(rows) if i not in used and {*row.held} & {z[j].name() for j in block}]
        new = {place: Heirs(left=(rows[i].origin,)) for i in own if (place := _place(rows[i], slots))}
        merged = _passed_on(merged | new, [rows[i] for i in own], [rows[i] for i in touched])
        for i in touched:
            rows[i] = replace(rows[i], residual=ca.substitute(rows[i].residual, y, value))
    solved = [s for s in z if s.name() in definitions]
    old, new = ca.vertcat(*solved), ca.vertcat(*(definitions[s.name()] for s in solved))
    known = {name: ca.substitute(ca.SX(value), old, new) if solved else value for name, value in reduced.definitions.items()}
    known |= {name: value for name, value in definitions.items() if name in flat.variables}
    left_over = replace(
        system, z=[s for s in z if s.name() not in definitions], equations=[row for i, row in enumerate(rows) if i not in used]
    )
    return left_over, replace(reduced, definitions=known, merged=merged)


def _passed_on(merged: Mapping[str, Heirs], used: Sequence[FlatEquation], touched: Sequence[FlatEquation]) -> dict[str, Heirs]:
    """`merged` after the equations `used` went into those that were `touched`."""
    gone, new = {row.origin for row in used}, tuple(row.origin for row in touched)
    laws = tuple(row.slot[0] for row in used if row.slot and row.kind == "law")
    return {
        place: heirs
        if gone.isdisjoint(heirs.left)
        else Heirs(left=tuple(dict.fromkeys([*(o for o in heirs.left if o not in gone), *new])), laws=(*heirs.laws, *laws))
        for place, heirs in merged.items()
    }


def _matching(system: Semi, slots: Mapping[str, SX]) -> dict[int, int]:
    """Algebraic -> equation by augmenting paths, equations in order of preference: without x', with x', balances that are not needed."""
    rates = {dx.name() for dx in system.dx}
    owners = {x.name().partition(".")[0] for x in system.x}

    def preference(i: int) -> int | None:
        row = system.equations[i]
        if _place(row, slots):
            return 2 if row.kind == "balance" and row.component not in owners else None
        return 1 if rates.intersection(row.held) else 0

    ranked = [(rank, -i) for i in range(len(system.equations)) if (rank := preference(i)) is not None]
    present = incidence(system.equations, {s.name(): j for j, s in enumerate(system.z)}).toarray()
    mate: dict[int, int] = {}

    def augment(row: int, seen: set[int]) -> bool:
        for j in np.flatnonzero(present[row]).tolist():
            if j not in seen:
                seen.add(j)
                if j not in mate or augment(mate[j], seen):
                    mate[j] = row
                    return True
        return False

    for _, i in sorted(ranked):
        augment(-i, set())
    return mate


def _blocks(system: Semi, mate: dict[int, int]) -> list[list[int]]:
    """Strong components of the matched algebraics, each after those that it needs."""
    columns = sorted(mate)
    if not columns:
        return []
    present = incidence(system.equations, {s.name(): j for j, s in enumerate(system.z)}).toarray()
    needs = np.array([[present[mate[j], k] for k in columns] for j in columns])
    _, label = connected_components(csr_array(needs), directed=True, connection="strong")
    blocks = {int(c): [j for j, own in zip(columns, label, strict=True) if own == c] for c in np.unique(label)}
    order: list[list[int]] = []
    done: set[int] = set()

    def visit(c: int) -> None:
        if c in done:
            return
        done.add(c)
        for j in blocks[c]:
            for other in {int(label[k]) for k in np.flatnonzero(needs[columns.index(j)])}:
                visit(other)
        order.append(blocks[c])

    for c in sorted(blocks):
        visit(c)
    return order


def _place(row: FlatEquation, slots: Mapping[str, SX]) -> str:
    """The place whose residual the row carries, "" for none."""
    return row.slot[0] if row.slot and row.slot[0] in slots else ""
