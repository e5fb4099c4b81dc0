"""Parameters that are others later: all of the change from a time on, or little by little until a later one, as what warms up does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
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
    declared = _declared(model, path)
    for taken in (name, f"{name}_rate") if until is not None else (name,):
        if taken in model.parameters:
            raise ModelError(
                f"changing('{path}', name='{name}'): model '{model.name}' has a parameter of the name {taken}; choose another one"
            )
    if path in model.changes:
        raise ModelError(f"changing('{path}'): it changes at {model.changes[path][0]:g} s already, and what changes does so once")
    value = _value(model, path)
    check_value(f"changing('{path}', by={by}), which makes {value + by:g} of it", value + by, declared)
    new = {name: Parameter(declared.unit, by, nominal=declared.size(value), description=f"by which {path} is larger later")}
    if until is None:
        if rate is not None:
            raise ModelError(
                f"changing('{path}', rate={rate!r}): what changes at once has none; give `until` where it changes little by little"
            )
        return replace(model, parameters={**model.parameters, **new}, changes={**model.changes, path: (time, name)})
    change = (time, name, until, f"{name}_rate")
    _check_times(path, change)
    usual = 1.0 / (until - time)
    new[change[3]] = Parameter(
        "1/s", usual if rate is None else rate, min=0.0, nominal=usual, description=f"with which {path} changes little by little"
    )
    return replace(model, parameters={**model.parameters, **new}, changes={**model.changes, path: change})


def change_at(change: Change, time: SX, values: Mapping[str, SX]) -> SX:
    """What a parameter is larger by at a time [s]. values: of the parameters of the model."""
    since, by = change[0], values[change[1]]
    if len(change) == 2:
        return ca.if_else(time >= since, by, 0.0)
    span = change[2] - since
    rate = values[change[3]] * span + NO_RATE
    return by * ca.expm1(-rate * ca.if_else(time >= since, time - since, 0.0) / span) / ca.expm1(-rate)


def changes_where(model: Model, stays: Callable[[str], bool]) -> dict[str, Any]:
    """Of a model the changes of parameters that stay, as its own do; parameters of the model by which others changed go with them."""
    kept = {path: change for path, change in model.changes.items() if path in model.parameters or stays(path)}
    gone = {*_by(model.changes)} - {*_by(kept)} - {*model.bindings.values()}
    return {"changes": kept, "parameters": {name: p for name, p in model.parameters.items() if name not in gone}}


def check_changes(model: Model) -> None:
    """ModelError for a change of what no component declares, by what the model has not, and for times that are none."""
    for path, change in model.changes.items():
        declared = _declared(model, path)
        _check_times(path, change)
        for name, unit in zip(_by({path: change}), (declared.unit, "1/s"), strict=False):
            if name not in model.parameters:
                raise ModelError(
                    f"change '{path}' by '{name}': model '{model.name}' has no such parameter; {suggestion(name, model.parameters)}"
                )
            if (own := model.parameters[name].unit) != unit:
                raise ModelError(f"change '{path}' [{unit}] by '{name}' [{own}]: the units differ")


def _check_times(path: str, change: object) -> None:
    parts = change if isinstance(change, tuple) else ()
    numbers, names = parts[::2], parts[1::2]
    if len(parts) not in (2, 4) or not (all(map(is_number, numbers)) and all(isinstance(name, str) for name in names)):
        raise ModelError(
            f"change '{path}' = {change!r}: a finite time [s] and the name of a parameter of the model are needed; of what changes "
            "little by little a later time and the name of its rate, too"
        )
    if len(numbers) == 2 and not numbers[1] > numbers[0]:
        raise ModelError(f"change '{path}' = {change!r}: it changes from one time [s] until a later one")


def _by(changes: Mapping[str, Change]) -> Iterator[str]:
    """The parameters of the model that say how others change."""
    for change in changes.values():
        yield from (word for word in change if isinstance(word, str))


def _declared(model: Model, path: str) -> Parameter:
    """What changes: a parameter of a component, or one of the model."""
    return model.parameters[path] if path in model.parameters else model.declared("change", path)


def _value(model: Model, path: str) -> float:
    """What a parameter is: of a component, its own or that of the model which it is bound to, or one of the model."""
    owner, _, word = path.partition(".")
    shared = model.bindings.get(path, path)
    return model.parameters[shared].default if shared in model.parameters else model.component(owner).parameters[word]
