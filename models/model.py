"""A model: named components, connections, inputs and outputs. An immutable value; every edit returns a new model."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from .errors import ModelError, suggestion
from .language import Component, Connector

_GROUNDS: dict[type[Connector], type[Component]] = {}


def ground_of(kind: type[Connector]) -> Callable[[type[Component]], type[Component]]:
    """Class decorator: this component (one connector) is what an element at a one-port place is held against."""

    def register(component: type[Component]) -> type[Component]:
        _GROUNDS[kind] = component
        return component

    return register


@dataclass(frozen=True)
class Output:
    """A measured quantity: any declared variable by dotted name, and the default standard deviation of its noise (SI, None: unknown)."""

    variable: str
    noise_std: float | None = None


@dataclass(frozen=True, kw_only=True)
class Model:
    """Components joined at their connectors.

    components   name -> component
    connections  pairs of connectors, ("carriage.flange", "screw.flange_b")
    inputs       name -> the variable that it drives, {"F": "motor.f"}
    outputs      name -> the variable that is measured, {"x": "encoder.s"} or {"x": Output("encoder.s", noise_std=1e-6)}

    Raises ModelError for an unknown component, connector or variable, and for a connection of different kinds.
    """

    name: str
    components: Mapping[str, Component]
    connections: Sequence[tuple[str, str]] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)
    outputs: Mapping[str, str | Output] = field(default_factory=dict)
    description: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", MappingProxyType(dict(self.components)))
        object.__setattr__(self, "connections", tuple((str(a), str(b)) for a, b in self.connections))
        object.__setattr__(self, "inputs", MappingProxyType(dict(self.inputs)))
        object.__setattr__(self, "outputs", MappingProxyType(dict(self.outputs)))
        object.__setattr__(self, "outputs", MappingProxyType(self.measured))
        for name, component in self.components.items():
            if not re.fullmatch(r"[A-Za-z_]\w*", name):
                raise ModelError(f"model '{self.name}': component name {name!r} must be a word of letters, digits and underscores")
            if not isinstance(component, Component):
                hint = f"; write {component.__name__}(...)" if isinstance(component, type) else ""
                raise ModelError(f"model '{self.name}': component '{name}' is {component!r}, which is no component{hint}")
        for a, b in self.connections:
            kind_a, kind_b = self.connector(a), self.connector(b)
            if type(kind_a) is not type(kind_b):
                raise ModelError(
                    f"connection {a} = {b}: a {type(kind_a).__name__} flange cannot be joined to a {type(kind_b).__name__} "
                    "one; put a rack or gear between them, or name other flanges"
                )
            if a == b:
                raise ModelError(f"connection {a} = {b}: a flange cannot be joined to itself; name two flanges")
        for what, variables in (("input", self.inputs), ("output", {k: v.variable for k, v in self.measured.items()})):
            for name, variable in variables.items():
                self._check_variable(what, name, variable)
        driven = list(self.inputs.values())
        for name, variable in self.inputs.items():
            if driven.count(variable) > 1:
                raise ModelError(f"input '{name}': '{variable}' is driven by more than one input; keep one")

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (
            {
                "name": self.name,
                "components": dict(self.components),
                "connections": self.connections,
                "inputs": dict(self.inputs),
                "outputs": dict(self.outputs),
                "description": self.description,
            },
        )

    def __hash__(self) -> int:
        return hash((self.name, tuple(self.components.items()), self.connections, tuple(self.inputs.items()), tuple(self.outputs.items())))

    def __repr__(self) -> str:
        parts = ", ".join(f"{name}={component!r}" for name, component in self.components.items())
        return f"Model({self.name}: {parts}; inputs {list(self.inputs)}, outputs {list(self.outputs)})"

    @property
    def measured(self) -> dict[str, Output]:
        """The outputs, each with its noise."""
        return {name: value if isinstance(value, Output) else Output(value) for name, value in self.outputs.items()}

    def describe(self) -> str:
        """Components, connections, equations with their origin, parameters, inputs, outputs and places as text."""
        from .describe import describe

        return describe(self)

    def component(self, name: str) -> Component:
        """The component of that name, or ModelError with the nearest one."""
        if name not in self.components:
            raise ModelError(f"model '{self.name}' has no component '{name}'; {suggestion(name, self.components)}")
        return self.components[name]

    def connector(self, path: str) -> Connector:
        """The connector at "carriage.flange", or ModelError with the nearest one."""
        name, dot, port = path.partition(".")
        connectors = self.component(name).declared_connectors
        if not dot or port not in connectors:
            known = [f"{name}.{port}" for port in connectors]
            raise ModelError(f"'{path}' is no connector of {type(self.components[name]).__name__} '{name}'; {suggestion(path, known)}")
        return connectors[port]

    def connect(self, a: str, b: str, *more: str) -> Model:
        """The model with these flanges joined (all of them in one node)."""
        return replace(self, connections=(*self.connections, *((a, other) for other in (b, *more))))

    def insert(self, place: str, component: Component, name: str | None = None) -> Model:
        """The model with `component` added at a place.

        A place with one flange ("carriage", or a flange by name, "screw.flange_a"): a component with one flange is joined to it, one with
        two stands between it and ground, which is added where the model has none. A place with two flanges ("screw"): in parallel with it.
        """
        name = name or self._free_name(type(component).__name__.lower())
        if name in self.components:
            raise ModelError(f"insert at '{place}': the model already has a component '{name}'; choose another name or use replace()")
        ports = [place] if "." in place else [f"{place}.{port}" for port in self.component(place).declared_connectors]
        kind = type(self.connector(ports[0])) if ports else Connector
        own = [f"{name}.{port}" for port in component.declared_connectors]
        wrong = [type(c).__name__ for c in component.declared_connectors.values() if type(c) is not kind]
        if wrong:
            raise ModelError(
                f"insert at '{place}': {type(component).__name__} has a {wrong[0]} flange, the place is {kind.__name__}; "
                "choose the component for that kind"
            )
        grown = replace(self, components={**self.components, name: component})
        if len(ports) == len(own) == 1 or len(ports) == len(own) == 2:
            return replace(grown, connections=(*grown.connections, *zip(ports, own, strict=True)))
        if len(ports) == 1 and len(own) == 2:
            grown, ground = grown._ground(kind)
            return replace(grown, connections=(*grown.connections, (ports[0], own[0]), (own[1], ground)))
        options = " or ".join(f"'{port}'" for port in ports)
        raise ModelError(
            f"insert at '{place}': {type(component).__name__} has {len(own)} flange(s), the place has {len(ports)}; "
            + (f"name one flange: {options}" if ports else "choose a component with flanges")
        )

    def replace(self, name: str, component: Component) -> Model:
        """The model with the component `name` exchanged, connections kept."""
        self.component(name)
        return replace(self, components={**self.components, name: component})

    def with_values(self, **values: Mapping[str, float]) -> Model:
        """The model with parameter values changed: `model.with_values(carriage={"m": 90.0})`."""
        changed = {name: self.component(name).with_values(**own) for name, own in values.items()}
        return replace(self, components={**self.components, **changed})

    def without(self, name: str) -> Model:
        """The model without the component `name` and its connections; grounds left with nothing to hold go with it."""
        self.component(name)
        for what, signals in (("input", self.inputs), ("output", {k: v.variable for k, v in self.measured.items()})):
            for signal, variable in signals.items():
                if variable.startswith(f"{name}."):
                    raise ModelError(f"without('{name}'): {what} '{signal}' is its variable '{variable}'; point the {what} elsewhere first")
        kept = tuple((a, b) for a, b in self.connections if name not in (_owner(a), _owner(b)))
        held, holding = {_owner(end) for pair in self.connections for end in pair}, {_owner(end) for pair in kept for end in pair}
        grounds = tuple(_GROUNDS.values())
        idle = {n for n, c in self.components.items() if isinstance(c, grounds) and n in held and n not in holding}
        return replace(self, components={n: c for n, c in self.components.items() if n != name and n not in idle}, connections=kept)

    def _ground(self, kind: type[Connector]) -> tuple[Model, str]:
        if kind not in _GROUNDS:
            raise ModelError(f"there is no ground for {kind.__name__} flanges; connect the second flange yourself")
        ground = _GROUNDS[kind]
        name = next((n for n, c in self.components.items() if isinstance(c, ground)), None)
        model = self
        if name is None:
            name = self._free_name("ground")
            model = replace(self, components={**self.components, name: ground()})
        return model, f"{name}.{next(iter(ground.declared_connectors))}"

    def _free_name(self, stem: str) -> str:
        taken = set(self.components)
        return next(name for name in _numbered(stem) if name not in taken)

    def _check_variable(self, what: str, name: str, variable: str) -> None:
        owner, _, rest = variable.partition(".")
        component = self.component(owner)
        known = [f"{owner}.{v}" for v in component.declared_variables]
        known += [
            f"{owner}.{port}.{word}"
            for port, connector in component.declared_connectors.items()
            for pair in connector.pairs
            for word in (pair.potential, pair.flow)
        ]
        if variable not in known:
            raise ModelError(
                f"{what} '{name}': {type(component).__name__} '{owner}' has no variable '{rest}'; {suggestion(variable, known)}"
            )


def _owner(path: str) -> str:
    return path.partition(".")[0]


def _numbered(stem: str) -> Iterable[str]:
    yield stem
    count = 2
    while True:
        yield f"{stem}_{count}"
        count += 1


def _rebuild(values: dict[str, Any]) -> Model:
    return Model(**values)
