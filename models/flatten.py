"""Flattening: components and connections -> one list of equations in dotted names, each with its origin.

Connected potentials are equal, flows sum to zero. Before anything numeric, a matching of equations and variables (Dulmage-Mendelsohn) tells
whether the model can determine its variables at all; x and x' count as the same unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca

from .errors import ModelError, suggestion
from .language import Connector, Equation, Parameter, Variable
from .model import Model
from .structure import determination

SX = Any


@dataclass(frozen=True, kw_only=True)
class FlatVariable:
    """A declared variable (or connector variable, or auxiliary derivative) of the flat model; rank orders who survives an alias."""

    name: str
    unit: str
    rank: int  # 0 connector or auxiliary, 1 variable, 2 state of a body
    nominal: float = 1.0
    start: float = 0.0
    description: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatEquation:
    """residual = 0, where it came from, and what kind of slot it may carry. `slot` is None or (place, unit)."""

    residual: SX
    name: str
    component: str
    kind: Literal["equal", "balance", "law"]
    slot: tuple[str, str] | None = None

    @property
    def origin(self) -> str:
        return f"{self.name} of {self.component}" if self.component else self.name


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatModel:
    """Equations over symbols: `symbols[name]` and, where it occurs, `derivatives[name]`; inputs and parameters are known."""

    name: str
    variables: dict[str, FlatVariable]
    symbols: dict[str, SX]
    derivatives: dict[str, SX]
    parameters: dict[str, tuple[Parameter, float, SX]]
    time: SX
    equations: list[FlatEquation] = field(default_factory=list)


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


class _Table:
    """All symbols of a model while it is being flattened."""

    def __init__(self) -> None:
        self.variables: dict[str, FlatVariable] = {}
        self.symbols: dict[str, SX] = {}
        self.derivatives: dict[str, SX] = {}
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

    Raises ModelError for a flange that is not connected, and for a model with too many or too few equations (naming those at fault).
    """
    table = _Table()
    equations: list[FlatEquation] = []
    parameters: dict[str, tuple[Parameter, float, SX]] = {}
    for name, component in model.components.items():
        names: dict[str, Any] = {}
        for word, parameter in component.declared_parameters.items():
            symbol = ca.SX.sym(f"{name}.{word}")
            parameters[f"{name}.{word}"] = (parameter, component.parameters[word], symbol)
            names[word] = symbol
        for word, variable in component.declared_variables.items():
            names[word] = table.add(_flat(f"{name}.{word}", variable))
        for port, connector in component.declared_connectors.items():
            names[port] = Scope(table, f"{name}.{port}", dict(_connector_symbols(table, f"{name}.{port}", connector)))
        declared = component.equations(Scope(table, name, names))
        equations += _component_equations(name, component, declared)
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
    determination(flat, set(model.inputs.values()))
    return flat


def _flat(name: str, variable: Variable) -> FlatVariable:
    return FlatVariable(
        name=name,
        unit=variable.unit,
        rank=2 if variable.state else 1,
        nominal=variable.nominal,
        start=variable.start,
        description=variable.description,
    )


def _connector_symbols(table: _Table, path: str, connector: Connector) -> Iterator[tuple[str, SX]]:
    for pair in connector.pairs:
        for word, unit in ((pair.potential, pair.potential_unit), (pair.flow, pair.flow_unit)):
            yield word, table.add(FlatVariable(name=f"{path}.{word}", unit=unit, rank=0))


def _component_equations(name: str, component: Any, declared: object) -> Iterator[FlatEquation]:
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
        slot = None
        if equation.kind != "equal":
            place = f"{name}.{equation.place}" if equation.place else name
            if place in places:
                raise ModelError(f"{kind} '{name}': equation '{title}' is the second at place '{place}'; tell them apart by place=...")
            places.add(place)
            slot = (place, equation.unit or unit)
        yield FlatEquation(residual=residual, name=title, component=name, kind=equation.kind, slot=slot)


def connection_sets(model: Model) -> list[list[str]]:
    """The nodes of the model: lists of joined connectors, in order of declaration."""
    node: dict[str, list[str]] = {}
    for a, b in model.connections:
        left, right = node.setdefault(a, [a]), node.setdefault(b, [b])
        if left is not right:
            left += right
            node.update(dict.fromkeys(right, left))
    order = {path: i for i, path in enumerate(node)}
    unique = {id(members): sorted(members, key=order.__getitem__) for members in node.values()}
    return sorted(unique.values(), key=lambda members: order[members[0]])


def _connection_equations(model: Model, table: _Table) -> Iterator[FlatEquation]:
    sets = connection_sets(model)
    joined = {path for members in sets for path in members}
    for name, component in model.components.items():
        for port in component.declared_connectors:
            if f"{name}.{port}" not in joined:
                raise ModelError(
                    f"{type(component).__name__} '{name}': {port} is not connected; connect '{name}.{port}' to a flange or remove '{name}'"
                )
    for members in sets:
        for pair in model.connector(members[0]).pairs:
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
