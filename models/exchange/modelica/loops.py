"""Equations of loops, one by one. The compiler writes out the first two rounds of a loop over derivatives and leaves `der(x) = 0` for the
others; what they are stands in the body of the loop, which is put in for each round here.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

from ...errors import ModelError
from .expressions import number
from .trees import Tree, plain


def unrolled(flat: dict[str, Any]) -> list[Tree]:
    """The equations of a flat class with every round of every loop written out."""
    equations = list(flat["equations"])
    for loop in flat["structured_equations"]:
        if loop["interiors_materialized"]:
            continue
        binders, body = loop["domain"]["binders"], loop["template"]["body"]
        rounds = product(*(range(b["lower"], b["upper"] + (1 if b["step"] > 0 else -1), b["step"]) for b in binders))
        k = loop["first_equation_index"]
        for values in rounds:
            numbers = {b["display_name"]: value for b, value in zip(binders, values, strict=True)}
            for tree in body:
                equations[k] = {**equations[k], "residual": _with(tree, numbers, flat["functions"])}
                k += 1
    return equations


def _with(tree: Tree, numbers: Mapping[str, int], functions: Mapping[str, Tree]) -> Tree:
    """The tree with the loop's indices as numbers, subscripts worked out and branches that are decided chosen."""
    if isinstance(tree, list):
        return [_with(item, numbers, functions) for item in tree]
    if not isinstance(tree, dict):
        return tree
    if "VarRef" in tree:
        return _reference(tree["VarRef"], numbers, functions)
    if "If" in tree:
        return _branches(tree["If"], numbers, functions)
    return {key: value if key in ("span", "name") else _with(value, numbers, functions) for key, value in tree.items()}


def _reference(body: Tree, numbers: Mapping[str, int], functions: Mapping[str, Tree]) -> Tree:
    name = body["name"]["name"]
    if name in numbers and not body["subscripts"]:
        return {"Literal": {"value": {"Integer": numbers[name]}}}
    subscripts = []
    for subscript in body["subscripts"]:
        if "Expr" in subscript:
            value = number(_with(subscript["Expr"]["expr"], numbers, functions), {}, functions)
            if value is None or value != round(value):
                raise ModelError(f"a subscript of '{plain(name)}' in a loop is no whole number; write the equations one by one")
            subscript = {"Index": {"value": round(value)}}
        subscripts.append(subscript)
    return {"VarRef": {**body, "subscripts": subscripts}}


def _branches(body: Tree, numbers: Mapping[str, int], functions: Mapping[str, Tree]) -> Tree:
    open_branches = []
    for condition, branch in body["branches"]:
        when = _with(condition, numbers, functions)
        decided = number(when, {}, functions)
        if decided is None:
            open_branches.append([when, _with(branch, numbers, functions)])
        elif decided:
            last = _with(branch, numbers, functions)
            break
    else:
        last = _with(body["else_branch"], numbers, functions)
    return {"If": {**body, "branches": open_branches, "else_branch": last}} if open_branches else last
