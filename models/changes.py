"""Parameters that are others later: from a time on, for a while, or little by little, as what warms up is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import casadi as ca

from .errors import ModelError, suggestion
from .language import Parameter, check_value
from .model import Change, Model, is_number

SX = Any  # casadi has no type stubs
NO_RATE = 1e-6  # of a rate times the time that it has: a rate of nothing is a ramp, not 0 / 0


def changing(model: Model, path: str, time: float, name: str, by: float, *, until: float | None, rate: float | None) -> Model:
    """The model with a parameter that is another one later; see `Model.changing`."""
    declared, rated = _declared(model, path), f"{name}_rate"
    for taken in (name, rated) if rate is not None else (name,):
        if taken in model.parameters:
            raise ModelError(
                f"changing('{path}', name='{name}'): model '{model.name}' has a parameter of the name {taken}; choose another one"
            )
    change: Change = (path, time) if until is None else (path, time, until) if rate is None else (path, time, until, rated)
    if until is None and rate is not None:
        raise ModelError(
            f"changing('{path}', rate={rate!r}): what changes at once has none; say with `until` when it is larger by all of it"
        )
    _check_times(name, change)
    value = _value(model, path)
    check_value(f"changing('{path}', by={by}), which makes {value + by:g} of it", value + by, declared)
    new = {name: Parameter(declared.unit, by, nominal=declared.size(value), description=f"by which {path} is larger later")}
    if until is not None and rate is not None:
        usual = 1.0 / (until - time)
        new[rated] = Parameter("1/s", rate, min=0.0, nominal=usual, description=f"with which {path} changes little by little")
    return replace(model, parameters={**model.parameters, **new}, changes={**model.changes, name: change})


def as_changed(model: Model, path: str, value: SX, time: SX, values: Mapping[str, SX]) -> SX:
    """A parameter, of a component or of the model, as it is at a time [s]. value: without its changes; values: of those of the model."""
    for name, change in model.changes.items():
        if change[0] == path:
            value = value + _course(change, values[name], time, values)
    return value


def acting(value: SX, before: SX, time: SX, since: float, until: float | None = None) -> SX:
    """What has a value from a time [s] on, or until another, and is else as before."""
    begun = ca.if_else(time >= since, value, before)
    return begun if until is None else ca.if_else(time >= until, before, begun)


def _course(change: Change, by: SX, time: SX, values: Mapping[str, SX]) -> SX:
    """How a change goes."""
    since = change[1]
    if len(change) < 4:
        return acting(by, 0.0, time, *change[1:])
    span = change[2] - since
    rate = values[change[3]] * span + NO_RATE
    return by * ca.expm1(-rate * ca.if_else(time >= since, time - since, 0.0) / span) / ca.expm1(-rate)


def changes_where(model: Model, stays: Callable[[str], bool]) -> dict[str, Any]:
    """Of a model the changes of parameters that stay, as its own do; parameters of the model by which others changed go with them."""
    kept = {name: change for name, change in model.changes.items() if change[0] in model.parameters or stays(change[0])}
    gone = {*changes_by(model.changes)} - {*changes_by(kept)} - {*model.bindings.values()}
    return {"changes": kept, "parameters": {name: p for name, p in model.parameters.items() if name not in gone}}


def changes_by(changes: Mapping[str, Change]) -> list[str]:
    """The parameters of the model that say by how much others change, and at which rate."""
    return [word for name, change in changes.items() for word in (name, *change[3:])]


def check_changes(model: Model) -> None:
    """ModelError for a change of what nothing declares, by what the model has not, and for times that are none."""
    for name, change in model.changes.items():
        _check_times(name, change)
        declared = _declared(model, change[0])
        if change[0] in changes_by(model.changes):
            raise ModelError(f"change '{name}' of '{change[0]}', which is itself a change; let it change what that changes")
        for word, unit in zip(changes_by({name: change}), (declared.unit, "1/s"), strict=False):
            if word not in model.parameters:
                near = suggestion(word, model.parameters)
                raise ModelError(f"change '{name}' of '{change[0]}': model '{model.name}' has no parameter '{word}'; {near}")
            if (own := model.parameters[word].unit) != unit:
                raise ModelError(f"change '{name}' of '{change[0]}': '{word}' is in [{own}] and has to be in [{unit}]")


def _check_times(name: str, change: object) -> None:
    parts = change if isinstance(change, tuple) else ()
    numbers, names = parts[1:3], (*parts[:1], *parts[3:])
    if not (2 <= len(parts) <= 4 and all(map(is_number, numbers)) and all(isinstance(word, str) for word in names)):
        raise ModelError(
            f"change '{name}' = {change!r}: the name of a parameter and a finite time [s] are needed; of what changes back a later time, "
            "too, and of what changes little by little that and the name of its rate"
        )
    if len(numbers) == 2 and not numbers[1] > numbers[0]:
        raise ModelError(f"change '{name}' = {change!r}: it changes from one time [s] until a later one")


def _declared(model: Model, path: str) -> Parameter:
    """What changes: a parameter of a component, or one of the model."""
    return model.parameters[path] if path in model.parameters else model.declared("change", path)


def _value(model: Model, path: str) -> float:
    """What a parameter is: of a component, its own or that of the model which it is bound to, or one of the model."""
    owner, _, word = path.partition(".")
    shared = model.bindings.get(path, path)
    return model.parameters[shared].default if shared in model.parameters else model.component(owner).parameters[word]
