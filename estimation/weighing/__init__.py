"""Weighting-matrix studies: which W and V the data want, what hangs on them, and what other ones would have given."""

from .components import Component
from .estimated import variance_components
from .setting import Outcome, Setting
from .weigh import Weighing, weigh

__all__ = ["Component", "Outcome", "Setting", "Weighing", "variance_components", "weigh"]
