"""Trees of flat Modelica: names, references, derivatives and places in the text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...errors import ModelError

Tree = Any  # a JSON tree


def name_of(reference: Tree) -> str:
    """The name of a scalar variable; elements of arrays are z_1, A_1_2."""
    indices = []
    for subscript in reference["subscripts"]:
        value = subscript.get("Index", {}).get("value")
        if value is None:
            raise ModelError(
                f"the Modelica variable {reference['name']['name']} has a subscript that is no number; write a for loop or scalars"
            )
        indices.append(str(value))
    return plain(reference["name"]["name"]) + "".join(f"_{index}" for index in indices)


def plain(name: str) -> str:
    """A Modelica name as a dotted name of ours: mass[1].s is mass_1.s."""
    return name.replace("[", "_").replace(",", "_").replace(" ", "").replace("]", "")


def references(tree: Tree) -> set[str]:
    """The names of all variables and parameters in a tree."""
    if isinstance(tree, list):
        return set().union(*(references(item) for item in tree))
    if not isinstance(tree, dict):
        return set()
    if "VarRef" in tree:
        return {name_of(tree["VarRef"])}
    return set().union(*(references(value) for key, value in tree.items() if key not in ("span", "name")))


def reference(name: str) -> Tree:
    """The tree that refers to a variable."""
    return {"VarRef": {"name": {"name": name}, "subscripts": []}}


def definition_of_rate(residual: Tree) -> tuple[str, str] | None:
    """(a, b) where the equation reads a = der(b) or der(b) = a."""
    sides = residual.get("Binary", {})
    if sides.get("op") != "Sub":
        return None
    for one, other in ((sides["lhs"], sides["rhs"]), (sides["rhs"], sides["lhs"])):
        call = other.get("BuiltinCall", {})
        if "VarRef" in one and call.get("function") == "Der" and "VarRef" in call["args"][0]:
            return name_of(one["VarRef"]), name_of(call["args"][0]["VarRef"])
    return None


def derivatives(tree: Tree) -> set[str]:
    """The variables in a tree of which a derivative is taken."""
    if isinstance(tree, list):
        return set().union(*(derivatives(item) for item in tree))
    if not isinstance(tree, dict):
        return set()
    call = tree.get("BuiltinCall", {})
    if call.get("function") == "Der":
        return references(call["args"])
    return set().union(*(derivatives(value) for value in tree.values()))


def spans(tree: Tree) -> Iterator[dict[str, int]]:
    """Where the pieces of a tree stand in the text."""
    if isinstance(tree, list):
        for item in tree:
            yield from spans(item)
    elif isinstance(tree, dict):
        if isinstance(tree.get("span"), dict):
            yield tree["span"]
        for key, value in tree.items():
            if key not in ("span", "name"):
                yield from spans(value)
