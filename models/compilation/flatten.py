"""Flattening: components and connections -> one list of equations in dotted names, each with its origin.

Connected potentials are equal, flows sum to zero, a signal is what drives it. Before anything numeric, a matching of equations and
variables (Dulmage-Mendelsohn) tells whether the model can determine its variables at all; x and x' count as the same unknown.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca

from ..changes import acting, as_changed
from ..errors import ModelError, suggestion
from ..language import Component, Connector, Equation, Parameter, Signal, SignalOutput, Variable
from ..model import Model
from .flat import FlatEquation, FlatModel, FlatVariable, connection_sets
from .grounds import refuse_floating
from .refusals import declared_equations, is_finite, refuse_ambiguous
from .signal_flow import in_units, law_unit, signal_equations, signal_units
from .structure import determination

SX = Any


class Scope:
    """The symbols of one component, as its `equations` method sees them."""

    def __init__(self, table: _Table, prefix: str, names: Mapping[str, Any]) -> None:
        self._table, self._prefix, self._names = table, prefix, names

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._names:
            raise ModelError(f"'{self._prefix}' declares no '{name}'; {suggestion(name, self._names)}")
        return self._names[name]

    @property
    def time(self) -> SX:
        return self._table.time

    def der(self, expression: Any) -> SX:
        """Total time derivative of a variable or an expression."""
        return self._table.derivative(ca.SX(expression))

    def at(self, path: str) -> SX:
        """Any variable or parameter of the model by its dotted name: what the equations of an enclosing class may refer to."""
        known = self._table.symbols.get(path, self._table.parameters.get(path))
        if known is None:
            names = [*self._table.symbols, *self._table.parameters]
            raise ModelError(f"'{self._prefix}' refers to '{path}', which the model does not have; {suggestion(path, names)}")
        return known


class _Table:
    """All symbols of a model while it is being flattened."""

    def __init__(self) -> None:
        self.variables: dict[str, FlatVariable] = {}
        self.symbols: dict[str, SX] = {}
        self.derivatives: dict[str, SX] = {}
        self.parameters: dict[str, SX] = {}
        self.time = ca.SX.sym("time")
        self.auxiliary: list[FlatEquation] = []

    def add(self, variable: FlatVariable) -> SX:
        self.variables[variable.name] = variable
        self.symbols[variable.name] = ca.SX.sym(variable.name)
        return self.symbols[variable.name]

    def der_symbol(self, name: str) -> SX:
        if name not in self.derivatives:
            self.derivatives[name] = ca.SX.sym(f"der({name})")
        return self.derivatives[name]

    def derivative(self, expression: SX) -> SX:
        total = ca.SX(0)
        for symbol in ca.symvar(expression):
            name = symbol.name()
            rate = ca.SX(0)
            if name in self.variables:
                rate = self.der_symbol(name)
            elif name == "time":
                rate = ca.SX(1)
            elif name.startswith("der("):  # a second derivative: the first becomes a variable of its own
                inner = self.variables[name[4:-1]]
                own = f"{inner.name}'"
                if own not in self.variables:
                    definition = self.add(FlatVariable(name=own, unit=f"{inner.unit}/s", rank=0)) - symbol
                    self.auxiliary.append(FlatEquation(residual=definition, name="definition", component=own, kind="equal"))
                rate = self.der_symbol(own)
            total += ca.jacobian(expression, symbol) * rate
        return total


def flatten(model: Model) -> FlatModel:
    """The flat equations of a model.

    Raises ModelError for a flange that is not connected, a circuit without a ground, and a model with too many or too few equations (naming
    those at fault).
    """
    refuse_ambiguous(model)
    table = _Table()
    equations: list[FlatEquation] = []
    parameters, scopes = _symbols(model, table)
    for name, component in model.components.items():
        own = list(_component_equations(name, component, declared_equations(name, component, scopes[name]), table))
        _keep_states(name, component, own, table)
        equations += own
    equations += _connection_equations(model, table)
    flat = FlatModel(
        name=model.name,
        variables=table.variables,
        symbols=table.symbols,
        derivatives=table.derivatives,
        parameters=parameters,
        time=table.time,
        equations=[*equations, *table.auxiliary],
    )
    refuse_floating(model, flat)
    determination(flat, set(model.inputs.values()))
    return flat


def _symbols(model: Model, table: _Table) -> tuple[dict[str, tuple[Parameter, float, SX]], dict[str, Scope]]:
    """Parameters of the flat model, and what every component sees."""
    parameters = {name: (p, p.default, ca.SX.sym(name)) for name, p in model.parameters.items()}
    table.parameters.update({name: symbol for name, (_, _, symbol) in parameters.items()})
    units = signal_units(model)
    words: dict[str, dict[str, Any]] = {}
    for name, component in model.components.items():
        names = words[name] = {}
        for word, parameter in component.declared_parameters.items():
            path = f"{name}.{word}"
            if path not in model.bindings:
                parameters[path] = (in_units(name, component, parameter, units), component.parameters[word], ca.SX.sym(path))
            names[word] = table.parameters[path] = parameters[model.bindings.get(path, path)][2]
            if path in model.onsets:
                onset, before, *until = model.onsets[path]
                names[word] = acting(names[word], before, table.time, onset, *until)
            for changing in dict.fromkeys((path, model.bindings.get(path, path))):
                names[word] = as_changed(model, changing, names[word], table.time, table.parameters)
        for word, variable in component.declared_variables.items():
            rank = 3 if variable.preferred else 2 if variable.state else 1
            names[word] = table.add(_flat(model, f"{name}.{word}", variable, variable.unit, rank))
        for word, signal in component.declared_signals.items():
            path = f"{name}.{word}"
            names[word] = table.add(_flat(model, path, signal, units[path], 1 if isinstance(signal, SignalOutput) else 0))
        for port, connector in component.declared_connectors.items():
            names[port] = Scope(table, f"{name}.{port}", dict(_connector_symbols(model, table, f"{name}.{port}", connector)))
    scopes = {name: Scope(table, name, names) for name, names in words.items()}
    for name, component in model.components.items():
        for word, shared in component.declared_shared.items():
            words[name][word] = scopes[_shared(model, name, word, shared.kind)]
    return parameters, scopes


def _shared(model: Model, name: str, word: str, kind: type[Component]) -> str:
    """The one component of this kind."""
    found = [other for other, component in model.components.items() if isinstance(component, kind)]
    if len(found) != 1:
        seen = f"has {len(found)} ({', '.join(found)}); keep one" if found else f"has none; add one, e.g. {word}={kind.__name__}()"
        raise ModelError(f"{type(model.components[name]).__name__} '{name}' needs the model's {kind.__name__}, and '{model.name}' {seen}")
    return found[0]


def _flat(model: Model, name: str, declared: Variable | Signal, unit: str, rank: int) -> FlatVariable:
    start = model.start.get(name, declared.start)
    return FlatVariable(name=name, unit=unit, rank=rank, nominal=declared.nominal, start=start, description=declared.description)


def _connector_symbols(model: Model, table: _Table, path: str, connector: Connector) -> Iterator[tuple[str, SX]]:
    for pair in connector.pairs:
        for word, unit in ((pair.potential, pair.potential_unit), (pair.flow, pair.flow_unit)):
            name = f"{path}.{word}"
            yield word, table.add(FlatVariable(name=name, unit=unit, rank=0, start=model.start.get(name, 0.0)))


def _keep_states(name: str, component: Component, equations: list[FlatEquation], table: _Table) -> None:
    """Signal outputs that their component differentiates are states of it: they keep their names before what they drive."""
    held = {name for e in equations for name in e.held}
    for word, signal in component.declared_signals.items():
        path = f"{name}.{word}"
        if isinstance(signal, SignalOutput) and f"der({path})" in held:
            table.variables[path] = dataclasses.replace(table.variables[path], rank=2)


def _component_equations(name: str, component: Any, declared: object, table: _Table) -> Iterator[FlatEquation]:
    kind = type(component).__name__
    if not isinstance(declared, dict):
        raise ModelError(f"{kind} '{name}': equations() must return a dictionary of named equations, not {type(declared).__name__}")
    unit = next((p.flow_unit for c in component.declared_connectors.values() for p in c.pairs), "")
    places: set[str] = set()
    for title, equation in declared.items():
        if not isinstance(equation, Equation):
            raise ModelError(
                f"{kind} '{name}': equation '{title}' is a {type(equation).__name__}; write equal(...), balance(...) or law(...)"
            )
        residual = ca.SX(equation.left) - ca.SX(equation.right)
        if residual.shape != (1, 1):
            raise ModelError(f"{kind} '{name}': equation '{title}' has shape {residual.shape}; write one scalar equation per name")
        if not is_finite(residual):
            raise ModelError(
                f"{kind} '{name}': equation '{title}' holds a number that is not finite; use casadi's functions on symbols "
                "(from casadi import sin, sqrt), not those of math, and divide by nothing that is zero"
            )
        slot = None
        if equation.kind != "equal":
            place = f"{name}.{equation.place}" if equation.place else name
            if place in places:
                raise ModelError(f"{kind} '{name}': equation '{title}' is the second at place '{place}'; tell them apart by place=...")
            places.add(place)
            taken = unit or law_unit(name, component, equation.left, table.variables)
            slot = (place, taken if equation.unit is None else equation.unit)
        yield FlatEquation(residual=residual, name=title, component=name, kind=equation.kind, slot=slot)


def _connection_equations(model: Model, table: _Table) -> Iterator[FlatEquation]:
    sets = connection_sets(model)
    joined = {path for members in sets for path in members}
    for name, component in model.components.items():
        for port, connector in component.declared_connectors.items():
            if f"{name}.{port}" in joined:
                continue
            if not connector.optional:
                raise ModelError(
                    f"{type(component).__name__} '{name}': {port} is not connected; connect '{name}.{port}' to a flange or remove '{name}'"
                )
            for pair in connector.pairs:
                path = f"{name}.{port}.{pair.flow}"
                yield FlatEquation(residual=table.symbols[path], name=f"nothing flows at the open end {path}", component="", kind="equal")
    yield from signal_equations(model, table.symbols, sets)
    for members in sets:
        head_end = model.end(members[0])
        for pair in head_end.pairs if isinstance(head_end, Connector) else ():
            head = table.symbols[f"{members[0]}.{pair.potential}"]
            for other in members[1:]:
                yield FlatEquation(
                    residual=table.symbols[f"{other}.{pair.potential}"] - head,
                    component="",
                    kind="equal",
                    name=f"connection {members[0]} = {other} ({pair.potential})",
                )
            total = sum(table.symbols[f"{path}.{pair.flow}"] for path in members)
            yield FlatEquation(residual=total, name=f"{pair.balance} at the connection {' = '.join(members)}", component="", kind="equal")
