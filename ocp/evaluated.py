"""A program's terms in numbers: rows, their derivatives, and the matrices that are made of these.

A term's derivative is a stack of small dense matrices, one a column, in the local unknowns of its interval and the parameters. Summed over
the columns of every interval, J'J is one small matrix an interval; in time order these overlap at the knots only. Local unknowns stand in
the order of the decisions: what is above the diagonal of a small matrix is above that of the large one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .blocks import made
from .polynomials import Array

if TYPE_CHECKING:
    from .nlp import Nlp, Values

Index = NDArray[np.int64]


@dataclass(frozen=True)
class Linearised:
    """Rows r (K m, C) of one term and their derivative in X: J (C, K m, local + np)."""

    number: int
    r: Array
    J: Array


@dataclass(frozen=True, kw_only=True)
class _Upper:
    """Entries (row, column) of an upper triangle; entry `inverse` is where those at `of` of every interval's matrix are added, in order."""

    row: Index
    column: Index
    inverse: Index
    of: tuple[Index, Index]


class Evaluated:
    """Terms of a program at X, with its numbers."""

    def __init__(self, nlp: Nlp) -> None:
        self._nlp = nlp
        self._blocks = [made(nlp.interpolation, nlp.index, nlp.steps, nlp.free, term) for term in nlp.terms]

    @cached_property
    def linear_constraints(self) -> bool:
        """Whether no constraint bends."""
        return not any(block.curved for block in self._blocks if block.term.equality)

    def curved(self, number: int) -> bool:
        """Whether a term's derivative hangs on X."""
        return self._blocks[number].curved

    def rows(self, X: Array, values: Values) -> list[Array]:
        """The rows r = (m - target) * scale of every term, each (K m, C)."""
        return [self._row(number, X, values) for number in range(len(self._blocks))]

    def cost(self, X: Array, values: Values) -> float:
        """1/2 sum r^2 over the terms that are no constraints."""
        terms = enumerate(self._nlp.terms)
        with np.errstate(over="ignore", invalid="ignore"):
            return sum(float(np.sum(self._row(number, X, values) ** 2)) / 2 for number, term in terms if not term.equality)

    def constraints(self, X: Array, values: Values) -> Array:
        """The rows that must vanish, one term after the other, column by column, (constraint_count,)."""
        rows = [self._row(k, X, values).ravel(order="F") for k, term in enumerate(self._nlp.terms) if term.equality]
        return np.concatenate(rows) if rows else np.empty(0)

    def _row(self, number: int, X: Array, values: Values) -> Array:
        m = self._blocks[number].valued(*self._arguments(number, X, values))
        with np.errstate(over="ignore", invalid="ignore"):  # a step may lead to where the model has no value: the cost is none then
            return np.asarray((m - values.target[number]) * values.scale[number], dtype=np.float64)

    def derivative(self, number: int, X: Array, values: Values) -> Array:
        """Derivative of one term's values m, not scaled, in the local unknowns and parameters, (C, K m, local + np)."""
        return self._dense(number, self._blocks[number].linearised(*self._arguments(number, X, values))[1])

    def linearised(self, number: int, X: Array, values: Values) -> Linearised:
        """Rows of one term and their derivative, in the units of the program."""
        m, nonzeros = self._blocks[number].linearised(*self._arguments(number, X, values))
        scale, block = values.scale[number], self._blocks[number]
        nonzeros = nonzeros * scale[block.jacobian_rows] * self._units(values)[block.jacobian_columns][:, block.term.interval]
        return Linearised(number, (m - values.target[number]) * scale, self._dense(number, nonzeros))

    def _arguments(self, number: int, X: Array, values: Values) -> tuple[Array, Array, Array, Array, Array]:
        step, n = values.unit * X, self._nlp.trajectory_size
        theta = values.parameters[list(self._nlp.free)] + step[n:]
        local = step[:n][self._blocks[number].intervals]
        return local, theta, values.parameters, values.base[number], values.data[number]

    def _dense(self, number: int, nonzeros: Array) -> Array:
        block, term = self._blocks[number], self._nlp.terms[number]
        width = self._nlp.interpolation.local + len(self._nlp.free)
        out = np.zeros((term.columns, term.target.shape[0] * width))
        out[:, block.jacobian_rows * width + block.jacobian_columns] = nonzeros.T
        return out.reshape(term.columns, term.target.shape[0], width)

    def _units(self, values: Values) -> Array:
        """Units of the local unknowns and parameters of every interval, (local + np, N)."""
        n, count = self._nlp.trajectory_size, self._nlp.index.shape[1]
        return np.vstack([values.unit[self._nlp.index], np.repeat(values.unit[n:, None], count, axis=1)])

    # ---- sums over terms

    def gradient(self, parts: Sequence[Linearised]) -> Array:
        """J'r, (n + np,)."""
        return self._summed(parts, [np.einsum("cri,rc->ic", part.J, part.r) for part in parts])

    def diagonal(self, parts: Sequence[Linearised]) -> Array:
        """Diagonal of J'J, (n + np,)."""
        return self._summed(parts, [np.einsum("cri,cri->ic", part.J, part.J) for part in parts])

    def _summed(self, parts: Sequence[Linearised], of_columns: Sequence[Array]) -> Array:
        """Sums (n + np,) over the columns of terms, each (local + np, C)."""
        out = np.zeros(self._nlp.size)
        for part, values in zip(parts, of_columns, strict=True):
            where = self._where[:, self._nlp.terms[part.number].interval]
            out += np.bincount(where.ravel(), weights=values.ravel(), minlength=self._nlp.size)
        return out

    def squares(self, parts: Sequence[Linearised]) -> Array:
        """J'J of every interval, (N, local + np, local + np)."""
        width, count = self._where.shape
        out = np.zeros((count, width, width))
        for part in parts:
            self._add(out, part.number, np.swapaxes(part.J, 1, 2) @ part.J)
        return out

    def _bends(self, parts: Sequence[Linearised], X: Array, values: Values, weight: float, multipliers: Array) -> Array:
        """Upper triangles of what curvature adds to weight * J'J of every interval, (N, local + np, local + np).

        sum weight * r . d2r + lambda . d2c        multipliers (constraint_count,): lambda
        """
        width, count = self._where.shape
        out, units, offset = np.zeros((count, width, width)), self._units(values), 0
        for part in parts:
            block, scale = self._blocks[part.number], values.scale[part.number]
            lam = weight * part.r * scale
            if block.term.equality:
                stop = offset + part.r.size
                lam, offset = multipliers[offset:stop].reshape(part.r.shape, order="F") * scale, stop
            if not block.curved:
                continue
            nonzeros = block.bent(*self._arguments(part.number, X, values), lam)
            unit, (i, j) = units[:, block.term.interval], block.bent_places
            H = np.zeros((block.term.columns, width, width))
            H[:, i, j] = (nonzeros * unit[i] * unit[j]).T
            self._add(out, part.number, H)
        return out

    def _add(self, out: Array, number: int, of_columns: Array) -> None:
        """Adds to every interval's matrix, out (N, w, w), those of a term's columns there, (C, w, w)."""
        owner, count = self._nlp.terms[number].interval, len(out)
        if len(owner) == count and np.array_equal(owner, np.arange(count)):
            out += of_columns
        else:
            ones = sp.csr_matrix((np.ones(len(owner)), (owner, np.arange(len(owner)))), shape=(count, len(owner)))
            out += (ones @ of_columns.reshape(len(owner), -1)).reshape(out.shape)

    # ---- fixed patterns: where a solver wants the entries

    def upper_places(self, exact: bool) -> tuple[Index, Index]:
        """Row and column of every entry of the Hessian's upper triangle, column by column; exact: beyond Gauss-Newton's."""
        places = self._upper_exact if exact else self._upper_of_squares
        return places.row, places.column

    def upper_entries(self, parts: Sequence[Linearised], X: Array, values: Values, weight: float, multipliers: Array, exact: bool) -> Array:
        """The entries there of the Hessian of weight * cost + multipliers . constraints; parts: all terms linearised at X."""
        matrices = weight * self.squares([part for part in parts if not self._nlp.terms[part.number].equality])
        if exact:
            matrices += self._bends(parts, X, values, weight, multipliers)
        places = self._upper_exact if exact else self._upper_of_squares
        entries = matrices[:, places.of[0], places.of[1]].ravel()
        return np.bincount(places.inverse, weights=entries, minlength=len(places.row))

    @cached_property
    def _upper_of_squares(self) -> _Upper:
        return self._upper(exact=False)

    @cached_property
    def _upper_exact(self) -> _Upper:
        return self._upper(exact=True)

    def _upper(self, exact: bool) -> _Upper:
        width, size = len(self._where), self._nlp.size
        there = np.zeros((width, width), dtype=bool)
        for block in self._blocks:
            if not block.term.equality:
                J = np.zeros((block.term.target.shape[0], width), dtype=bool)
                J[block.jacobian_rows, block.jacobian_columns] = True
                there |= (J.T.astype(np.int64) @ J) > 0
            if exact and block.curved:
                there[block.bent_places] = True
        i, j = np.nonzero(np.triu(there))
        places, inverse = np.unique(self._where[j].T.ravel() * size + self._where[i].T.ravel(), return_inverse=True)
        return _Upper(row=places % size, column=places // size, inverse=inverse.ravel(), of=(i, j))

    @property
    def jacobian_places(self) -> tuple[Index, Index]:
        """Row and column of every entry of the constraints' Jacobian, column by column."""
        return self._of_constraints[0], self._of_constraints[1]

    def jacobian_entries(self, parts: Sequence[Linearised]) -> Array:
        """The entries there of all constraints, linearised."""
        return np.asarray(self._entries(parts)[self._of_constraints[2]])

    @cached_property
    def _of_constraints(self) -> tuple[Index, Index, Index]:
        row, column, _ = self._triplets([k for k, term in enumerate(self._nlp.terms) if term.equality])
        order = np.lexsort((row, column))
        return row[order], column[order], order

    def upper(self, squares: Array) -> sp.csc_matrix:
        """Upper triangle of the sum of the intervals' matrices, (n + np, n + np)."""
        size, where = self._nlp.size, self._where.T
        row, column = np.broadcast_arrays(where[:, :, None], where[:, None, :])
        keep = (squares != 0) & (row <= column)
        return sp.csc_matrix(sp.coo_matrix((squares[keep], (row[keep], column[keep])), shape=(size, size)))

    def jacobian(self, parts: Sequence[Linearised]) -> sp.csc_matrix:
        """All rows of some terms, one after the other, column by column."""
        row, column, count = self._triplets([part.number for part in parts])
        return sp.csc_matrix(sp.coo_matrix((self._entries(parts), (row, column)), shape=(count, self._nlp.size)))

    def _triplets(self, numbers: Sequence[int]) -> tuple[Index, Index, int]:
        """Row and decision of every entry of the Jacobian of some terms, one after the other, and how many rows these have."""
        rows, columns, offset = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)], 0
        for number in numbers:
            at, to = self._blocks[number].jacobian_entries(offset)
            rows.append(at.T.ravel())
            columns.append(to.T.ravel())
            offset += self._nlp.terms[number].target.size
        return np.concatenate(rows), np.concatenate(columns), offset

    def _entries(self, parts: Sequence[Linearised]) -> Array:
        blocks = [self._blocks[part.number] for part in parts]
        entries = [part.J[:, block.jacobian_rows, block.jacobian_columns].ravel() for part, block in zip(parts, blocks, strict=True)]
        return np.concatenate([np.empty(0), *entries])

    @cached_property
    def _where(self) -> Index:
        """Decision index of the local unknowns and parameters of every interval, (local + np, N)."""
        n, count = self._nlp.trajectory_size, self._nlp.index.shape[1]
        own = np.repeat(n + np.arange(len(self._nlp.free))[:, None], count, axis=1)
        return np.asarray(np.vstack([self._nlp.index, own]), dtype=np.int64)
