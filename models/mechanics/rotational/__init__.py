"""Components that turn about one axis, and those that tie a rotation to another motion: gears and racks.

The same physics as `translational`, angle for position and torque for force; the sign convention of `connectors` holds.
"""

from .bodies import AddedInertia, Inertia, RotationalFixed, Rotor
from .elements import (
    EccentricWeight,
    RotationalCogging,
    RotationalCubicSpring,
    RotationalDamper,
    RotationalDrag,
    RotationalElement,
    RotationalEndStop,
    RotationalLowerEndStop,
    RotationalSpring,
    RotationalSpringDamper,
    TurningElement,
)
from .friction import (
    RotationalAsymmetricFriction,
    RotationalDahlFriction,
    RotationalFriction,
    RotationalLoadDependentFriction,
    RotationalLoadFriction,
    RotationalLogarithmicFriction,
    RotationalLuGreFriction,
    RotationalPositionDependentFriction,
    RotationalStribeckFriction,
    StickSlip,
)
from .sensors import AngleSensor, AngularAccelerationSensor, AngularVelocitySensor, RotationalPowerSensor, TorqueSensor
from .sources import Angle, AngularAcceleration, AngularSpeed, ConstantTorque, Torque
from .transmission import EccentricRack, Gear, GearWithError, Rack, RotationalBacklash, RotationalRigid, TorsionString

__all__ = [
    "AddedInertia",
    "Angle",
    "AngleSensor",
    "AngularAcceleration",
    "AngularAccelerationSensor",
    "AngularSpeed",
    "AngularVelocitySensor",
    "ConstantTorque",
    "EccentricRack",
    "EccentricWeight",
    "Gear",
    "GearWithError",
    "Inertia",
    "Rack",
    "RotationalAsymmetricFriction",
    "RotationalBacklash",
    "RotationalCogging",
    "RotationalCubicSpring",
    "RotationalDahlFriction",
    "RotationalDamper",
    "RotationalDrag",
    "RotationalElement",
    "RotationalEndStop",
    "RotationalFixed",
    "RotationalFriction",
    "RotationalLoadDependentFriction",
    "RotationalLoadFriction",
    "RotationalLogarithmicFriction",
    "RotationalLowerEndStop",
    "RotationalLuGreFriction",
    "RotationalPositionDependentFriction",
    "RotationalPowerSensor",
    "RotationalRigid",
    "RotationalSpring",
    "RotationalSpringDamper",
    "RotationalStribeckFriction",
    "Rotor",
    "StickSlip",
    "Torque",
    "TorqueSensor",
    "TorsionString",
    "TurningElement",
]
