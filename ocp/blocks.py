"""Small dense derivative blocks of one term, and where their entries stand in large sparse matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .columnwise import Columnwise, columnwise
from .interpolation import Interpolation
from .polynomials import Array
from .terms import Term

Index = NDArray[np.int64]

COMMON = (1, 2)  # arguments that all columns have in common: theta and p


class Block:
    """One term's column in the unknowns it depends on, v = [l_i; theta], differentiated for one column and mapped over all.

    A small matrix of every column stands in one column by its nonzeros, whose places are `jacobian_rows/columns`, ...
    """

    def __init__(self, interpolation: Interpolation, index: Index, steps: Array, free: Sequence[int], term: Term) -> None:
        self.term, self.index, self.intervals = term, index, index.shape[1]
        self.local, self.trajectory_size = interpolation.local, int(index.max()) + 1
        ell, theta, p = ca.SX.sym("l", self.local), ca.SX.sym("theta", len(free)), ca.SX.sym("p", term.function.size1_in(1))
        base, data = ca.SX.sym("v", interpolation.rows * term.places), ca.SX.sym("d", term.data.shape[0])
        basis, numbers = _basis(interpolation, steps, term)
        merged = ca.SX(p)
        for k, i in enumerate(free):
            merged[i] = theta[k]
        places = []
        for entries, known in zip(basis.entries, ca.vertsplit(base, interpolation.rows), strict=True):
            values = ca.SX(known)
            for entry, value in zip(interpolation.entries, entries, strict=True):
                values[entry.row] += value * ell[entry.column]
            places.append(values)
        column = _column(term, places, merged, p, data)
        symbols = (ell, theta, p, basis.symbols, base, data)
        # what the function does not look at is not carried to its columns
        self._used = [_used(column, s) for s in symbols]
        self._numbers = numbers[self._used[3]]
        self._arguments = [s[used] for s, used in zip(symbols, self._used, strict=True)]
        self._v, self._lam = ca.vertcat(ell, theta), ca.SX.sym("lam", column.shape[0])
        self._column, self._jacobian = column, ca.jacobian(column, self._v)
        self.jacobian_rows, self.jacobian_columns = _triplet(self._jacobian)

    @cached_property
    def _hessian(self) -> Any:
        return ca.triu(ca.hessian(ca.dot(self._lam, self._column), self._v)[0])

    @property
    def curved(self) -> bool:
        """Whether the values are not linear in v."""
        return bool(self._hessian.nnz() > 0)

    # ---- of all columns; arguments as `numbers` gives them

    @cached_property
    def valued(self) -> Columnwise:
        """Values m, (K m, C)."""
        return columnwise(_function("value", self._arguments, self._column), COMMON)

    @cached_property
    def linearised(self) -> Columnwise:
        """Values m and the nonzeros of their derivative in v."""
        return columnwise(_function("linearised", self._arguments, self._column, _nonzeros(self._jacobian)), COMMON)

    @cached_property
    def bent(self) -> Columnwise:
        """Nonzeros of the Hessian of lam . m in v, its upper triangle; one more argument, lam (K m, C)."""
        return columnwise(_function("hessian", [*self._arguments, self._lam], _nonzeros(self._hessian)), COMMON)

    @cached_property
    def bent_places(self) -> tuple[Index, Index]:
        """Row and column of these nonzeros in v."""
        return _triplet(self._hessian)

    def numbers(self, c: Array, theta: Array, parameters: Array, base: Array, data: Array) -> list[Array]:
        """What the functions take at every column, as far as it is used; what all columns have in common as vectors."""
        _, free, fixed, _, known, rows = self._used
        return [c[self._taken], theta[free], parameters[fixed], self._numbers, base[known], data[rows]]

    @cached_property
    def _taken(self) -> Index:
        return self.index[self._used[0]][:, self.term.interval]

    # ---- where the entries of small matrices stand in the large ones; shape (nonzeros, columns)

    def _decision(self, local: Index, interval: Index) -> Index:
        """Decision index of local positions (k,) in intervals (m,), shape (k, m)."""
        out = np.empty((len(local), len(interval)), dtype=np.int64)
        inside = local < self.local
        out[inside] = self.index[local[inside]][:, interval]
        out[~inside] = (self.trajectory_size + local[~inside] - self.local)[:, None]
        return out

    def jacobian_entries(self, offset: int) -> tuple[Index, Index]:
        """Constraint and decision index of every nonzero of every column's Jacobian."""
        m, count = self.term.target.shape
        rows = offset + self.jacobian_rows[:, None] + m * np.arange(count)[None, :]
        return rows, self._decision(self.jacobian_columns, self.term.interval)


@dataclass(frozen=True)
class _Basis:
    """Symbols that every column fills with numbers of its own, and the entries of T at every place in terms of them."""

    symbols: Any
    entries: list[list[Any]]


def _column(term: Term, places: list[Any], parameters: Any, reference: Any, data: Any) -> Any:
    """The values of a term's column from [dx; x; z; w] at its places."""
    if term.within is not None:
        within = term.within
        size = within.function.size1_in(3)
        own, *others = ca.vertsplit(data, [0, *range(data.shape[0] - size * len(within.nodes), data.shape[0] + 1, size)])
        phi = [within.function(v, parameters, reference, d) for v, d in zip(places[1:], others, strict=True)]
        moments = ca.vec(ca.horzcat(*phi) @ ca.DM(within.weights))
        return term.function(places[0], parameters, reference, ca.vertcat(own, moments))
    datas = ca.vertsplit(data, data.shape[0] // term.places)
    phi = [term.function(v, parameters, reference, d) for v, d in zip(places, datas, strict=True)]
    return ca.vertcat(*phi) if term.moments is None else ca.vec(ca.horzcat(*phi) @ ca.DM(term.moments))


def _basis(interpolation: Interpolation, steps: Array, term: Term) -> tuple[_Basis, Array]:
    """At nodes the polynomials are constants and only the interval's length differs; elsewhere every entry does."""
    h = steps[term.interval]
    length, nodes = ca.SX.sym("h"), term.nodes
    if nodes is None:
        numbers = interpolation.values(term.all_places()[1][:: term.places], h)
        symbols = ca.SX.sym("T", len(numbers))
        own = [symbols[kind] for kind in interpolation.kinds[1]]
        if term.within is None:
            return _Basis(symbols, [own]), numbers
        entries = [own, *_at_nodes(interpolation, term.within.nodes, length)]
        return _Basis(ca.vertcat(symbols, length), entries), np.vstack([numbers, h])
    return _Basis(length, _at_nodes(interpolation, nodes, length)), h[None, :]


def _at_nodes(interpolation: Interpolation, nodes: Array, length: Any) -> list[list[Any]]:
    places = np.asarray(nodes, dtype=np.float64)
    return [[float(e.differentiated(tau)) * length**e.power for e in interpolation.entries] for tau in places]


def _function(name: str, inputs: list[Any], *outputs: Any) -> Any:
    return ca.Function(name, inputs, [ca.densify(part) for part in outputs], {"cse": True})


def _used(expression: Any, symbols: Any) -> list[int]:
    """Which of the symbols an expression depends on."""
    return sorted(set(ca.jacobian_sparsity(expression, symbols).get_col()))


def _triplet(matrix: Any) -> tuple[Index, Index]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _nonzeros(matrix: Any) -> Any:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)
