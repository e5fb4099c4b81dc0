"""What a balance is and how it stands: with its derivative positive on the left, so that w is the force that the text does not explain.

flange_a.tau + flange_b.tau = J*a      with a = der(w)      ->      J a - (flange_a.tau + flange_b.tau) - w = 0
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from .trees import Tree, derivatives, name_of, references


def balanced(residual: Tree, rates: Mapping[str, str]) -> str:
    """The variable whose balance an equation is, "" where it is none: m der(v) = f, or m a = f with a = der(v), v = der(s).

    rates  a -> b where another equation says a = der(b)
    """
    first = sorted(derivatives(residual))
    second = sorted(n for n in references(residual) if rates.get(n) in rates)
    return str((first or second or [""])[0])


def oriented(residual: Tree, variable: str, value: Callable[[str], float]) -> Tree:
    """left - right or right - left: the one in which the derivative of `variable`, or the acceleration of that name, has the sign +.

    value  of a parameter, which may be negative; everything else is taken as positive
    """
    if _sign(residual, variable, value) >= 0:
        return residual
    sides = residual.get("Binary", {})
    if sides.get("op") == "Sub":
        return {"Binary": {"op": "Sub", "lhs": sides["rhs"], "rhs": sides["lhs"]}}
    return {"Unary": {"op": "Minus", "rhs": residual}}


def unit_of_terms(residual: Tree, unit: Callable[[str], str]) -> str:
    """The unit of an equation, when the terms that are plain variables agree on one; "" otherwise."""
    found = {unit(name) for name in _plain_terms(residual)} - {""}
    return found.pop() if len(found) == 1 else ""


def _plain_terms(tree: Tree) -> Iterator[str]:
    [(kind, body)] = tree.items()
    if kind == "VarRef":
        yield name_of(body)
    elif kind == "Unary" and body["op"] in ("Minus", "Plus"):
        yield from _plain_terms(body["rhs"])
    elif kind == "Binary" and body["op"].removesuffix("Elem") in ("Add", "Sub"):
        yield from _plain_terms(body["lhs"])
        yield from _plain_terms(body["rhs"])


def _sign(tree: Tree, variable: str, value: Callable[[str], float]) -> int:
    """Of the factor of the derivative; 0 where it does not occur, or not as a factor."""
    [(kind, body)] = tree.items()
    if kind == "VarRef":
        return int(name_of(body) == variable)
    if kind == "BuiltinCall":
        return int(body["function"] == "Der" and variable in references(body["args"]))
    if kind == "Unary":
        inner = _sign(body["rhs"], variable, value)
        return -inner if body["op"] == "Minus" else inner
    if kind != "Binary":
        return 0
    op, left, right = body["op"].removesuffix("Elem"), body["lhs"], body["rhs"]
    if op in ("Add", "Sub"):
        return _sign(left, variable, value) or (1 if op == "Add" else -1) * _sign(right, variable, value)
    if op in ("Mul", "Div"):
        return _sign(left, variable, value) * _factor(right, value) or _factor(left, value) * _sign(right, variable, value)
    return 0


def _factor(tree: Tree, value: Callable[[str], float]) -> int:
    """The sign of a factor."""
    [(kind, body)] = tree.items()
    if kind == "Literal":
        number = next(iter(body["value"].values()))
        return -1 if isinstance(number, int | float) and number < 0 else 1
    if kind == "VarRef":
        return -1 if value(name_of(body)) < 0 else 1
    if kind == "Unary" and body["op"] == "Minus":
        return -_factor(body["rhs"], value)
    if kind == "Binary" and body["op"].removesuffix("Elem") in ("Mul", "Div"):
        return _factor(body["lhs"], value) * _factor(body["rhs"], value)
    return 1
