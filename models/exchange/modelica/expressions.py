"""Expressions of flat Modelica, as rumoca hands them over in JSON, as CasADi expressions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from ...errors import ModelError
from .trees import Tree, name_of

SX = Any

_BINARY: Mapping[str, Callable[[Any, Any], Any]] = {
    "Add": lambda a, b: a + b,
    "Sub": lambda a, b: a - b,
    "Mul": lambda a, b: a * b,
    "Div": lambda a, b: a / b,
    "Exp": lambda a, b: a**b,
    "Lt": lambda a, b: a < b,
    "Le": lambda a, b: a <= b,
    "Gt": lambda a, b: a > b,
    "Ge": lambda a, b: a >= b,
    "And": ca.logic_and,
    "Or": ca.logic_or,
}
_UNARY: Mapping[str, Callable[[Any], Any]] = {"Minus": lambda a: -a, "Plus": lambda a: a, "Not": ca.logic_not}
_BUILTIN: Mapping[str, Callable[..., Any]] = {
    "Abs": ca.fabs,
    "Sign": ca.sign,
    "Sqrt": ca.sqrt,
    "Sin": ca.sin,
    "Cos": ca.cos,
    "Tan": ca.tan,
    "Asin": ca.asin,
    "Acos": ca.acos,
    "Atan": ca.atan,
    "Atan2": ca.atan2,
    "Sinh": ca.sinh,
    "Cosh": ca.cosh,
    "Tanh": ca.tanh,
    "Exp": ca.exp,
    "Log": ca.log,
    "Log10": ca.log10,
    "Floor": ca.floor,
    "Ceil": ca.ceil,
    "Min": ca.fmin,
    "Max": ca.fmax,
    "NoEvent": lambda a: a,
    "Smooth": lambda _, a: a,
    "Homotopy": lambda actual, _: actual,
}


class Translator:
    """Turns trees into expressions: `lookup` gives the symbol of a variable or parameter, `der` the derivative of an expression."""

    def __init__(self, lookup: Callable[[str], SX], der: Callable[[SX], SX], functions: Mapping[str, Tree], time: SX) -> None:
        self.lookup, self.der, self.functions, self.time = lookup, der, functions, time

    def __call__(self, tree: Tree) -> SX:
        """The expression of a tree; ModelError for what has no smooth continuous meaning here."""
        [(kind, body)] = tree.items()
        handler = getattr(self, f"_{kind.lower()}", None)
        if handler is None:
            raise ModelError(f"the Modelica construct {kind} is not supported; write the equation with scalars")
        return handler(body)

    def _literal(self, body: Tree) -> SX:
        [(kind, value)] = body["value"].items()
        if kind not in ("Real", "Integer", "Boolean"):
            raise ModelError(f"the Modelica literal {value!r} is no number; only numbers and logical values can be used")
        return ca.SX(float(value))

    def _varref(self, body: Tree) -> SX:
        name = name_of(body)
        return self.time if name == "time" else self.lookup(name)

    def _binary(self, body: Tree) -> SX:
        operation = _BINARY.get(body["op"].removesuffix("Elem"))
        if operation is None:
            raise ModelError(f"the Modelica operator {body['op']} is not supported in equations; use <, <=, > or >= for comparisons")
        return operation(self(body["lhs"]), self(body["rhs"]))

    def _unary(self, body: Tree) -> SX:
        return _UNARY[body["op"]](self(body["rhs"]))

    def _if(self, body: Tree) -> SX:
        value = self(body["else_branch"])
        for condition, branch in reversed(body["branches"]):
            when = ca.SX(self(condition))
            if not when.is_constant():
                value = ca.if_else(when, self(branch), value)
            elif float(when):
                value = self(branch)
        return value

    def _builtincall(self, body: Tree) -> SX:
        name = body["function"]
        if name == "Der":
            return self.der(self(body["args"][0]))
        if name not in _BUILTIN:
            raise ModelError(f"the Modelica function {name.lower()}() is not supported: only continuous functions of scalars are")
        return _BUILTIN[name](*(self(argument) for argument in body["args"]))

    def _functioncall(self, body: Tree) -> SX:
        name = body["name"]["name"]
        function = self.functions.get(name)
        if function is None or body.get("is_constructor"):
            raise ModelError(f"the Modelica function {name}() is not known; define it in Modelica with assignments")
        values = {p["name"]: self(a) for p, a in zip(function["inputs"], body["args"], strict=False)}

        def local(word: str) -> SX:
            return values[word] if word in values else self.lookup(word)

        inner = Translator(local, self.der, self.functions, self.time)
        for statement in function["body"]:
            if list(statement) != ["Assignment"]:
                raise ModelError(f"the Modelica function {name}() holds a {next(iter(statement))}; only assignments are supported")
            assignment = statement["Assignment"]
            values[".".join(part["ident"] for part in assignment["comp"]["parts"])] = inner(assignment["value"])
        return values[function["outputs"][0]["name"]]


def number(tree: Tree | None, values: Mapping[str, float], functions: Mapping[str, Tree]) -> float | None:
    """The value of a constant expression over known parameter values; None where there is no tree, or it depends on what is not known."""
    if tree is None:
        return None
    try:
        value = Translator(lambda name: ca.SX(values[name]), lambda _: ca.SX(math.nan), functions, ca.SX(math.nan))(tree)
    except KeyError:
        return None
    result = float(value)
    return result if math.isfinite(result) else None
