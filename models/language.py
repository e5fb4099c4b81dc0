"""The acausal language: a component declares connectors, parameters, variables and named equations.

    class Mass(Component):
        m = Parameter("kg", 1.0, min=0.0)
        s = Variable("m", state=True)
        v = Variable("m/s", state=True)
        flange = Translational()

        def equations(self, c):
            return {"position": equal(c.s, c.flange.s),
                    "velocity": equal(c.v, c.der(c.s)),
                    "force balance": balance(c.m * c.der(c.v), c.flange.f)}

`c` gives the symbols of one instance. Causal quantities (a drive's command, a sensor's reading, blocks between them) are signals:
`f = SignalInput("N")` is the symbol `c.f`. What all components see (gravity) is shared: `world = Shared(World)`.

An equation says whether it may carry a residual: a *balance* (a body) carries one from the start,
a *law* (an element) when it is asked for, an *equal* (geometry, kinematics) never.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, ClassVar, Literal, Self, overload

from .errors import ModelError, suggestion

Expression = Any  # a casadi SX scalar or a number


@dataclass(frozen=True)
class Parameter:
    """A number of a component: SI unit, default, inclusive bounds, typical size.

    smoothing: a width that rounds a corner. nonzero: of either sign but never 0, so that equations may be divided by it.
    """

    unit: str
    default: float
    min: float = -math.inf
    max: float = math.inf
    nominal: float | None = None
    description: str = ""
    smoothing: bool = False
    nonzero: bool = False

    def __set_name__(self, owner: type, name: str) -> None:
        self.__dict__.setdefault("_name", name)

    @overload
    def __get__(self, instance: None, owner: type) -> Parameter: ...
    @overload
    def __get__(self, instance: Component, owner: type) -> float: ...
    def __get__(self, instance: Component | None, owner: type) -> Parameter | float:
        return self if instance is None else instance.parameters[self.__dict__["_name"]]

    def size(self, value: float) -> float:
        """The nominal value: the one declared, else the size of the value in force or of the default, else 1."""
        return self.nominal if self.nominal is not None else abs(value) or abs(self.default) or 1.0


@dataclass(frozen=True)
class Variable:
    """A quantity that changes in time: SI unit, typical size, start value. `state=True` keeps its name when aliases are eliminated;
    `preferred=True` too, before other states: the coordinate of a joint before those of the bodies that it moves."""

    unit: str
    nominal: float = 1.0
    start: float = 0.0
    state: bool = False
    description: str = ""
    preferred: bool = False


@dataclass(frozen=True)
class Pair:
    """A potential and the flow that goes with it, by name and unit."""

    potential: str
    potential_unit: str
    flow: str
    flow_unit: str
    balance: str  # what the flow's sum is called: "force balance"


class Connector:
    """Where a component meets others: connected potentials are equal, flows sum to zero. Subclasses name their pairs.

    optional: it may stay unconnected, and then nothing flows there.
    """

    pairs: ClassVar[tuple[Pair, ...]] = ()

    def __init__(self, *, optional: bool = False) -> None:
        self.optional = optional


@dataclass(frozen=True)
class Signal:
    """A causal quantity: SI unit ("" = that of what it is connected to), typical size, start value."""

    unit: str = ""
    nominal: float = 1.0
    start: float = 0.0
    description: str = ""


class SignalInput(Signal):
    """What a component is told: driven by one SignalOutput or by an input of the model."""


class SignalOutput(Signal):
    """What a component tells: drives any number of SignalInputs, may be measured, may stay unconnected."""


@dataclass(frozen=True)
class Shared:
    """The one component of this kind in the model, seen by all others: `c.world.g` for `world = Shared(World)`."""

    kind: type[Component]


@dataclass(frozen=True)
class Equation:
    """left - right = 0; for a balance or a law also its place, "" is the component itself and "x" is <component>.x, and its unit: ""
    is unknown, None that of the component's flow."""

    left: Expression
    right: Expression
    kind: Literal["equal", "balance", "law"]
    place: str = ""
    unit: str | None = None


def equal(left: Expression, right: Expression) -> Equation:
    """left = right: geometry, kinematics, a definition. Never carries a residual."""
    return Equation(left, right, "equal")


def balance(inertia: Expression, *forces: Expression, place: str = "", unit: str | None = None) -> Equation:
    """inertia = sum(forces) + w: the balance of a body; w is the force that the model does not explain."""
    return Equation(inertia, sum(forces[1:], forces[0]) if forces else 0.0, "balance", place, unit)


def law(left: Expression, right: Expression, place: str = "", unit: str | None = None) -> Equation:
    """left = right + w: the law of an element; w is absent unless its place is switched on."""
    return Equation(left, right, "law", place, unit)


class Component:
    """Base of all components. An instance is an immutable set of parameter values: `Mass(m=2.0)`.

    Raises TypeError for an unknown parameter or a value that is no number, ModelError for one outside its bounds.
    """

    declared_parameters: ClassVar[Mapping[str, Parameter]] = {}
    declared_variables: ClassVar[Mapping[str, Variable]] = {}
    declared_connectors: ClassVar[Mapping[str, Connector]] = {}
    declared_signals: ClassVar[Mapping[str, Signal]] = {}
    declared_shared: ClassVar[Mapping[str, Shared]] = {}
    converts_units: ClassVar[bool] = False  # blank units of its signals may differ from each other
    parameters: Mapping[str, float]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        declared: dict[str, Any] = {}
        for base in reversed(cls.__mro__):
            declared.update({k: v for k, v in vars(base).items() if isinstance(v, _DECLARATIONS)})
        for name in declared:
            if name in ("der", "time", "at"):
                raise ModelError(f"{cls.__name__}: '{name}' is a word of the language; give the declaration another name")
            if isinstance(declared[name], Parameter):
                check_parameter(f"{cls.__name__}.{name} = Parameter", declared[name])
                first = declared[name].__dict__["_name"]
                if first != name:
                    raise ModelError(
                        f"{cls.__name__}.{name}: the same Parameter(...) is already called '{first}'; write Parameter(...) again"
                    )
        cls.declared_parameters = {k: v for k, v in declared.items() if isinstance(v, Parameter)}
        cls.declared_variables = {k: v for k, v in declared.items() if isinstance(v, Variable)}
        cls.declared_connectors = {k: v for k, v in declared.items() if isinstance(v, Connector)}
        cls.declared_signals = {k: v for k, v in declared.items() if isinstance(v, Signal)}
        cls.declared_shared = {k: v for k, v in declared.items() if isinstance(v, Shared)}

    def __init__(self, *unnamed: float, **values: float) -> None:
        kind = type(self).__name__
        if unnamed:
            named = next(iter(self.declared_parameters), "name")
            raise TypeError(f"{kind}({unnamed[0]!r}): parameters are given by name; write {kind}({named}={unnamed[0]!r})")
        for name, value in values.items():
            if name not in self.declared_parameters:
                raise TypeError(f"{kind} has no parameter '{name}' (= {value!r}); {suggestion(name, self.declared_parameters)}")
            check_value(f"{kind}({name}={value!r})", value, self.declared_parameters[name])
        chosen = {name: float(values.get(name, parameter.default)) for name, parameter in self.declared_parameters.items()}
        object.__setattr__(self, "parameters", _Values(chosen))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable; make a new one, e.g. {type(self).__name__}({name}={value!r})")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable; '{name}' cannot be deleted")

    def with_values(self, **values: float) -> Self:
        """The same component with some parameter values changed."""
        return type(self)(**{**self.parameters, **values})

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, Component) and dict(self.parameters) == dict(other.parameters)

    def __hash__(self) -> int:
        return hash((type(self), tuple(self.parameters.items())))

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:g}" for name, value in self.parameters.items())
        return f"{type(self).__name__}({values})"

    def equations(self, c: Any) -> dict[str, Equation]:  # noqa: ARG002
        """The named equations, written with the symbols `c`: `c.m`, `c.flange.s`, `c.der(c.s)`, `c.time`; none for mere parameters."""
        if self.declared_variables or self.declared_connectors or self.declared_signals:
            raise ModelError(f"{type(self).__name__} declares variables or connectors but no equations; write its equations(self, c)")
        return {}


_DECLARATIONS = (Parameter, Variable, Connector, Signal, Shared)


class _Values(Mapping[str, float]):
    """A read-only dictionary that can be pickled and hashed."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self._values = dict(values)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(self._values)


def check_parameter(where: str, parameter: Parameter) -> None:
    """Refuse a parameter whose default is no number or lies outside its own bounds."""
    check_value(f"{where}(default={parameter.default!r})", parameter.default, parameter)


def check_value(where: str, value: object, parameter: Parameter) -> None:
    """Refuse what is no finite number (TypeError, ModelError) or lies outside the bounds of the parameter (ModelError)."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{where}: a parameter value is a number [{parameter.unit}], not {type(value).__name__}")
    if not math.isfinite(value):
        raise ModelError(f"{where}: the value must be finite; give a number [{parameter.unit}]")
    if parameter.nonzero and value == 0:
        raise ModelError(f"{where}: the value must not be 0; give a number [{parameter.unit}] of either sign")
    if not parameter.min <= float(value) <= parameter.max:
        raise ModelError(f"{where}: the value must lie between {parameter.min:g} and {parameter.max:g} {parameter.unit}; change it")
