"""A `Dae` under given inputs: consistent start, implicit steps, events where a law switches."""

from .events import Event
from .simulate import Trajectory, simulate

__all__ = ["Event", "Trajectory", "simulate"]
