"""What arguments must be, said where they are handed in and not where they are used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backsight.models.errors import InputError


def check_number(value: object, where: str, remedy: str = "give a number") -> None:
    """Raise InputError unless it is a real number, of Python or NumPy; where: the argument as it was typed."""
    number = not isinstance(value, bool | str | bytes) and np.ndim(value) == 0  # type: ignore[arg-type]
    if not (number and np.asarray(value).dtype.kind in "iuf"):
        raise InputError(f"{where} = {value!r} is {_kind(value)}; {remedy}.")


def check_mapping(value: object, where: str, remedy: str) -> None:
    """Raise InputError unless it maps names to something."""
    if not (isinstance(value, Mapping) or hasattr(value, "keys")):  # a pandas Series is as good
        raise InputError(f"{where} is {_kind(value)}; {remedy}.")


def check_kind(value: object, kind: type[Any], where: str, remedy: str) -> None:
    """Raise InputError unless it is an instance of this class."""
    if not isinstance(value, kind):
        raise InputError(f"{where} is {_kind(value)}, not a {kind.__name__}; {remedy}.")


def _kind(value: object) -> str:
    name = type(value).__name__
    return "None" if value is None else f"a{'n' if name[0].lower() in 'aeio' else ''} {name}"
