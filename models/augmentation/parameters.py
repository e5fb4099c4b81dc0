"""A parameter that is no single number: it drifts, p' = w, or it differs from case to case, p = sum_c p_c s_c.

The equations are those of the model with the parameter as it is now; that it changes enters nowhere else. So a parameter of a constraint
that index reduction has differentiated cannot drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from ..dae import Dae, EquationInfo, ParameterInfo, Place, Quantity
from ..errors import InputError, suggestion
from .extension import Row, extended, index_of, new_state


def drifting(dae: Dae, name: str) -> Dae:
    """The model with the parameter as the state `<name>`, driven by white noise at the place `parameter:<name>`.

    p' = w, a random walk: with std, the rate [unit/sqrt(s)], it moves by std sqrt(T) in a time T.

    Raises InputError for an unknown parameter, the width of a rounded corner, or a parameter of a differentiated constraint.
    """
    info, k = _parameter(dae, name, "drifting")
    held = [dae.invariants]
    if dae.index > 1:
        held += [dae.residual[r] for r, e in enumerate(dae.equations) if e.place is None and e.shaped is None]
    if any(ca.depends_on(rows, dae.p[k]) for rows in held if rows.shape[0]):
        raise InputError(
            f"drifting({name!r}): it stands in a constraint that was differentiated as if it were constant; "
            "let a parameter of a force or an inertia drift, or let it differ from case to case."
        )
    place, origin = f"parameter:{name}", f"{name}: random walk"
    p = new_state(Quantity(name=name, unit=info.unit, nominal=info.nominal, description=info.description, start=info.value))
    w = ca.SX.sym(f"w[{place}]")
    return extended(
        dae,
        old=dae.p[k],
        new=p.x,
        states=[p],
        rows=[
            Row(residual=p.dx - w, equation=EquationInfo(name="random walk", component=name, origin=origin, place=len(dae.places))),
        ],
        places=[(w, Place(name=place, unit=f"{info.unit}/s", kind="law", enabled=True, origin=origin))],
    )


def by_case(dae: Dae, name: str, cases: Sequence[str]) -> Dae:
    """The model with a parameter `<name> [<case>]` for every case in place of the one: a recording, a day, a machine.

    Inputs `case:<case>` are 1 in their case and 0 in the others; several parameters share them. In one case the model is what it was.

    Raises InputError for an unknown parameter, the width of a rounded corner, or without a case.
    """
    info, k = _parameter(dae, name, "by_case")
    if not cases or len(set(cases)) < len(cases):
        raise InputError(f"by_case({name!r}, cases={list(cases)}): needs at least one case, and each once.")
    there = {q.name: dae.u[i] for i, q in enumerate(dae.inputs)}
    switches = {case: there.get(f"case:{case}", ca.SX.sym(f"case:{case}")) for case in cases}
    values = {case: ca.SX.sym(case_name(name, case)) for case in cases}
    fresh = [case for case in cases if f"case:{case}" not in there]
    return extended(
        dae,
        old=dae.p[k],
        new=sum((values[case] * switches[case] for case in cases), ca.SX(0)),
        inputs=[(switches[case], Quantity(name=f"case:{case}", unit="1", description=f"1 in {case}, else 0")) for case in fresh],
        parameters=[(values[case], replace(info, name=case_name(name, case))) for case in cases],
    )


def case_name(name: str, case: str) -> str:
    """What a parameter is called in one case."""
    return f"{name} [{case}]"


def without_case(name: str) -> str:
    """What a parameter of one case, or of all of them, is called in all."""
    return name.partition(" [")[0]


def _parameter(dae: Dae, name: str, verb: str) -> tuple[ParameterInfo, int]:
    names = [p.name for p in dae.parameters]
    k = index_of(names, name)
    if k is None:
        raise InputError(f"{verb}({name!r}): {dae.name} has no such parameter; {suggestion(name, names)}")
    if name in [q.name for q in dae.states] or any(other.startswith(f"{name} [") for other in names):
        raise InputError(f"{verb}({name!r}): something stands for the parameter already; let it drift or differ, and once.")
    if dae.parameters[k].smoothing:
        raise InputError(f"{verb}({name!r}): a width that rounds a corner is no physics and stays one number.")
    return dae.parameters[k], k
