"""Parts that move in space: a rigid body in its own axes, what pushes it, and what an inertial measurement unit reads.

    bodies.py     RigidBody                              propeller.py  Propeller, AsymmetricPropeller, PropellerInertia
    elements.py   LinearDrag, QuadraticDrag, DragMoment, AddedMass,  sensors.py    Accelerometer, Gyro
                  MassOffset, BodyForce, BodyTorque,                  rotation.py   axes and angles
                  ConstantBodyForce, ConstantForce

Axes of the body: x forward, y to the right, z down. The model has one rigid body, whose attitude drags and accelerometers see.
"""

from .bodies import RigidBody
from .elements import (
    AddedMass,
    BodyElement,
    BodyForce,
    BodyTorque,
    ConstantBodyForce,
    ConstantForce,
    Drag,
    DragMoment,
    LinearDrag,
    MassOffset,
    QuadraticDrag,
)
from .propeller import AsymmetricPropeller, Propeller, PropellerInertia
from .sensors import Accelerometer, BodySensor, Gyro

__all__ = [
    "Accelerometer",
    "AddedMass",
    "AsymmetricPropeller",
    "BodyElement",
    "BodyForce",
    "BodySensor",
    "BodyTorque",
    "ConstantBodyForce",
    "ConstantForce",
    "Drag",
    "DragMoment",
    "Gyro",
    "LinearDrag",
    "MassOffset",
    "Propeller",
    "PropellerInertia",
    "QuadraticDrag",
    "RigidBody",
]
