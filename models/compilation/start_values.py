"""Start values of variables that elimination has replaced: they become those of the variables that stand for them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import casadi as ca

from ..errors import ModelError
from ..model import Model
from ..text import expression_text
from .flat import FlatModel

SX = Any


def carried_over(model: Model, flat: FlatModel, definitions: Mapping[str, SX], kept: Collection[str]) -> FlatModel:
    """The flat model with the start values of `Model.start` at the variables in `kept`: states and algebraic variables.

    A variable that was replaced by a multiple of one that is kept, plus a constant, hands its value on. Raises ModelError for one that
    depends on several, and where two values contradict each other.
    """
    numbers = {name: value for name, (_, value, _) in flat.parameters.items()}
    found = {name: (name, value) for name, value in model.start.items() if name in kept}
    for name, value in model.start.items():
        if name in kept or name not in definitions:
            continue
        expression = ca.SX(definitions[name])
        variables = [s for s in ca.symvar(expression) if s.name() not in numbers]
        slope = ca.jacobian(expression, variables[0]) if variables else ca.SX(0)
        others = [s for s in ca.symvar(slope) if s.name() not in numbers]
        if len(variables) != 1 or others or variables[0].name() not in kept:
            depends = ", ".join(s.name() for s in variables) or "parameters only"
            raise ModelError(
                f"start '{name}' = {value:g}: '{name}' follows from {depends} ({name} = {expression_text(expression)}); "
                "give start values of those instead"
            )
        parameters = [s for s in ca.symvar(expression) if s.name() in numbers]
        at = ca.Function("at", [ca.vertcat(*parameters)], [ca.substitute(expression, variables[0], 0), slope])
        offset, factor = (float(e) for e in at([numbers[s.name()] for s in parameters]))
        stands, handed = variables[0].name(), (value - offset) / factor
        other, given = found.setdefault(stands, (name, handed))
        if abs(given - handed) > 1e-9 * max(1.0, abs(given)):
            raise ModelError(
                f"start '{name}' = {value:g} makes {stands} = {handed:g}, and start '{other}' makes it {given:g}; keep one of them"
            )
    changed = {name: replace(flat.variables[name], start=value) for name, (_, value) in found.items()}
    return replace(flat, variables={**flat.variables, **changed})
