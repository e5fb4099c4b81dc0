"""The plants by name: `PLANTS["actuator"]()` is a fresh model with published parameters."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from ..model import Model
from .actuator import actuator
from .drillstring import drillstring
from .five_bar import five_bar
from .quadrotor import quadrotor
from .xy_table import xy_table

PLANTS: Mapping[str, Callable[[], Model]] = MappingProxyType(
    {"actuator": actuator, "drillstring": drillstring, "five_bar": five_bar, "quadrotor": quadrotor, "xy_table": xy_table}
)

__all__ = ["PLANTS", "actuator", "drillstring", "five_bar", "quadrotor", "xy_table"]
