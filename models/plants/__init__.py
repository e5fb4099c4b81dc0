"""The plants by name: `PLANTS["actuator"]()` is a fresh model with published parameters."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from ..model import Model
from .actuator import actuator

PLANTS: Mapping[str, Callable[[], Model]] = MappingProxyType({"actuator": actuator})

__all__ = ["PLANTS", "actuator"]
