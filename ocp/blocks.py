"""Small dense derivative blocks of one term, and how they add up to large sparse matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .columnwise import FEWEST, Columnwise, Mapped, columnwise
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
    def _gradient(self) -> Any:
        return ca.densify(ca.jtimes(self._column, self._v, self._lam, True))

    @cached_property
    def _hessian(self) -> Any:
        return ca.tril(ca.hessian(ca.dot(self._lam, self._column), self._v)[0])

    @cached_property
    def _slots(self) -> Any:
        return ca.SX.sym("j", len(self.jacobian_rows))

    @cached_property
    def _square(self) -> Any:
        pattern = ca.Sparsity.triplet(*self._jacobian.shape, self.jacobian_rows.tolist(), self.jacobian_columns.tolist())
        J = ca.SX(pattern, self._slots)
        return ca.tril(J.T @ J)

    @property
    def curved(self) -> bool:
        """Whether the values are not linear in v."""
        return bool(self._hessian.nnz() > 0)

    # ---- mapped over all columns; arguments as `arguments` gives them

    @cached_property
    def value(self) -> Any:
        """Values m, (K m, C)."""
        return self._mapped("value", self._arguments, self._column)

    @cached_property
    def jacobian(self) -> Any:
        """Nonzeros of the derivative of m in v."""
        return self._mapped("jacobian", self._arguments, _nonzeros(self._jacobian))

    @cached_property
    def adjoint(self) -> Any:
        """Gradient of lam . m in v; one more argument, lam (K m, C)."""
        return self._mapped("adjoint", [*self._arguments, self._lam], self._gradient)

    @cached_property
    def hessian(self) -> Any:
        """Nonzeros of the lower triangle of the Hessian of lam . m in v."""
        return self._mapped("hessian", [*self._arguments, self._lam], _nonzeros(self._hessian))

    @cached_property
    def square(self) -> Any:
        """Nonzeros of the lower triangle of J'J from the nonzeros of J."""
        return self._mapped("square", [self._slots], _nonzeros(self._square))

    def _mapped(self, name: str, inputs: list[Any], *outputs: Any) -> Any:
        function = _function(name, inputs, *outputs)
        return Mapped(function, self.term.columns) if self.term.columns >= FEWEST else function.map(self.term.columns)

    # ---- in numbers; arguments as `numbers` gives them

    @cached_property
    def valued(self) -> Columnwise:
        """Values m, (K m, C)."""
        return columnwise(_function("value", self._arguments, self._column), COMMON)

    @cached_property
    def linearised(self) -> Columnwise:
        """Values m and the nonzeros of their derivative in v."""
        return columnwise(_function("linearised", self._arguments, self._column, _nonzeros(self._jacobian)), COMMON)

    # ---- between columns, intervals and decisions

    def arguments(self, c: Any, theta: Any, parameters: Any, base: Any, data: Any) -> list[Any]:
        """What the mapped functions take at every column, as far as it is used."""
        ell, free, fixed, _, known, rows = self._used
        where = self.index[ell][:, self.term.interval].ravel(order="F").tolist()
        local = ca.reshape(c[where], len(ell), self.term.columns)
        repeated = [ca.repmat(vector[used], 1, self.term.columns) for vector, used in ((theta, free), (parameters, fixed))]
        return [local, *repeated, ca.MX(ca.DM(self._numbers)), _rows(base, known), _rows(data, rows)]

    def numbers(self, c: Array, theta: Array, parameters: Array, base: Array, data: Array) -> list[Array]:
        """The same of numbers, but what all columns have in common as vectors."""
        _, free, fixed, _, known, rows = self._used
        return [c[self._taken], theta[free], parameters[fixed], self._numbers, base[known], data[rows]]

    @cached_property
    def _taken(self) -> Index:
        return self.index[self._used[0]][:, self.term.interval]

    def scaled(self, jacobian: Any, scale: Any) -> Any:
        """Nonzeros of every column's Jacobian times its rows' scale."""
        return jacobian * _rows(scale, self.jacobian_rows.tolist())

    def to_intervals(self, of_columns: Any) -> Any:
        """Sums over the columns of every interval, (n, C) to (n, N)."""
        owner = self.term.interval
        if len(owner) == self.intervals and np.array_equal(owner, np.arange(self.intervals)):
            return of_columns
        ones = sp.csc_matrix((np.ones(len(owner)), (np.arange(len(owner)), owner)), shape=(len(owner), self.intervals))
        return of_columns @ _constant(ones)

    def to_decisions(self, of_columns: Any) -> Any:
        """Gradient (n + np,) from the gradients of every column, (local + np, C)."""
        of_intervals = self.to_intervals(of_columns)
        where = sp.csc_matrix(
            (np.ones(self.index.size), (self.index.ravel(order="F"), np.arange(self.index.size))),
            shape=(self.trajectory_size, self.index.size),
        )
        return ca.vertcat(_constant(where) @ ca.vec(of_intervals[: self.local, :]), ca.sum2(of_intervals[self.local :, :]))

    # ---- where the entries of small matrices stand in the large ones; shape (nonzeros, columns)

    def _decision(self, local: Index, interval: Index) -> Index:
        """Decision index of local positions (k,) in intervals (m,), shape (k, m)."""
        out = np.empty((len(local), len(interval)), dtype=np.int64)
        inside = local < self.local
        out[inside] = self.index[local[inside]][:, interval]
        out[~inside] = (self.trajectory_size + local[~inside] - self.local)[:, None]
        return out

    def hessian_entries(self) -> tuple[Index, Index]:
        """Row and column of every nonzero of every interval's Hessian."""
        return self._entries(self._hessian)

    def square_entries(self) -> tuple[Index, Index]:
        """The same for the Gauss-Newton blocks."""
        return self._entries(self._square)

    def _entries(self, small: Any) -> tuple[Index, Index]:
        rows, columns = _triplet(small)
        every = np.arange(self.intervals)
        return self._decision(rows, every), self._decision(columns, every)

    def jacobian_entries(self, offset: int) -> tuple[Index, Index]:
        """Constraint and decision index of every nonzero of every column's Jacobian."""
        m, count = self.term.target.shape
        rows = offset + self.jacobian_rows[:, None] + m * np.arange(count)[None, :]
        return rows, self._decision(self.jacobian_columns, self.term.interval)


class Scatter:
    """Adds blocks of entries into one sparse matrix whose pattern is their union."""

    def __init__(self) -> None:
        self._places: list[tuple[Index, Index]] = []
        self._values: list[Any] = []

    def add(self, rows: Index, columns: Index, values: Any) -> None:
        """Entries `values` (nonzeros, columns) at `rows`, `columns` of the same shape."""
        self._places.append((rows.ravel(order="F"), columns.ravel(order="F")))
        self._values.append(ca.vec(values))

    def matrix(self, rows: int, columns: int, row_unit: Any, column_unit: Any) -> Any:
        """The sum as a sparse matrix; a square one is symmetric and only its upper triangle is made."""
        if not self._places:
            return ca.MX(rows, columns)
        symmetric = row_unit is not None
        i, j = (np.concatenate(a) for a in zip(*self._places, strict=True))
        if symmetric:
            i, j = np.minimum(i, j), np.maximum(i, j)
        key = j * rows + i
        places, inverse = np.unique(key, return_inverse=True)
        row, column = places % rows, places // rows
        colind = np.searchsorted(column, np.arange(columns + 1))
        total, start = ca.MX.zeros(len(places)), 0
        for value in self._values:
            stop = start + value.shape[0]
            into = sp.csc_matrix((np.ones(stop - start), (inverse[start:stop], np.arange(stop - start))), shape=(len(places), stop - start))
            total += _constant(into) @ value
            start = stop
        total *= column_unit[column.tolist()]
        if symmetric:
            total *= row_unit[row.tolist()]
        return ca.MX(ca.Sparsity(rows, columns, colind.tolist(), row.tolist()), total)


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


def _rows(matrix: Any, rows: list[int]) -> Any:
    return matrix if rows == list(range(matrix.shape[0])) else matrix[rows, :]


def _triplet(matrix: Any) -> tuple[Index, Index]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _nonzeros(matrix: Any) -> Any:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _constant(matrix: Any) -> Any:
    csc = sp.csc_matrix(matrix)
    csc.sort_indices()
    return ca.MX(ca.DM(ca.Sparsity(*csc.shape, csc.indptr.tolist(), csc.indices.tolist()), csc.data))
