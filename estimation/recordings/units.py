"""Units of recorded columns: from what the file holds to the SI unit of the model's signal, by pint."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from backsight.models.errors import InputError

from ..wording import quoted

if TYPE_CHECKING:
    import pint

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def to_si(values: Array, unit: str, expected: str | None, *, where: str) -> Array:
    """`values` of a column in `unit`, in the model's unit `expected` (None: the SI base unit of the same quantity).

    `where` begins the message of the InputError that an unknown unit, or a unit of another quantity, raises.
    A frequency in Hz is refused where an angular velocity is wanted: to pint the turn is a pure number, and 1 Hz
    would become 1 rad/s without a word.
    """
    if unit == expected:
        return values
    import pint  # takes 0.3 s, and most recordings are in SI already

    try:
        given = _parse(unit)
    except (pint.PintError, ArithmeticError, AttributeError, AssertionError, LookupError, SyntaxError, TypeError, ValueError):
        raise InputError(f'{where}: the unit "{unit}" is not known; write it as in "mm", "deg/s" or "N*m"') from None
    target = _parse(expected) if expected is not None else _registry().Quantity(1, given).to_base_units().units
    if "hertz" in str(given) and "radian" in str(target):
        raise InputError(
            f'{where}: "{unit}" counts turns or radians? The model wants {expected}; write {quoted(["rev/s", "rad/s"])} instead'
        )
    try:
        return np.asarray(_registry().Quantity(values, given).to(target).magnitude, dtype=float)
    except pint.PintError:
        raise InputError(f'{where}: the unit "{unit}" cannot be converted to {expected}, the unit of the model\'s signal') from None


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[float]:
    import pint

    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    registry.define("@alias revolution = rev")
    return registry


def _parse(unit: str) -> pint.Unit:
    """pint's unit of its own notation, or of "N.m", "kg.m2", "rad/s2", "sqrt(N)"."""
    import pint

    if not unit.strip():
        raise ValueError("an empty unit")
    try:
        return _registry().Unit(unit)
    except (pint.PintError, AttributeError, TypeError, ValueError, SyntaxError):
        text = re.sub(r"sqrt\(([^()]+)\)", r"(\1)**0.5", unit.strip())
        text = re.sub(r"(?<=[A-Za-z0-9)])[.·](?=[A-Za-z(])", "*", text)
        text = re.sub(r"(?<=[A-Za-zµ])(-?\d+)(?!\w)", r"**\1", text)
        return _registry().Unit(text)
