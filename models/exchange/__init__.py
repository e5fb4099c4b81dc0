"""Models from and for other tools: Modelica text in, FMU 3.0 out."""

from .fmu import export_fmu
from .modelica import load_modelica

__all__ = ["export_fmu", "load_modelica"]
