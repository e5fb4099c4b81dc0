"""From derivatives in e = [v; theta; mu] at the places of a column to derivatives in its local unknowns, and back to v.

    v_s = T(tau_s, h) l,     d/dl = sum over places of  T_s' d/dv_s

T has few entries in a row, so that derivatives by their nonzeros are sums of few products each: a sparse matrix that is the same for all
columns, times what differs from column to column.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .interpolation import Interpolation
from .polynomials import Array

Index = NDArray[np.int64]

NEARLY_EMPTY = 0.15  # of a matrix: with fewer entries that are not zero a sparse product is the faster one
STRIP = 256  # columns at a time: the products of all entries of T are many, and need not be kept


@dataclass(frozen=True)
class AtNodes:
    """The same places tau_s (S,) in every column; the columns' intervals are h (C,) long.

    T_s[a, j] = h^(power of j - order of a) c_s[a, j]: with unknowns and derivatives in units of these powers T is a number.
    """

    interpolation: Interpolation
    free: int
    nodes: Array
    h: Array

    @property
    def places(self) -> int:
        """S."""
        return len(self.nodes)

    @cached_property
    def entries(self) -> list[list[tuple[int, Array]]]:
        """Local unknowns or parameters that every e[a] depends on, and c_s (S,) of each."""
        ip = self.interpolation
        of_v: list[list[tuple[int, Array]]] = [[] for _ in range(ip.rows)]
        for e in ip.entries:
            of_v[e.row].append((e.column, e.differentiated(self.nodes)))
        return [*of_v, *([(ip.local + k, np.ones(self.places))] for k in range(self.free))]

    @cached_property
    def orders(self) -> list[int]:
        """Order of derivative of every e[a]."""
        order = {e.row: e.order for e in self.interpolation.entries}
        return [order.get(a, 0) for a in range(self.interpolation.rows + self.free)]

    @cached_property
    def powers(self) -> list[int]:
        """Power of h of every local unknown and parameter."""
        power = {e.column: e.power + e.order for e in self.interpolation.entries}
        return [power.get(j, 0) for j in range(self.interpolation.local + self.free)]

    def at(self, rows: Sequence[int], local: Array) -> Array:
        """Rows of v at all places, (rows, S C), one place after the other, from local unknowns (local, C)."""
        inside = self.scaled(local, self.powers[: self.interpolation.local])
        v = np.asarray(self._matrix(tuple(rows)) @ inside).reshape(len(rows), self.places, local.shape[1])
        return self.scaled(v, [-self.orders[a] for a in rows]).reshape(len(rows), self.places * local.shape[1])

    def _matrix(self, rows: tuple[int, ...]) -> Array | sp.csr_matrix:
        """The c of these rows of v, (rows S, local); sparse where it is nearly empty."""
        if rows not in self._matrices:
            c = np.zeros((len(rows), self.places, self.interpolation.local))
            for of_row, a in zip(c, rows, strict=True):
                for column, values in self.entries[a]:
                    of_row[:, column] += values
            flat = c.reshape(-1, self.interpolation.local)
            self._matrices[rows] = sp.csr_matrix(flat) if np.count_nonzero(flat) < NEARLY_EMPTY * flat.size else flat
        return self._matrices[rows]

    @cached_property
    def _matrices(self) -> dict[tuple[int, ...], Array | sp.csr_matrix]:
        return {}

    def slopes(self, pairs: tuple[Index, Index], moments: Array, m: int) -> OfNodes:
        """Of moments (S, K) of phi (m): from d phi_i / d e_a at pairs (i, a) to entries (k m + i, local unknown)."""
        K = moments.shape[1]
        terms = (
            (k * m + i, column, n, c * moments[:, k])
            for n, (i, a) in enumerate(zip(*pairs, strict=True))
            for column, c in self.entries[a]
            for k in range(K)
        )
        return self._lifted(terms, [-self.orders[a] for a in pairs[1]], lambda _, column: self.powers[column])

    def bends(self, pairs: tuple[Index, Index]) -> OfNodes:
        """From upper entries (a, b) of a second derivative in e to upper entries (local unknown, local unknown)."""
        terms = (
            (*where, n, factor * c_a * c_b)
            for n, (a, b) in enumerate(zip(*pairs, strict=True))
            for i, c_a in self.entries[a]
            for j, c_b in self.entries[b]
            for where, factor in _upper(a, b, i, j)
        )
        orders = [-self.orders[a] - self.orders[b] for a, b in zip(*pairs, strict=True)]
        return self._lifted(terms, orders, lambda i, j: self.powers[i] + self.powers[j])

    def _lifted(self, terms: Iterable[tuple[int, int, int, Array]], orders: list[int], power: Callable[[int, int], int]) -> OfNodes:
        kept = [(int(i), int(j), n * self.places + s, c[s]) for i, j, n, c in terms for s in np.flatnonzero(c)]
        places, row = in_order([(i, j) for i, j, _, _ in kept])
        shape = (len(places[0]), len(orders) * self.places)
        matrix = sp.csr_matrix(([c for *_, c in kept], (row, [column for _, _, column, _ in kept])), shape=shape)
        return OfNodes(self, matrix, places, orders, [power(i, j) for i, j in zip(*places, strict=True)])

    def scaled(self, values: Array, powers: Sequence[int]) -> Array:
        """Values (n, ..., C) times h to these powers (n,)."""
        if not any(powers):
            return values
        of_power = {power: self.h.astype(np.float64) ** power for power in set(powers)}
        factors = np.array([of_power[power] for power in powers]).reshape(len(powers), *(1,) * (values.ndim - 2), -1)
        return np.asarray(values * factors)


@dataclass(frozen=True)
class OfNodes:
    """Derivatives by their nonzeros: of e at all places, (n, S C), to those of a column, (nonzeros, C), which stand at `places`."""

    lift: AtNodes
    matrix: sp.csr_matrix
    places: tuple[Index, Index]
    orders: list[int]
    powers: list[int]

    def __call__(self, nonzeros: Array) -> Array:
        count = len(self.lift.h)
        shaped = self.lift.scaled(nonzeros.reshape(len(self.orders), self.lift.places, count), self.orders)
        return self.lift.scaled(np.asarray(self.matrix @ shaped.reshape(-1, count)), self.powers)


@dataclass(frozen=True)
class Anywhere:
    """A place of its own for every column, where T has the numbers `values` (`Interpolation.values`), (kinds, C).

    mu: where the derivatives of mu stand in (mu, local unknowns and parameters), by their nonzeros. `table` has what e hangs on.
    """

    interpolation: Interpolation
    free: int
    values: Array
    mu: tuple[Index, Index]

    def table(self, slopes: Array) -> Array:
        """The entries of T and of the derivative of mu, (nonzeros, C), at every column, and one for the parameters."""
        return np.vstack([self.values, np.ones((1, self.values.shape[1])), slopes])

    def entries(self, a: int) -> list[tuple[int, int]]:
        """Local unknowns or parameters that e[a] depends on, and where the table has by how much."""
        ip, kinds = self.interpolation, len(self.values)
        if a >= ip.rows + self.free:
            return [(int(j), kinds + 1 + n) for n, (q, j) in enumerate(zip(*self.mu, strict=True)) if q == a - ip.rows - self.free]
        if a >= ip.rows:
            return [(ip.local + a - ip.rows, kinds)]
        return [(e.column, kind) for e, kind in zip(ip.entries, ip.kinds[1], strict=True) if e.row == a]

    def at(self, rows: Sequence[int], local: Array) -> Array:
        """Rows of v, (rows, C), from local unknowns (local, C)."""
        out = np.zeros((len(rows), self.values.shape[1]))
        for v, a in zip(out, rows, strict=True):
            for j, t in self.entries(a):
                v += self.values[t] * local[j]
        return out

    def slopes(self, pairs: tuple[Index, Index]) -> OfPlaces:
        """From d phi_i / d e_a at pairs (i, a) to entries (i, local unknown)."""
        return self._gathered((i, j, n, (t,), 1.0) for n, (i, a) in enumerate(zip(*pairs, strict=True)) for j, t in self.entries(a))

    def bends(self, pairs: tuple[Index, Index]) -> OfPlaces:
        """From upper entries (a, b) of a second derivative in e to upper entries (local unknown, local unknown)."""
        return self._gathered(
            (*where, n, (s, t), factor)
            for n, (a, b) in enumerate(zip(*pairs, strict=True))
            for i, s in self.entries(a)
            for j, t in self.entries(b)
            for where, factor in _upper(a, b, i, j)
        )

    @staticmethod
    def _gathered(terms: Iterable[tuple[int, int, int, tuple[int, ...], float]]) -> OfPlaces:
        kept = list(terms)
        places, row = in_order([(int(i), int(j)) for i, j, *_ in kept])
        matrix = sp.csr_matrix(([c for *_, c in kept], (row, np.arange(len(kept)))), shape=(len(places[0]), len(kept)))
        of = [t for _, _, _, t, _ in kept]
        return OfPlaces(matrix, places, np.array([n for _, _, n, _, _ in kept], dtype=np.int64), np.array(of, dtype=np.int64).T)


@dataclass(frozen=True)
class OfPlaces:
    """Derivatives by their nonzeros: of e, (n, C), to those of a column, (nonzeros, C), which stand at `places`."""

    matrix: sp.csr_matrix
    places: tuple[Index, Index]
    own: Index
    of_table: Index

    def __call__(self, nonzeros: Array, table: Array) -> Array:
        out = np.empty((self.matrix.shape[0], nonzeros.shape[1]))
        for first in range(0, nonzeros.shape[1], STRIP):
            strip = slice(first, first + STRIP)
            product = nonzeros[self.own, strip]
            for entries in self.of_table:
                product *= table[entries, strip]
            out[:, strip] = self.matrix @ product
        return out


def in_order(entries: Sequence[tuple[int, int]]) -> tuple[tuple[Index, Index], Index]:
    """The different ones of these places (row, column), column by column, and which of them each is."""
    if not entries:
        return (np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)), np.empty(0, dtype=np.int64)
    places, which = np.unique(np.array(entries, dtype=np.int64)[:, ::-1], axis=0, return_inverse=True)
    return (places[:, 1].copy(), places[:, 0].copy()), which.ravel()


def _upper(a: int, b: int, i: int, j: int) -> list[tuple[tuple[int, int], float]]:
    """Where entry (a, b) of a symmetric matrix adds to (i, j) of the upper triangle of the lifted one, and how often."""
    if a == b:
        return [((i, j), 1.0)] if i <= j else []
    return [((min(i, j), max(i, j)), 2.0 if i == j else 1.0)]
