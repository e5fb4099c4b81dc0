"""A model: named components, connections, inputs and outputs. An immutable value; every edit returns a new model."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from types import MappingProxyType
from typing import Any

from .errors import ModelError, suggestion
from .language import Component, Connector, Parameter, Signal, SignalInput, SignalOutput, Variable, check_parameter, check_value

GROUNDS: dict[type[Connector], type[Component]] = {}

Onset = tuple[float, float] | tuple[float, float, float]  # see `Model`
Change = tuple[str, float] | tuple[str, float, float] | tuple[str, float, float, str]  # see `Model`


def ground_of(kind: type[Connector]) -> Callable[[type[Component]], type[Component]]:
    """Class decorator: this component (one connector) is what an element at a one-port place is held against."""

    def register(component: type[Component]) -> type[Component]:
        GROUNDS[kind] = component
        return component

    return register


@dataclass(frozen=True)
class Output:
    """A measured quantity: any declared variable by dotted name, and the default standard deviation of its noise (SI, None: unknown).

    Raises ModelError for a standard deviation that is not positive.
    """

    variable: str
    noise_std: float | None = None

    def __post_init__(self) -> None:
        std = self.noise_std
        if std is not None and (isinstance(std, bool) or not isinstance(std, Real) or not (math.isfinite(std) and std > 0)):
            raise ModelError(
                f"Output('{self.variable}', noise_std={std!r}): a standard deviation is a positive number; leave it out where it is unknown"
            )


@dataclass(frozen=True, kw_only=True)
class Model:
    """Components joined at their connectors.

    components   name -> component
    connections  pairs of connectors, ("carriage.flange", "screw.flange_b"), or of signals, ("lag.y", "motor.f")
    inputs       name -> the variable or signal input that it drives, {"F": "motor.f"}
    outputs      name -> the variable that is measured, {"x": "encoder.s"} or {"x": Output("encoder.s", noise_std=1e-6)}
    parameters   parameters of the model itself, {"P_1": Parameter("kg.m2", 0.108)}; a dotted name is allowed
    bindings     parameter of a component -> parameter of the model that it is, {"link_12.J": "P_1"}
    start        variable -> its value at the start, or a guess of it [SI], {"joint_3.phi": 1.2}
    states       coordinates that stay states where a closed loop leaves a choice, ("joint_1.phi", "joint_2.phi")
    residuals    places whose laws carry a residual force from the start, besides the balances of bodies
    onsets       parameter of a component -> (time [s] from which it has its value, what it is before), {"friction.f_c": (3.2, 0.0)}; and
                 from when on it is that again, if it ends
    changes      parameter of the model -> (parameter, of a component or shared, that it is added to, time [s] from which it is), {"fallen":
                 ("load.m", 4.0)}, and until when, if not to the end; of what changes little by little until when it has, and its rate

    Raises ModelError for an unknown component, connector, variable or parameter, and for a connection of different kinds or units.
    """

    name: str
    components: Mapping[str, Component]
    connections: Sequence[tuple[str, str]] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)
    outputs: Mapping[str, str | Output] = field(default_factory=dict)
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    bindings: Mapping[str, str] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    states: Sequence[str] = ()
    residuals: Sequence[str] = ()
    onsets: Mapping[str, Onset] = field(default_factory=dict)
    changes: Mapping[str, Change] = field(default_factory=dict)
    description: str = ""

    def __post_init__(self) -> None:
        for name in ("components", "inputs", "outputs", "parameters", "bindings", "start", "onsets", "changes"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        for name, one in (("states", "name"), ("residuals", "place")):
            if isinstance(getattr(self, name), str):
                raise ModelError(
                    f"model '{self.name}': {name} = {getattr(self, name)!r} is a text, not a list; write [...] even for one {one}"
                )
        object.__setattr__(self, "connections", tuple(map(self._pair, self.connections)))
        object.__setattr__(self, "states", tuple(self.states))
        object.__setattr__(self, "residuals", tuple(self.residuals))
        object.__setattr__(self, "outputs", MappingProxyType(self.measured))
        self._check_components()
        for a, b in self.connections:
            self._check_connection(a, b)
        self._check_names()
        self._check_bindings()
        self._check_onsets()
        if self.changes:
            from .changes import check_changes

            check_changes(self)

    def _pair(self, connection: Sequence[str]) -> tuple[str, str]:
        if isinstance(connection, str) or len(connection) != 2:
            remedy = "connects two; of three or more write one pair each to the first"
            raise ModelError(f'model \'{self.name}\': {connection!r} is no connection, which {remedy}, ("a.flange", "b.flange")')
        a, b = connection
        return str(a), str(b)

    def __reduce__(self) -> tuple[Any, ...]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return _rebuild, ({name: dict(value) if isinstance(value, Mapping) else value for name, value in values.items()},)

    def __eq__(self, other: object) -> bool:
        """The same values in the same order: of the inputs and outputs, and of the components, whose order the states follow."""
        return isinstance(other, Model) and self._values() == other._values()

    def __hash__(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[Any, ...]:
        values = (getattr(self, f.name) for f in fields(self))
        return tuple(tuple(value.items()) if isinstance(value, Mapping) else value for value in values)

    def __repr__(self) -> str:
        parts = ", ".join(f"{name}={component!r}" for name, component in self.components.items())
        return f"Model({self.name}: {parts}; inputs {list(self.inputs)}, outputs {list(self.outputs)})"

    @property
    def measured(self) -> dict[str, Output]:
        """The outputs, each with its noise."""
        return {name: value if isinstance(value, Output) else Output(value) for name, value in self.outputs.items()}

    def describe(self) -> str:
        """Components, connections, equations with their origin, parameters, inputs, outputs and places as text."""
        from .analysis.describe import describe

        return describe(self)

    def component(self, name: str) -> Component:
        """The component of that name, or ModelError with the nearest one."""
        if name not in self.components:
            raise ModelError(f"model '{self.name}' has no component '{name}'; {suggestion(name, self.components)}")
        return self.components[name]

    def connector(self, path: str) -> Connector:
        """The connector at "carriage.flange", or ModelError with the nearest one."""
        end = self.end(path)
        if not isinstance(end, Connector):
            known = [f"{_owner(path)}.{port}" for port in self.component(_owner(path)).declared_connectors]
            raise ModelError(f"'{path}' is a {type(end).__name__}, not a connector; {suggestion(path, known)}")
        return end

    def end(self, path: str) -> Connector | Signal | Variable:
        """What a connection may end at: a connector, a signal or a variable; ModelError with the nearest one for anything else."""
        name, dot, word = path.partition(".")
        component = self.component(name)
        for declared in (component.declared_connectors, component.declared_signals, component.declared_variables):
            if dot and word in declared:
                found: Connector | Signal | Variable = declared[word]
                return found
        known = [f"{name}.{word}" for word in (*component.declared_connectors, *component.declared_signals)]
        raise ModelError(f"'{path}' is no connector of {type(component).__name__} '{name}'; {suggestion(path, known)}")

    def connect(self, a: str, b: str, *more: str) -> Model:
        """The model with these flanges (or signals) joined, all of them in one node."""
        return replace(self, connections=(*self.connections, *((a, other) for other in (b, *more))))

    def insert(self, place: str, component: Component, name: str | None = None) -> Model:
        """The model with `component` added at a place.

        A place with one flange of the component's kind ("carriage", or a flange by name, "screw.flange_a"): a component with one flange is
        joined to it, one with two stands between it and ground, which is added where the model has none. A place with two ("screw"): in
        parallel with it. "input:F" and "sensor:x": a block with one signal input and one output is put into the input or behind the output.
        """
        from .insertion import insert

        return insert(self, place, component, name)

    def replace(self, name: str, component: Component) -> Model:
        """The model with the component `name` exchanged, its connections kept.

        What is said of parameters and variables that the new one lacks goes: bindings, start values, states. Raises ModelError for flanges,
        inputs and outputs that it lacks, and for a value of its own where the parameter is bound to one of the model.
        """
        from .insertion import exchange

        return exchange(self, name, component)

    def with_values(self, **values: float | Mapping[str, float]) -> Model:
        """The model with parameter values changed: `with_values(carriage={"m": 90.0})`, or the model's own: `with_values(P_1=0.1)`."""
        components, parameters = dict(self.components), dict(self.parameters)
        for name, value in values.items():
            if isinstance(value, Mapping):
                self._refuse_bound(name, value)
                components[name] = self.component(name).with_values(**value)
            elif name in parameters:
                check_value(f"with_values({name}={value!r})", value, parameters[name])
                parameters[name] = replace(parameters[name], default=float(value))
            else:
                raise ModelError(
                    f"with_values({name}={value!r}): model '{self.name}' has no parameter '{name}' of its own; "
                    + suggestion(name, parameters)
                )
        return replace(self, components=components, parameters=parameters)

    def since(self, path: str, time: float, before: float = 0.0, *, until: float | None = None) -> Model:
        """The model with a parameter of a component that has its value from a time [s] on, and `before` that: friction that sets in.

        until: from then on [s] it is as before. Times are those of the simulation, or of the recording as they stand in its time column.
        Raises ModelError for a parameter that no component declares and for what is no finite number.
        """
        return replace(self, onsets={**self.onsets, path: (time, before) if until is None else (time, before, until)})

    def changing(
        self, path: str, time: float, name: str, by: float = 0.0, *, until: float | None = None, rate: float | None = None
    ) -> Model:
        """The model with a parameter that is another one from a time [s] on: larger by `name`, a new one of the model. A load that falls.

        path: of a component, or of one of the model that several share. by: the value of `name`, in the unit of that parameter. until: from
        then on [s] it is as before, a load that is put down again. With a rate [1/s], too, it changes little by little, as what warms up
        does, and is larger by `name` at that time: by the share

            (1 - exp(-rate (t - time))) / (1 - exp(-rate (until - time)))

        of it at t; with a rate of nothing that is a ramp. The rate is `{name}_rate`, another new parameter. Times are as of `since`. Raises
        ModelError as that does, for a name that is taken, and for what the parameter cannot be.
        """
        from .changes import changing

        return changing(self, path, time, name, by, until=until, rate=rate)

    def without(self, name: str) -> Model:
        """The model without the component `name` and its connections; grounds left with nothing to hold go with it.

        What a block with one signal input and one signal output was given, goes where its output went.
        """
        from .changes import changes_where
        from .insertion import bridged, idle_grounds

        bridge = bridged(self, name)
        if bridge:
            return bridge.without(name)
        for what, signals in (("input", self.inputs), ("output", {k: v.variable for k, v in self.measured.items()})):
            for signal, variable in signals.items():
                if _owner(variable) == name:
                    raise ModelError(f"without('{name}'): {what} '{signal}' is its variable '{variable}'; point the {what} elsewhere first")
        kept = tuple((a, b) for a, b in self.connections if name not in (_owner(a), _owner(b)))
        gone = {name, *idle_grounds(self, kept)}

        def stays(path: str) -> bool:
            return _owner(path) not in gone

        return replace(
            self,
            components={n: c for n, c in self.components.items() if n not in gone},
            connections=kept,
            bindings={path: to for path, to in self.bindings.items() if stays(path)},
            start={path: value for path, value in self.start.items() if stays(path)},
            states=tuple(path for path in self.states if stays(path)),
            residuals=tuple(path for path in self.residuals if stays(path)),
            onsets={path: onset for path, onset in self.onsets.items() if stays(path)},
            **changes_where(self, stays),
        )

    # --- checks

    def _refuse_bound(self, name: str, values: Mapping[str, float]) -> None:
        """Values of parameters that are bound to one of the model would have no effect."""
        for word, value in values.items():
            to = self.bindings.get(f"{name}.{word}")
            if to is not None:
                there = f"{to}=..." if to.isidentifier() else f'**{{"{to}": ...}}'
                raise ModelError(f"with_values({name}={{'{word}': {value!r}}}): {name}.{word} is bound to {to}; use with_values({there})")

    def _check_components(self) -> None:
        for name, component in self.components.items():
            if not re.fullmatch(r"[A-Za-z_]\w*", name):
                raise ModelError(f"model '{self.name}': component name {name!r} must be a word of letters, digits and underscores")
            if not isinstance(component, Component):
                hint = f"; write {component.__name__}(...)" if isinstance(component, type) else ""
                raise ModelError(f"model '{self.name}': component '{name}' is {component!r}, which is no component{hint}")

    def _check_connection(self, a: str, b: str) -> None:
        if a == b:
            raise ModelError(f"connection {a} = {b}: a flange cannot be joined to itself; name two flanges")
        ends = self.end(a), self.end(b)
        if any(isinstance(end, Connector) for end in ends):
            if type(ends[0]) is not type(ends[1]):
                raise ModelError(
                    f"connection {a} = {b}: a {_kind(ends[0])} cannot be joined to a {_kind(ends[1])}; "
                    "put a component between them that has both (a rack, gear, motor or sensor), or name others"
                )
            return
        if not any(isinstance(end, Signal) for end in ends):
            raise ModelError(f"connection {a} = {b}: two plain variables cannot be joined; name connectors or signals")
        units = [end.unit for end in ends if isinstance(end, Signal | Variable)]
        if all(units) and units[0] != units[1]:
            raise ModelError(f"connection {a} [{units[0]}] = {b} [{units[1]}]: the units differ; put a gain between them, or name others")

    def _check_names(self) -> None:
        for what, variables in (
            ("input", self.inputs),
            ("output", {k: v.variable for k, v in self.measured.items()}),
            ("start", {name: name for name in self.start}),
            ("state", {name: name for name in self.states}),
        ):
            for name, variable in variables.items():
                self._check_variable(what, name, variable)
        for name, value in self.start.items():
            if not is_number(value):
                raise ModelError(f"start '{name}' = {value!r}: a finite number is needed")
        driven = list(self.inputs.values())
        for name, variable in self.inputs.items():
            if driven.count(variable) > 1:
                raise ModelError(f"input '{name}': '{variable}' is driven by more than one input; keep one")
            if isinstance(self.component(_owner(variable)).declared_signals.get(variable.partition(".")[2]), SignalOutput):
                raise ModelError(f"input '{name}': '{variable}' is a signal output, which its component drives; name a signal input")

    def _check_bindings(self) -> None:
        for name, parameter in self.parameters.items():
            check_parameter(f"parameter '{name}' of model '{self.name}': Parameter", parameter)
            owner, _, word = name.partition(".")
            if owner in self.components and word in self.components[owner].declared_parameters:
                raise ModelError(f"parameter '{name}' of model '{self.name}' has the name of a parameter of component '{owner}'; rename it")
            if not all(re.fullmatch(r"[A-Za-z_]\w*", part) for part in name.split(".")):
                raise ModelError(f"model '{self.name}': parameter name {name!r} must be words of letters, digits and underscores")
        for path, to in self.bindings.items():
            declared = self.declared("binding", path)
            if to not in self.parameters:
                raise ModelError(
                    f"binding '{path}' = '{to}': model '{self.name}' has no parameter '{to}'; {suggestion(to, self.parameters)}"
                )
            if declared.unit != self.parameters[to].unit:
                raise ModelError(f"binding '{path}' [{declared.unit}] = '{to}' [{self.parameters[to].unit}]: the units differ")
            check_value(f"parameter '{to}' of model '{self.name}', which is {path}", self.parameters[to].default, declared)

    def _check_onsets(self) -> None:
        for path, onset in self.onsets.items():
            self.declared("onset", path)
            if not (isinstance(onset, tuple) and len(onset) in (2, 3) and all(is_number(value) for value in onset)):
                ends = "and, of what ends, the time from which on it is that again"
                raise ModelError(
                    f"onset '{path}' = {onset!r}: a pair of finite numbers is needed, the time [s] and the value before it, {ends}"
                )
            if len(onset) == 3 and not onset[2] > onset[0]:
                raise ModelError(f"onset '{path}' = {onset!r}: it has its value from one time [s] until a later one")

    def declared(self, what: str, path: str) -> Parameter:
        """The parameter of a component that is `what` of the model, an onset or a change; ModelError with the nearest one."""
        owner, _, word = path.partition(".")
        declared = self.component(owner).declared_parameters
        if word not in declared:
            kind = type(self.components[owner]).__name__
            raise ModelError(f"{what} '{path}': {kind} '{owner}' has no parameter '{word}'; {suggestion(word, declared)}")
        return declared[word]

    def _check_variable(self, what: str, name: str, variable: str) -> None:
        owner, _, rest = variable.partition(".")
        component = self.component(owner)
        known = [f"{owner}.{v}" for v in (*component.declared_variables, *component.declared_signals)]
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


def _kind(end: Connector | Signal | Variable) -> str:
    if isinstance(end, Connector):
        return f"{type(end).__name__} flange"
    return "signal input" if isinstance(end, SignalInput) else "signal output" if isinstance(end, SignalOutput) else "variable"


def is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _owner(path: str) -> str:
    return path.partition(".")[0]


def _rebuild(values: dict[str, Any]) -> Model:
    return Model(**values)
