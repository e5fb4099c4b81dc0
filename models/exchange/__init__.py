"""Models from and for other tools: Modelica text in, FMU 3.0 and Python files out."""

from .fmu import export_fmu
from .modelica import load_modelica
from .python_code import python_code

__all__ = ["export_fmu", "load_modelica", "python_code"]
