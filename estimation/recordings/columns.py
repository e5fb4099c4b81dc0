"""Columns of a file: what they hold, in which unit, how noisy and how late."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from backsight.models.errors import InputError, suggestion

from ..wording import number

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Loss = Literal["square", "huber", "auto"]
LOSSES = ("square", "huber", "auto")


@dataclass(frozen=True)
class InputColumn:
    """A column of a file and the unit its numbers are in (None: the SI unit of the model's signal).

    delay: "estimate": the inputs act late by an unknown time, the free parameter `delay:inputs`, all by the same
    limits: least and greatest value that the actuator can do, in the SI unit of the model's input; a command beyond acts as these
    """

    column: str
    unit: str | None = None
    delay: float | Literal["estimate"] = field(default=0.0, kw_only=True)
    limits: tuple[float, float] | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class OutputColumn(InputColumn):
    """A column that holds a measured output.

    std: standard deviation of its noise, in the SI unit of the model's output whatever the unit of the column (None: to be estimated)
    delay: seconds by which the sensor lags; the samples are moved back by it. "estimate": it is a free parameter, `delay:<output>`
    loss: "square": its noise is Gaussian; "huber": gross outliers count little; "auto": as the residuals' tails say
    """

    std: float | None = None
    unit: str | None = None
    delay: float | Literal["estimate"] = field(default=0.0, kw_only=True)
    loss: Loss = "square"


def sensor_columns(outputs: Mapping[str, str | OutputColumn], std: Mapping[str, float], label: str) -> dict[str, OutputColumn]:
    """The columns of outputs, with the deviations that are given beside them.

    Raises InputError for a deviation of what is no output, one that is given twice, or a column of another kind.
    """
    for name in std:
        if name not in outputs:
            raise InputError(f"{label}: std of {name!r}: no such output is read; {suggestion(name, outputs)}")
    found = {}
    for name, column in outputs.items():
        if not isinstance(column, (str, OutputColumn)):
            raise InputError(f"{label}: the column of output {name} is {column!r}; give its name, or OutputColumn(name, unit=..., std=...)")
        own = OutputColumn(column) if isinstance(column, str) else column
        if name in std and own.std is not None:
            raise InputError(f"{label}: std of {name} is given twice, {std[name]} and in its OutputColumn {own.std}; leave one out")
        found[name] = replace(own, std=std[name]) if name in std else own
    return found


def check_limits(limits: Mapping[str, tuple[float, float]], inputs: Iterable[str], label: str) -> None:
    """Raise InputError for limits of what is no input, or of which the least is not below the greatest."""
    known = list(inputs)
    for name, (least, greatest) in limits.items():
        if name not in known:
            raise InputError(f"{label}: limits of {name}, which is no input; there are {', '.join(known) or 'none'}")
        if not least < greatest:
            raise InputError(f"{label}: limits of input {name} are {number(least)} and {number(greatest)}; the least comes first")


def cut(values: Any, limits: tuple[float, float] | None) -> Any:
    """Values cut off at the limits; NaN stays."""
    return values if limits is None else np.clip(values, *limits)


def late_inputs(inputs: Mapping[str, InputColumn], label: str) -> tuple[str, ...]:
    """What `Recording.open_delays` says of the inputs: nothing, or that all act late. Raises InputError where only some do."""
    for name, column in inputs.items():
        if column.delay not in ("estimate", 0.0):
            raise InputError(
                f'{label}: delay of input {name} is {column.delay}; it can only be "estimate": give a known one to every output instead'
            )
    late = [name for name, column in inputs.items() if column.delay == "estimate"]
    if late and len(late) < len(inputs):
        punctual = next(name for name in inputs if name not in late)
        raise InputError(f'{label}: delay of input {late[0]} is "estimate", and that of {punctual} is not; all inputs act late, or none')
    return ("inputs",) if late else ()


def check_delay(delay: float | str, signal: str, t: Array, label: str) -> None:
    """Raise InputError unless a delay [s] fits into the recording, whose times are t (n,)."""
    if isinstance(delay, str) or not (np.isfinite(delay) and 0 <= delay < t[-1] - t[0]):
        length = f"shorter than the recording ({number(t[-1] - t[0])} s)"
        raise InputError(f'{label}: delay of output {signal} is {delay} s; it must be at least 0 and {length}, or "estimate"')
