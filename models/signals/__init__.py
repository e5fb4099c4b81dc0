"""Signal blocks: what stands between a command and a source, or between a sensor and what is recorded. A blank unit is any unit."""

from .blocks import Constant, DeadZone, Drift, Gain, Offset, PeriodicError, Rotation, Saturation, Sine, Sum
from .dynamics import AsymmetricLag, Delay, Lag, LimitedPIController, PIController, SecondOrderLag

__all__ = [
    "AsymmetricLag",
    "Constant",
    "DeadZone",
    "Delay",
    "Drift",
    "Gain",
    "Lag",
    "LimitedPIController",
    "Offset",
    "PIController",
    "PeriodicError",
    "Rotation",
    "Saturation",
    "SecondOrderLag",
    "Sine",
    "Sum",
]
