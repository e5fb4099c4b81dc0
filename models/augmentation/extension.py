"""A Dae with symbols exchanged for new ones, and with further unknowns and rows after its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ..dae import Dae, EquationInfo, ParameterInfo, Place, Quantity

SX = Any


@dataclass(frozen=True, kw_only=True)
class State:
    """A further state: its symbol, that of its derivative, and what it is."""

    x: SX
    dx: SX
    quantity: Quantity


@dataclass(frozen=True, kw_only=True)
class Row:
    """A further row: residual = 0, and where it comes from."""

    residual: SX
    equation: EquationInfo


def new_state(quantity: Quantity) -> State:
    """A state with symbols of its own."""
    return State(x=ca.SX.sym(quantity.name), dx=ca.SX.sym(f"der({quantity.name})"), quantity=quantity)


def extended(
    dae: Dae,
    *,
    old: SX,
    new: SX,
    states: Sequence[State] = (),
    algebraics: Sequence[tuple[SX, Quantity]] = (),
    inputs: Sequence[tuple[SX, Quantity]] = (),
    parameters: Sequence[tuple[SX, ParameterInfo]] = (),
    rows: Sequence[Row] = (),
    places: Sequence[tuple[SX, Place]] = (),
    kinematics: Sequence[tuple[int, int, int]] = (),
) -> Dae:
    """The model with the symbols `old` replaced by `new` everywhere, then further quantities, rows and places, each kind in its order.

    kinematics: those of the further rows, added to the model's own. A declared variable follows; the new states are variables too.
    """
    names = list(dae.variables)
    parts = [dae.residual, dae.output, dae.invariants, *(dae.variables[name] for name in names)]
    residual, output, invariants, *variables = ca.substitute(parts, [old], [new]) if old.shape[0] else parts
    return replace(
        dae,
        x=ca.vertcat(dae.x, *(s.x for s in states)),
        dx=ca.vertcat(dae.dx, *(s.dx for s in states)),
        z=ca.vertcat(dae.z, *(z for z, _ in algebraics)),
        u=ca.vertcat(dae.u, *(u for u, _ in inputs)),
        p=ca.vertcat(dae.p, *(p for p, _ in parameters)),
        w=ca.vertcat(dae.w, *(w for w, _ in places)),
        states=(*dae.states, *(s.quantity for s in states)),
        algebraics=(*dae.algebraics, *(q for _, q in algebraics)),
        inputs=(*dae.inputs, *(q for _, q in inputs)),
        parameters=(*dae.parameters, *(info for _, info in parameters)),
        places=(*dae.places, *(place for _, place in places)),
        residual=ca.vertcat(residual, *(row.residual for row in rows)),
        equations=(*dae.equations, *(row.equation for row in rows)),
        output=output,
        invariants=invariants,
        kinematics=(*dae.kinematics, *kinematics),
        index=max(dae.index, 1) if algebraics else dae.index,
        variables=dict(zip(names, variables, strict=True)) | {s.quantity.name: s.x for s in states},
    )


def index_of(names: Sequence[str], name: str) -> int | None:
    """The place of a name in a list, None where it is not there."""
    return names.index(name) if name in names else None
