"""Start values of variables that elimination has replaced: they become those of the variables that stand for them.

name = factor * other + offset      ->      start of other = (start of name - offset) / factor
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..dae import Dae
from ..errors import ModelError
from ..model import Model
from ..text import expression_text
from .flat import FlatModel

SX = Any
SAME = 1e-9  # relative difference of two start values that say the same


def carried_over(model: Model, flat: FlatModel, definitions: Mapping[str, SX], kept: Collection[str]) -> FlatModel:
    """The flat model with all start values at the variables in `kept`: states and algebraic variables.

    `Model.start` comes before declared start values, and of declared ones (other than zero) a variable's own before those of the variables
    it stands for, the first of them before the others. Raises ModelError for a value of `Model.start` that cannot be handed over (the
    variable depends on several others or on none, or is an input), and where two such values contradict each other.
    """
    numbers = {name: value for name, (_, value, _) in flat.parameters.items()}
    found = {name: (name, value) for name, value in model.start.items() if name in kept}
    for name, value in model.start.items():
        if name in kept:
            continue
        if name not in definitions:
            raise ModelError(f"start '{name}' = {value:g}: {_without_start(model, name)}")
        alias = _alias(ca.SX(definitions[name]), numbers, kept)
        if not isinstance(alias, _Alias):
            raise ModelError(f"start '{name}' = {value:g}: {_why(model, name, definitions[name], alias, kept)}")
        handed = alias.value(value)
        other, given = found.setdefault(alias.name, (name, handed))
        if abs(given - handed) > SAME * max(1.0, abs(given)):
            raise ModelError(
                f"start '{name}' = {value:g} makes {alias.name} = {handed:g}, and start '{other}' makes it {given:g}; keep one of them"
            )
    starts = {name: value for name, (_, value) in found.items()}
    for name, variable in flat.variables.items():
        if variable.start and name in definitions and name not in model.start:
            alias = _alias(ca.SX(definitions[name]), numbers, kept)
            if isinstance(alias, _Alias) and not flat.variables[alias.name].start:
                starts.setdefault(alias.name, alias.value(variable.start))
    changed = {name: replace(flat.variables[name], start=value) for name, value in starts.items()}
    return replace(flat, variables={**flat.variables, **changed})


def of_states(dae: Dae, initial: Mapping[str, float], parameters: ArrayLike) -> dict[str, float]:
    """`initial` with values of eliminated variables as those of the states (or algebraics) that stand for them.

    Raises ModelError where two values contradict each other; names that stand for no single state are left as they are.
    """
    kept = {q.name for q in (*dae.states, *dae.algebraics)}
    numbers = dict(zip((q.name for q in dae.parameters), np.asarray(parameters).tolist(), strict=True))
    found = {name: value for name, value in initial.items() if name in kept}
    for name, value in initial.items():
        if name in kept:
            continue
        alias = _alias(ca.SX(dae.variables[name]), numbers, kept) if name in dae.variables else ()
        where, handed = (alias.name, alias.value(value)) if isinstance(alias, _Alias) else (name, value)
        given = found.setdefault(where, handed)
        if abs(given - handed) > SAME * max(1.0, abs(given)):
            raise ModelError(f"initial['{name}'] = {value:g} makes {where} = {handed:g}, and another makes it {given:g}; keep one of them")
    return found


@dataclass(frozen=True)
class _Alias:
    """A variable that is factor * name + offset."""

    name: str
    factor: float
    offset: float

    def value(self, own: float) -> float:
        return (own - self.offset) / self.factor


def _alias(expression: SX, numbers: Mapping[str, float], kept: Collection[str]) -> _Alias | tuple[str, ...]:
    """What an expression is an alias of; otherwise the names of the symbols, besides parameters, that it depends on."""
    symbols = {s.name(): s for s in ca.symvar(expression)}
    variables = tuple(name for name in symbols if name not in numbers)
    if len(variables) != 1 or variables[0] not in kept:
        return variables
    own = symbols[variables[0]]
    slope = ca.jacobian(expression, own)
    if ca.depends_on(slope, own):
        return variables
    parameters = [s for name, s in symbols.items() if name in numbers]
    at = ca.Function("at", [ca.vertcat(*parameters)], [ca.substitute(expression, own, 0), slope])
    offset, factor = (float(e) for e in at([numbers[s.name()] for s in parameters]))
    return _Alias(variables[0], factor, offset) if factor and np.isfinite([offset, factor]).all() else ()


def _without_start(model: Model, name: str) -> str:
    """Why a variable that was neither kept nor replaced has no start value, and what to do."""
    driven = next((signal for signal, variable in model.inputs.items() if variable == name), None)
    if driven is not None:
        return f"it is the input '{driven}', whose values are given from the first sample on; leave it out"
    return "nothing depends on this coordinate, only on its rate; leave it out, or measure it as an output to keep it"


def _why(model: Model, name: str, definition: SX, depends: tuple[str, ...], kept: Collection[str]) -> str:
    """Why the start value of an eliminated variable cannot be handed over, and what to do."""
    text = f"{name} = {expression_text(ca.SX(definition))}"
    free = [other for other in depends if other in kept]
    if free:
        return f"'{name}' follows from {', '.join(depends)} ({text}); give start values of {', '.join(free)} instead"
    if depends:
        keep = "" if set(depends) & set(model.inputs.values()) else ", or measure it as an output to keep it"
        return f"'{name}' follows from {', '.join(depends)} ({text}), without a start value; leave it out{keep}"
    return f"with the parameter values in force no state tells '{name}' ({text}); leave it out"
