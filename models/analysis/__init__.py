"""What can be said of a model without recordings: equilibria, linear models, and what its outputs can tell."""

from .identifiability import Identifiability, identifiability
from .linearise import StateSpace, linearise
from .operating_point import OperatingPoint, equilibrium, operating_point

__all__ = ["Identifiability", "OperatingPoint", "StateSpace", "equilibrium", "identifiability", "linearise", "operating_point"]
