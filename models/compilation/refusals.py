"""What flattening refuses in the names of a model and in the code of a component, in the words of its user."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from ..errors import ModelError
from ..language import Component
from ..model import Model

SX = Any


def refuse_ambiguous(model: Model) -> None:
    """Names of the model itself that something else has: time, a variable, a parameter of a component."""
    taken = {"time": "the time"}
    for name, component in model.components.items():
        words = [*component.declared_variables, *component.declared_signals]
        words += [f"{port}.{word}" for port, c in component.declared_connectors.items() for p in c.pairs for word in (p.potential, p.flow)]
        taken |= {f"{name}.{word}": f"a variable of '{name}'" for word in words}
    for name in model.parameters:
        if name in taken:
            raise ModelError(f"parameter '{name}' of model '{model.name}' has the name of {taken[name]}; rename it")
    taken |= dict.fromkeys(model.parameters, "a parameter of the model")
    taken |= {f"{name}.{word}": f"a parameter of '{name}'" for name, c in model.components.items() for word in c.declared_parameters}
    for name, variable in model.inputs.items():
        if name in taken and name != variable:
            raise ModelError(f"input '{name}' ('{variable}') of model '{model.name}' has the name of {taken[name]}; rename it")


def declared_equations(name: str, component: Component, scope: Any) -> object:
    """What `equations` of a component returns; its errors name the component."""
    what = f"{type(component).__name__} '{name}'"
    try:
        return component.equations(scope)
    except NotImplementedError as error:
        finished = ", ".join(kind.__name__ for kind in type(component).__subclasses__()) or "a subclass that has all its methods"
        raise ModelError(f"{what} is an unfinished component ({error}); use {finished}") from error
    except RuntimeError as error:
        if "truth value" not in str(error):
            raise
        raise ModelError(
            f"{what}: its equations ask whether a symbol is true (if, and, or, not, min, max on c.<variable>); write "
            "casadi.if_else(condition, yes, no), casadi.fmin, casadi.fmax instead"
        ) from error


def is_finite(residual: SX) -> bool:
    """Whether all numbers in an expression are finite; math.sin of a symbol is none."""
    node = ca.Function("node", [ca.vertcat(*ca.symvar(residual))], [residual])
    constants = [node.instruction_constant(i) for i in range(node.n_instructions()) if node.instruction_id(i) == ca.OP_CONST]
    return all(map(math.isfinite, constants))
