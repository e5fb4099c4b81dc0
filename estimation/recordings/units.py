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

OTHERS = {  # what columns of a signal with this SI unit are often in
    "m": ("mm", "um", "in"),
    "rad": ("mrad", "deg", "rev"),
    "s": ("ms", "us", "min", "h"),
    "m/s": ("mm/s", "m/min", "km/h"),
    "rad/s": ("deg/s", "rev/s", "rpm"),
    "m/s2": ("mm/s2", "g0"),
    "rad/s2": ("deg/s2", "rev/s2"),
    "N": ("mN", "kN", "kgf", "lbf"),
    "N.m": ("N.mm", "mN.m", "kN.m", "lbf.in"),
    "A": ("mA", "kA"),
    "V": ("mV", "kV"),
}
MEANT = {  # to pint a gram, a gauss, a number of yarns, enzyme units, or nothing
    "g": "g0",
    "G": "g0",
    "Nm": "N.m",
    "mNm": "mN.m",
    "kNm": "kN.m",
    "Ncm": "N.cm",
    "Nmm": "N.mm",
    "RPM": "rpm",
    "U/min": "rpm",
}


def to_si(values: Array, unit: str, expected: str | None, *, where: str) -> Array:
    """`values` of a column in `unit`, in the model's unit `expected` (None: the SI base unit of the same quantity).

    `where` begins the message of the InputError that an unknown unit, or a unit of another quantity, raises.
    Where an angle is wanted, what counts is refused: to pint the turn is a pure number, and 1 Hz would become 1 rad/s, 1/min a radian in
    a minute without a word.
    """
    if unit == expected:
        return values
    import pint  # takes 0.3 s, and most recordings are in SI already

    try:
        given = _parse(unit)
    except (pint.PintError, ArithmeticError, AttributeError, AssertionError, LookupError, SyntaxError, TypeError, ValueError):
        raise InputError(f'{where}: the unit "{unit}" is not known; {_remedy(unit, expected)}') from None
    target = _parse(expected) if expected is not None else _registry().Quantity(1, given).to_base_units().units
    if expected is not None and given.is_compatible_with(target) and _angular(_parse(expected)) and not _angular(given):
        turns = quoted([expected.replace("rad", "rev"), expected], last="or")
        raise InputError(f'{where}: "{unit}" counts turns or radians? The model wants {expected}; write {turns} instead')
    try:
        return np.asarray(_registry().Quantity(values, given).to(target).magnitude, dtype=float)
    except pint.PintError:
        remedy = _remedy(unit, expected)
        raise InputError(f'{where}: the unit "{unit}" ({given}) cannot be converted to {expected}, which is wanted; {remedy}') from None


def check_unit(unit: str, expected: str | None, *, where: str) -> None:
    """Raise the InputError of `to_si` for a column that nobody has read yet."""
    to_si(np.empty(0), unit, expected, where=where)


def _remedy(unit: str, expected: str | None) -> str:
    meant = MEANT.get(unit)
    if meant and (expected is None or _parse(meant).is_compatible_with(_parse(expected))):
        return f'write "{meant}"' + (", standard gravity" if meant == "g0" else "")
    if expected in OTHERS:
        return f"write one of {quoted([expected, *OTHERS[expected]], last='or')}, or a unit made up of such"
    return 'write it as in "mm", "deg/s" or "N.m"'


def _angular(unit: pint.Unit) -> bool:
    return "radian" in str(_registry().Quantity(1.0, unit).to_root_units().units)


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
