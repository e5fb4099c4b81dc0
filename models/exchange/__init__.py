"""Models from and for other tools: Modelica text in, FMU 3.0 and Python files out."""

from .fmu import export_fmu
from .modelica import load_modelica
from .python_code import function_name, python_code

__all__ = ["export_fmu", "function_name", "load_modelica", "python_code"]
