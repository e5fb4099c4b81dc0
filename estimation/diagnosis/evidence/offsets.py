"""Residual forces with a mean of their own, where one that is left out would lead all else astray.

A body that turns freely in space shows no sensor its attitude. A torque that is left out there, however small, turns it on and on, and
every parameter goes to where that costs least: inertias to half, damping to a hundred times. So each balance of a seen rate has an offset
beside its residual force, which is no part of the model but a nuisance of the comparison: all models have it, and with one that does
without, evidence counts it out (`density_ratio.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae, ParameterInfo
from backsight.models.augmentation.extension import extended

from ...problem import Free, Problem
from ...results import Smoothing
from ...smoothing.softened import bare_rows
from ...smoothing.unseen import moving_unseen, unseen_states
from .density_ratio import more_probable_at

PREFIX = "offset of "
ACCELERATION = 10.0  # m/s2 or rad/s2, of a machine: sizes of offsets are that of what it takes


def with_offsets(problem: Problem) -> Problem:
    """The problem with offsets at the balances of the rates that turn an attitude which nobody sees; as it is where there is none."""
    plain = problem.plain.dae
    turned, unseen = set[int](), moving_unseen(problem.plain)
    for row in bare_rows(plain) if unseen_states(problem.plain) else []:
        turned |= set(ca.jacobian_sparsity(plain.residual[row], plain.x).get_col())
    names = [
        plain.places[e.place].name
        for row, e in enumerate(plain.equations)
        if e.place is not None and e.place not in unseen and turned & set(ca.jacobian_sparsity(plain.residual[row], plain.dx).get_col())
    ]
    if not names:
        return problem
    free = {PREFIX + name: Free(0.0) for name in names}
    return replace(problem, model=_offset(problem.dae, names), parameters={**problem.parameters, **free})


def with_those_of(problem: Problem, dae: Dae) -> Dae:
    """A model with the offsets that a problem has."""
    return _offset(dae, [p.name.removeprefix(PREFIX) for p in problem.dae.parameters if p.name.startswith(PREFIX)])


def offsets(result: Smoothing) -> list[str]:
    """Names of the offsets that a fit has found."""
    return [name for name, p in result.parameters.items() if name.startswith(PREFIX) and p.std is not None]


def counted_out(result: Smoothing, *, all_of_them: bool = False) -> tuple[float, tuple[str, ...]]:
    """By how much the evidence is larger without the offsets that are best left out, or without any [nats], and which stay."""
    names = offsets(result)
    if not names or result.criteria is None:
        return 0.0, ()
    best = -np.inf if all_of_them else 0.0, tuple(names)
    for size in range(len(names) if all_of_them else 1, len(names) + 1):
        for left_out in combinations(names, size):
            gained = more_probable_at(result, dict.fromkeys(left_out, 0.0))
            if gained > best[0]:
                best = gained, tuple(n for n in names if n not in left_out)
    return best


def _offset(dae: Dae, names: Sequence[str]) -> Dae:
    if not names:
        return dae
    order = [place.name for place in dae.places]
    more, parameters = ca.SX.zeros(len(order)), list[tuple[Any, ParameterInfo]]()
    for name in names:
        k, b = order.index(name), ca.SX.sym(PREFIX + name)
        row = next(r for r, e in enumerate(dae.equations) if e.place == k)
        size = ACCELERATION * float(ca.DM(ca.norm_1(_inertia(dae, row))))
        info = ParameterInfo(name=PREFIX + name, unit=dae.places[k].unit, value=0.0, minimum=-np.inf, maximum=np.inf, nominal=size)
        more[k] += b
        parameters.append((b, info))
    return extended(dae, old=dae.w, new=dae.w + more, parameters=parameters)


def _inertia(dae: Dae, row: int) -> Any:
    """What stands before the accelerations in a balance, at the model's own parameters and at rest."""
    slopes = ca.jacobian(dae.residual[row], dae.dx)
    for symbols, quantities in ((dae.x, dae.states), (dae.z, dae.algebraics)):
        slopes = ca.substitute(slopes, symbols, ca.DM([q.start for q in quantities]))
    slopes = ca.substitute(slopes, dae.p, ca.DM([p.value for p in dae.parameters]))
    rest = ca.vertcat(*ca.symvar(slopes))
    return ca.substitute(slopes, rest, ca.DM.zeros(rest.shape)) if rest.shape[0] else slopes


def without_idle(problem: Problem, result: Smoothing) -> Problem:
    """The problem without the offsets that evidence has counted out of its result."""
    _, stay = counted_out(result)
    idle = {name: 0.0 for name in problem.parameters if name.startswith(PREFIX) and name not in stay}
    return replace(problem, parameters={**problem.parameters, **idle})


def at_nothing(result: Smoothing) -> Smoothing:
    """The result with every offset zero."""
    found = {n: replace(p, value=0.0) if n.startswith(PREFIX) else p for n, p in result.parameters.items()}
    return replace(result, parameters=found)


def own_of(problem: Problem) -> dict[str, Free | float]:
    """What the problem says of the model's own parameters."""
    return {name: given for name, given in problem.parameters.items() if not name.startswith(PREFIX)}


def without_offsets(result: Smoothing) -> Smoothing:
    """The result as one of the model alone."""
    return replace(result, parameters={n: p for n, p in result.parameters.items() if not n.startswith(PREFIX)})
