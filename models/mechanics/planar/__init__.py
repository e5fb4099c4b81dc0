"""Parts that move in a plane: rigid bodies, joints and loops on frames, with sensors; point masses and rods on points.

world.py     World (gravity), FrameFixed         joints.py   Revolute, Prismatic
bodies.py    Body, MomentBody                    sensors.py  PointSensor, Accelerometer, Gyro
elements.py  FixedTranslation, FixedRotation, WorldForce, WorldTorque, ConstantWorldForce
drag.py      Drag, LinearDrag, QuadraticDrag
points.py    PointMass, PlanarFixed, Rod
"""

from .bodies import Body, MomentBody, RigidBody
from .drag import Drag, LinearDrag, QuadraticDrag
from .elements import ConstantWorldForce, FixedRotation, FixedTranslation, WorldForce, WorldTorque
from .joints import Prismatic, Revolute
from .points import PlanarFixed, PointMass, Rod
from .sensors import Accelerometer, FrameSensor, Gyro, PointSensor
from .world import FrameFixed, World

__all__ = [
    "Accelerometer",
    "Body",
    "ConstantWorldForce",
    "Drag",
    "FixedRotation",
    "FixedTranslation",
    "FrameFixed",
    "FrameSensor",
    "Gyro",
    "LinearDrag",
    "MomentBody",
    "PlanarFixed",
    "PointMass",
    "PointSensor",
    "Prismatic",
    "QuadraticDrag",
    "Revolute",
    "RigidBody",
    "Rod",
    "World",
    "WorldForce",
    "WorldTorque",
]
