"""From a model to its equations: flatten -> eliminate -> reduce the index -> select states -> `Dae`."""

from .compiler import compile_model

__all__ = ["compile_model"]
