"""Arrays of flat Modelica as scalars: z[3] becomes z_1, z_2, z_3, and what {1, 2, 3} says of it goes to each."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from ...errors import ModelError
from .trees import Tree, plain

_OF_ELEMENTS = ("binding", "start", "min", "max", "nominal")


def elements(name: str, declared: Tree) -> Iterator[tuple[str, Tree]]:
    """The scalars of a declared variable or parameter, each with its own name and declaration; itself where it is one.

    Raises ModelError for values that are not written element by element.
    """
    dims = declared["dims"]
    if not dims:
        yield plain(name), declared
        return
    for index in product(*(range(size) for size in dims)):
        own = {word: _element(name, word, declared[word], index) for word in _OF_ELEMENTS}
        yield "_".join([plain(name), *(str(i + 1) for i in index)]), {**declared, **own}


def _element(name: str, word: str, tree: Tree | None, index: tuple[int, ...]) -> Tree | None:
    if tree is None or ("Literal" in tree and word != "binding"):  # each element the same
        return tree
    for i in index:
        written = tree.get("Array", {}).get("elements", [])
        if i >= len(written):
            what = "values are" if word == "binding" else f"{word} values are"
            raise ModelError(f"the {what} not written element by element for the array '{name}'; write {{1, 2, 3}}, or scalars")
        tree = written[i]
    return tree
