"""Structural checks: can these equations determine these variables? (A. L. Dulmage, N. S. Mendelsohn, Canad. J. Math. 10, 1958)

A maximum matching pairs equations with variables, x and x' being one unknown. From an equation left over, alternating paths reach the
over-determined part; from a variable left over, the under-determined part. Both are named, with their origins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from .errors import ModelError

if TYPE_CHECKING:
    from .flatten import FlatModel


def determination(flat: FlatModel, known: set[str]) -> None:
    """Raise ModelError, naming equations and variables at fault, unless the equations can determine all variables but the known ones."""
    names = [name for name in flat.variables if name not in known]
    column = {name: i for i, name in enumerate(names)} | {f"der({name})": i for i, name in enumerate(names)}
    incidence = np.zeros((len(flat.equations), len(names)), dtype=bool)
    for row, equation in enumerate(flat.equations):
        for symbol in ca.symvar(equation.residual):
            if symbol.name() in column:
                incidence[row, column[symbol.name()]] = True
    too_many, disputed, too_few, unsettled = fault(incidence)
    problems = []
    if too_many:
        origins = ", ".join(f"'{flat.equations[i].origin}'" for i in too_many[:12]) + (" ..." if len(too_many) > 12 else "")
        variables = ", ".join(names[i] for i in disputed[:12]) or "no variable"
        excess = len(too_many) - len(disputed)
        given = {s.name() for i in too_many for s in ca.symvar(flat.equations[i].residual)} & known
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


def fault(incidence: NDArray[np.bool_]) -> tuple[list[int], list[int], list[int], list[int]]:
    """Over-determined rows and their columns, then under-determined rows and their columns (all empty when the matching is perfect)."""
    rows, columns = incidence.shape
    if rows == 0 or columns == 0:
        return list(range(rows)), [], [], list(range(columns))
    row_of = maximum_bipartite_matching(csr_array(incidence), perm_type="row")  # per column its row, -1 when left over
    column_of = np.full(rows, -1)
    column_of[row_of[row_of >= 0]] = np.flatnonzero(row_of >= 0)
    over_rows = _reach(incidence, column_of, row_of)
    over_columns = sorted({int(c) for r in over_rows for c in np.flatnonzero(incidence[r])})
    under_columns = _reach(incidence.T, row_of, column_of)
    under_rows = sorted({int(r) for c in under_columns for r in np.flatnonzero(incidence[:, c])})
    return over_rows, over_columns, under_rows, under_columns


def _reach(incidence: NDArray[np.bool_], mate: NDArray[Any], back: NDArray[Any]) -> list[int]:
    """All first-side members on alternating paths from the unmatched ones."""
    found = {int(i) for i in np.flatnonzero(mate < 0)}
    front = list(found)
    while front:
        for j in np.flatnonzero(incidence[front.pop()]):
            i = int(back[j])
            if i >= 0 and i not in found:
                found.add(i)
                front.append(i)
    return sorted(found)
