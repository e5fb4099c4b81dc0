"""Components that slide along one line.

A body has one flange; any number of elements may be connected to it. Elements have two, and follow the sign convention of `connectors`.
"""

from .bodies import AddedMass, Fixed, Mass
from .elements import Cogging, CubicSpring, Damper, Drag, Element, EndStop, LowerEndStop, MovingElement, Spring, SpringDamper
from .friction import (
    AsymmetricFriction,
    DahlFriction,
    Friction,
    LoadDependentFriction,
    LoadFriction,
    LogarithmicFriction,
    LuGreFriction,
    PositionDependentFriction,
    StickSlip,
    StribeckFriction,
)
from .sensors import AccelerationSensor, ForceSensor, PositionSensor, PowerSensor, VelocitySensor
from .sources import Acceleration, ConstantForce, Force, Position, Speed
from .transmission import Backlash, Rigid

__all__ = [
    "Acceleration",
    "AccelerationSensor",
    "AddedMass",
    "AsymmetricFriction",
    "Backlash",
    "Cogging",
    "ConstantForce",
    "CubicSpring",
    "DahlFriction",
    "Damper",
    "Drag",
    "Element",
    "EndStop",
    "Fixed",
    "Force",
    "ForceSensor",
    "Friction",
    "LoadDependentFriction",
    "LoadFriction",
    "LogarithmicFriction",
    "LowerEndStop",
    "LuGreFriction",
    "Mass",
    "MovingElement",
    "Position",
    "PositionDependentFriction",
    "PositionSensor",
    "PowerSensor",
    "Rigid",
    "Speed",
    "Spring",
    "SpringDamper",
    "StickSlip",
    "StribeckFriction",
    "VelocitySensor",
]
