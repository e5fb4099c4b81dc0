"""Structural checks: can these equations determine these variables? (A. L. Dulmage, N. S. Mendelsohn, Canad. J. Math. 10, 1958)

A maximum matching pairs equations with variables, x and x' being one unknown. From an equation left over, alternating paths reach the
over-determined part; from a variable left over, the under-determined part. Both are named, with their origins. Where nothing is left over,
the strong components of the matched graph are the blocks that can be solved one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from ..errors import ModelError

if TYPE_CHECKING:
    from .flat import FlatEquation, FlatModel

Incidence = NDArray[np.bool_] | csr_array  # (rows, columns): which unknown occurs where


def determination(flat: FlatModel, known: set[str]) -> None:
    """Raise ModelError, naming equations and variables at fault, unless the equations can determine all variables but the known ones."""
    names = [name for name in flat.variables if name not in known]
    column = {name: i for i, name in enumerate(names)} | {f"der({name})": i for i, name in enumerate(names)}
    too_many, disputed, too_few, unsettled = fault(incidence(flat.equations, column))
    problems = []
    if too_many:
        origins = ", ".join(f"'{flat.equations[i].origin}'" for i in too_many[:12]) + (" ..." if len(too_many) > 12 else "")
        variables = ", ".join(names[i] for i in disputed[:12]) or "no variable"
        excess = len(too_many) - len(disputed)
        given = {name for i in too_many for name in flat.equations[i].held} & known
        driven = f", or drive something else than {', '.join(sorted(given))}" if given else ""
        problems.append(
            f"over-determined: the equations {origins} ({len(too_many)}) determine only {variables} ({len(disputed)}); "
            f"remove {excess} of them, or the source or fixed point that says the same twice{driven}"
        )
    if unsettled:
        variables = ", ".join(names[i] for i in unsettled[:6]) + (" ..." if len(unsettled) > 6 else "")
        origins = ", ".join(f"'{flat.equations[i].origin}'" for i in too_few[:6]) or "no equation"
        lack = len(unsettled) - len(too_few)
        problems.append(
            f"under-determined: the variables {variables} ({len(unsettled)}) are determined only by {origins} ({len(too_few)}); "
            f"{lack} more needed: name an input of the model, or add the equation or component that is missing"
        )
    if problems:
        raise ModelError(f"model '{flat.name}' is " + "; and ".join(problems))


def incidence(equations: Sequence[FlatEquation], column: Mapping[str, int]) -> csr_array:
    """(equations, unknowns), sparse: which unknown occurs where; `column` gives the place of a symbol by name."""
    pairs = [(i, column[name]) for i, e in enumerate(equations) for name in e.held if name in column]
    rows, columns = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    shape = len(equations), max(column.values(), default=-1) + 1
    return csr_array((np.ones(len(pairs), dtype=bool), (rows, columns)), shape=shape)


def fault(incidence: Incidence) -> tuple[list[int], list[int], list[int], list[int]]:
    """Over-determined rows and their columns, then under-determined rows and their columns (all empty when the matching is perfect)."""
    forward = csr_array(incidence)
    rows, columns = forward.shape
    if rows == 0 or columns == 0:
        return list(range(rows)), [], [], list(range(columns))
    backward = csr_array(forward.T)
    row_of = maximum_bipartite_matching(forward, perm_type="row")  # per column its row, -1 when left over
    column_of = np.full(rows, -1)
    column_of[row_of[row_of >= 0]] = np.flatnonzero(row_of >= 0)
    over_rows = _reach(forward, column_of, row_of)
    over_columns = sorted({int(c) for r in over_rows for c in _held(forward, r)})
    under_columns = _reach(backward, row_of, column_of)
    under_rows = sorted({int(r) for c in under_columns for r in _held(backward, c)})
    return over_rows, over_columns, under_rows, under_columns


def blocks(incidence: csr_array) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]] | None:
    """Rows and columns of the irreducible diagonal blocks of a block triangular form; None without a perfect matching."""
    rows, columns = incidence.shape
    row_of = maximum_bipartite_matching(incidence, perm_type="row") if rows == columns else np.array([-1])
    if np.any(row_of < 0):
        return None
    count, label = connected_components(csr_array(incidence[row_of]), directed=True, connection="strong")
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(label, minlength=count))[:-1])
    return [(row_of[part].astype(np.intp), part) for part in parts]


def _reach(incidence: csr_array, mate: NDArray[Any], back: NDArray[Any]) -> list[int]:
    """All first-side members on alternating paths from the unmatched ones."""
    found = {int(i) for i in np.flatnonzero(mate < 0)}
    front = list(found)
    while front:
        for j in _held(incidence, front.pop()):
            i = int(back[j])
            if i >= 0 and i not in found:
                found.add(i)
                front.append(i)
    return sorted(found)


def _held(incidence: csr_array, row: int) -> NDArray[Any]:
    return incidence.indices[incidence.indptr[row] : incidence.indptr[row + 1]]
