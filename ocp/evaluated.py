"""A program's terms in numbers: rows, their derivatives, and the matrices that are made of these.

A term's derivative is a stack of small dense matrices, one a column, in the local unknowns of its interval and the parameters. Summed over
the columns of every interval, J'J is one small matrix an interval; in time order these overlap at the knots only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .blocks import Block
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


class Evaluated:
    """Terms of a program at X, with its numbers."""

    def __init__(self, nlp: Nlp, blocks: Sequence[Block]) -> None:
        self._nlp, self._blocks = nlp, blocks

    def rows(self, X: Array, values: Values) -> list[Array]:
        """The rows r = (m - target) * scale of every term, each (K m, C)."""
        return [self._row(number, X, values) for number in range(len(self._blocks))]

    def cost(self, X: Array, values: Values) -> float:
        """1/2 sum r^2 over the terms that are no constraints."""
        terms = enumerate(self._nlp.terms)
        return sum(float(np.sum(self._row(number, X, values) ** 2)) / 2 for number, term in terms if not term.equality)

    def _row(self, number: int, X: Array, values: Values) -> Array:
        (m,) = self._blocks[number].valued(*self._arguments(number, X, values))
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

    def _arguments(self, number: int, X: Array, values: Values) -> list[Array]:
        step, n = values.unit * X, self._nlp.trajectory_size
        theta = values.parameters[list(self._nlp.free)] + step[n:]
        return self._blocks[number].numbers(step[:n], theta, values.parameters, values.base[number], values.data[number])

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
            owner = self._nlp.terms[part.number].interval
            H = np.swapaxes(part.J, 1, 2) @ part.J
            if len(owner) == count and np.array_equal(owner, np.arange(count)):
                out += H
            else:
                ones = sp.csr_matrix((np.ones(len(owner)), (owner, np.arange(len(owner)))), shape=(count, len(owner)))
                out += (ones @ H.reshape(len(owner), -1)).reshape(out.shape)
        return out

    def upper(self, squares: Array) -> sp.csc_matrix:
        """Upper triangle of the sum of the intervals' matrices, (n + np, n + np)."""
        size, where = self._nlp.size, self._where.T
        row, column = np.broadcast_arrays(where[:, :, None], where[:, None, :])
        keep = (squares != 0) & (row <= column)
        return sp.csc_matrix(sp.coo_matrix((squares[keep], (row[keep], column[keep])), shape=(size, size)))

    def jacobian(self, parts: Sequence[Linearised]) -> sp.csc_matrix:
        """All rows of some terms, one after the other, column by column."""
        rows, columns, entries, offset = [], [], [], 0
        for part in parts:
            block, m = self._blocks[part.number], part.r.shape[0]
            at, to = block.jacobian_entries(offset)
            rows.append(at.T.ravel())
            columns.append(to.T.ravel())
            entries.append(part.J[:, block.jacobian_rows, block.jacobian_columns].ravel())
            offset += m * part.r.shape[1]
        if not parts:
            return sp.csc_matrix((0, self._nlp.size))
        triplets = (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns)))
        return sp.csc_matrix(sp.coo_matrix(triplets, shape=(offset, self._nlp.size)))

    @cached_property
    def _where(self) -> Index:
        """Decision index of the local unknowns and parameters of every interval, (local + np, N)."""
        n, count = self._nlp.trajectory_size, self._nlp.index.shape[1]
        own = np.repeat(n + np.arange(len(self._nlp.free))[:, None], count, axis=1)
        return np.asarray(np.vstack([self._nlp.index, own]), dtype=np.int64)
