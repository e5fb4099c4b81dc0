"""Signals between components: every input has one source, and what is connected has one unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import casadi as ca

from ..errors import ModelError
from ..language import Component, Connector, Parameter, SignalInput, SignalOutput, Variable
from ..model import Model
from .flat import FlatEquation, FlatVariable, connection_sets

SX = Any


def signal_units(model: Model) -> dict[str, str]:
    """Units of all signals: a blank one is that of the node, and through a block with blank units only, that of its other side."""
    units = {f"{n}.{w}": s.unit for n, c in model.components.items() for w, s in c.declared_signals.items()}
    groups = [{path: model.end(path) for path in members} for members in connection_sets(model)]
    through = [[f"{n}.{w}" for w in c.declared_signals] for n, c in model.components.items() if not c.converts_units]
    alike = [list(group) for group in groups if not any(isinstance(end, Connector) for end in group.values())]
    alike += [paths for paths in through if not any(units[path] for path in paths)]
    fixed = {path: end.unit for group in groups for path, end in group.items() if isinstance(end, Variable)}
    while True:
        before = dict(units)
        for paths in alike:
            known = {u for path in paths if (u := units.get(path) or fixed.get(path))}
            if len(known) > 1:
                seen = ", ".join(f"{path} [{units.get(path) or fixed.get(path) or '?'}]" for path in paths)
                raise ModelError(f"connection of signals: the units of {seen} differ; put a gain between them, or connect others")
            for path in paths:
                if known and path in units:
                    units[path] = next(iter(known))
        if units == before:
            return units


def common_unit(name: str, component: Component, units: Mapping[str, str]) -> str:
    """The unit of all signals of a block, "" where they differ or the component has flanges."""
    own = {units[f"{name}.{word}"] for word in component.declared_signals}
    return own.pop() if len(own) == 1 and not component.converts_units and not component.declared_connectors else ""


def in_units(name: str, component: Component, parameter: Parameter, units: Mapping[str, str]) -> Parameter:
    """A parameter of a block with its unit: a blank one is that of the signals, and one that begins with "/" is theirs over the rest."""
    if parameter.unit and not parameter.unit.startswith("/"):
        return parameter
    return replace(parameter, unit=common_unit(name, component, units) + parameter.unit)


def law_unit(name: str, component: Component, left: SX, variables: Mapping[str, FlatVariable]) -> str:
    """The unit of a block's law: that of its left side where this is a variable or its derivative, else that of the signals."""
    left = ca.SX(left)
    symbol = left.name() if left.is_symbolic() else ""
    of = symbol.removeprefix("der(").removesuffix(")")
    if of in variables:
        unit = variables[of].unit
        return f"{unit}/s" if unit and of != symbol else unit
    return common_unit(name, component, {path: v.unit for path, v in variables.items()})


def signal_equations(model: Model, symbols: Mapping[str, SX], sets: list[list[str]]) -> Iterator[FlatEquation]:
    """Every signal input has one source: a signal output, a variable, or an input of the model."""
    driven = set(model.inputs.values())
    sourced = set(driven)
    for members in sets:
        ends = [model.end(path) for path in members]
        if isinstance(ends[0], Connector):
            continue
        told = [path for path, end in zip(members, ends, strict=True) if isinstance(end, SignalInput)]
        sources = [path for path in members if path not in told or path in driven]
        outputs = [path for path, end in zip(members, ends, strict=True) if isinstance(end, SignalOutput)]
        if len(outputs) + len(driven & set(members)) > 1:
            names = ", ".join(dict.fromkeys([*outputs, *(path for path in members if path in driven)]))
            raise ModelError(f"connection {' = '.join(members)}: driven by more than one source ({names}); keep one")
        if sources:
            sourced |= set(told)
        for other in members[1:]:
            residual = symbols[other] - symbols[members[0]]
            yield FlatEquation(residual=residual, component="", kind="equal", name=f"connection {members[0]} = {other}")
    for name, component in model.components.items():
        for word, signal in component.declared_signals.items():
            if isinstance(signal, SignalInput) and f"{name}.{word}" not in sourced:
                raise ModelError(
                    f"{type(component).__name__} '{name}': nothing drives its signal input '{word}'; connect '{name}.{word}' to a signal "
                    f'output, or name it as an input of the model: inputs={{"{word}": "{name}.{word}"}}'
                )
