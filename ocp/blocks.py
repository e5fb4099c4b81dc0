"""Small dense derivative blocks of one term, and how they add up to large sparse matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .interpolation import Interpolation
from .polynomials import Array
from .terms import Term

Index = NDArray[np.int64]


class Block:
    """One term's function in the unknowns it depends on, v = [l_i; theta], differentiated for one point and mapped over all.

    Matrices over points or rows are stored with one column per point (or row group); a small matrix stands in its column
    by its nonzeros, whose places are `jacobian_rows/columns` and `hessian_rows/columns`.
    """

    def __init__(self, interpolation: Interpolation, index: Index, steps: Array, free: Sequence[int], term: Term) -> None:
        self.term, self.index, self.intervals = term, index, index.shape[1]
        self.local, self.free = interpolation.local, len(free)
        self.trajectory_size = int(index.max()) + 1
        kinds = interpolation.values(term.tau, steps[term.interval])
        ell, theta, p = ca.SX.sym("l", self.local), ca.SX.sym("theta", self.free), ca.SX.sym("p", term.function.size1_in(1))
        basis, data = ca.SX.sym("T", len(kinds)), ca.SX.sym("d", term.data.shape[0])
        base = ca.SX.sym("v", interpolation.rows)
        values = ca.SX(base)
        for entry, kind in zip(interpolation.entries, interpolation.kinds[1], strict=True):
            values[entry.row] += basis[kind] * ell[entry.column]
        merged = ca.SX(p)
        for k, i in enumerate(free):
            merged[i] = theta[k]
        phi = term.function(values, merged, data)
        # what the function does not look at is not carried to its points
        self._used = [_used(phi, s) for s in (ell, theta, p, basis, base, data)]
        self._basis = ca.MX(ca.DM(kinds[self._used[3]]))
        arguments = [s[used] for s, used in zip((ell, theta, p, basis, base, data), self._used, strict=True)]
        v, lam = ca.vertcat(ell, theta), ca.SX.sym("lam", phi.shape[0])
        jac, grad = ca.jacobian(phi, v), ca.jtimes(phi, v, lam, True)
        hess = ca.tril(ca.hessian(ca.dot(lam, phi), v)[0])
        self.value = self._mapped("value", arguments, phi)
        self.jacobian = self._mapped("jacobian", arguments, _nonzeros(jac))
        self.adjoint = self._mapped("adjoint", [*arguments, lam], ca.densify(grad))
        self.hessian = self._mapped("hessian", [*arguments, lam], _nonzeros(hess))
        self.jacobian_rows, self.jacobian_columns = (np.array(a, dtype=np.int64) for a in jac.sparsity().get_triplet())
        self.hessian_rows, self.hessian_columns = (np.array(a, dtype=np.int64) for a in hess.sparsity().get_triplet())
        self.curved = hess.nnz() > 0
        self._square()

    def _mapped(self, name: str, inputs: list[Any], output: Any) -> Any:
        return ca.Function(name, inputs, [output], {"cse": True}).map(self.term.points)

    def _square(self) -> None:
        """J'J of one row group: its lower triangle's pattern and a mapped function from the nonzeros of J."""
        pattern = ca.Sparsity.triplet(
            self.term.target.shape[0], self.local + self.free, self.jacobian_rows.tolist(), self.jacobian_columns.tolist()
        )
        nonzeros = ca.SX.sym("j", pattern.nnz())
        J = ca.SX(pattern, nonzeros)
        square = ca.tril(J.T @ J)
        self._gauss_newton = ca.Function("square", [nonzeros], [_nonzeros(square)]).map(self.term.rows)
        self._square_rows, self._square_columns = (np.array(a, dtype=np.int64) for a in square.sparsity().get_triplet())

    # ---- between points, rows, intervals and decisions

    def arguments(self, c: Any, theta: Any, parameters: Any, base: Any, data: Any) -> list[Any]:
        """What the mapped functions take at every point, as far as it is used: local unknowns, parameters, basis, reference and data."""
        ell, free, fixed, _, known, rows = self._used
        where = self.index[ell][:, self.term.interval].ravel(order="F").tolist()
        local = ca.reshape(c[where], len(ell), self.term.points)
        columns = [ca.repmat(vector[used], 1, self.term.points) for vector, used in ((theta, free), (parameters, fixed))]
        return [local, *columns, self._basis, base[known, :], data[rows, :]]

    def gathered(self, of_points: Any) -> Any:
        """Sums over the points of every row."""
        return of_points if self.term.gather is None else of_points @ _constant(self.term.gather)

    def scattered(self, of_rows: Any) -> Any:
        """Every row's value at each of its points: the transpose of `gathered`."""
        return of_rows if self.term.gather is None else of_rows @ _constant(self.term.gather.T)

    def scaled(self, jacobian: Any, scale: Any) -> Any:
        """Nonzeros of every row's Jacobian times that row's scale."""
        return jacobian * scale[self.jacobian_rows.tolist(), :]

    def gauss_newton(self, jacobian: Any) -> Any:
        """Nonzeros of the sum of J'J over the rows of every interval."""
        return self._gauss_newton(jacobian) @ _constant(_summation(self.term.row_interval, self.intervals))

    @property
    def points_to_intervals(self) -> Any:
        """(M, N) matrix of ones that sums over the points of every interval."""
        return _constant(_summation(self.term.interval, self.intervals))

    def to_decisions(self, of_points: Any) -> Any:
        """Gradient (n + np,) from the gradients of every point, (local + np, M)."""
        of_intervals = of_points @ self.points_to_intervals
        where = sp.csc_matrix(
            (np.ones(self.index.size), (self.index.ravel(order="F"), np.arange(self.index.size))), shape=(self.trajectory_size, self.index.size)
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
        """Row and column of every nonzero of every interval's block."""
        every = np.arange(self.intervals)
        return self._decision(self.hessian_rows, every), self._decision(self.hessian_columns, every)

    def square_entries(self) -> tuple[Index, Index]:
        """The same for the Gauss-Newton blocks."""
        every = np.arange(self.intervals)
        return self._decision(self._square_rows, every), self._decision(self._square_columns, every)

    def jacobian_entries(self, offset: int) -> tuple[Index, Index]:
        """Constraint and decision index of every nonzero of every row group."""
        m, count = self.term.target.shape
        rows = offset + self.jacobian_rows[:, None] + m * np.arange(count)[None, :]
        return rows, self._decision(self.jacobian_columns, self.term.row_interval)


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


def _used(expression: Any, symbols: Any) -> list[int]:
    """Which of the symbols an expression depends on."""
    pattern = ca.jacobian_sparsity(expression, symbols)
    return sorted(set(pattern.get_col()))


def _nonzeros(matrix: Any) -> Any:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _summation(group: Index, groups: int) -> sp.csc_matrix:
    return sp.csc_matrix((np.ones(len(group)), (np.arange(len(group)), group)), shape=(len(group), groups))


def _constant(matrix: Any) -> Any:
    csc = sp.csc_matrix(matrix)
    csc.sort_indices()
    return ca.MX(ca.DM(ca.Sparsity(*csc.shape, csc.indptr.tolist(), csc.indices.tolist()), csc.data))
