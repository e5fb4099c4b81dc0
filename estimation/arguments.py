"""What arguments must be, said where they are handed in and not where they are used."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import Any

from backsight.models.errors import InputError


def check_number(value: object, where: str, remedy: str = "give a number") -> None:
    """Raise InputError unless it is a real number; where: the argument as it was typed."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{where} = {value!r} is {_kind(value)}; {remedy}.")


def check_mapping(value: object, where: str, remedy: str) -> None:
    """Raise InputError unless it maps names to something."""
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {_kind(value)}; {remedy}.")


def check_kind(value: object, kind: type[Any], where: str, remedy: str) -> None:
    """Raise InputError unless it is an instance of this class."""
    if not isinstance(value, kind):
        raise InputError(f"{where} is {_kind(value)}, not a {kind.__name__}; {remedy}.")


def _kind(value: object) -> str:
    name = type(value).__name__
    return "None" if value is None else f"a{'n' if name[0].lower() in 'aeio' else ''} {name}"
