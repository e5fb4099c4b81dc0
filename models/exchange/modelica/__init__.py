"""Modelica text as a model, through the `rumoca` compiler (extra `modelica`): flattening is its work, everything after it is ours."""

from .load import load_modelica

__all__ = ["load_modelica"]
