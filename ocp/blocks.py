"""One term of a program at all its columns: values and small derivatives in v = [l_i; theta], and where their entries stand in large ones.

What the model says is differentiated at a point (`pointwise.py`), once for all programs that ask for it; what a column makes of its
points, T and moments, is linear and comes as a sparse matrix (`lifting.py`). A small matrix of every column stands in one column by its
nonzeros, whose places are `jacobian_rows/columns`, `bent_places`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .interpolation import Interpolation
from .lifting import Anywhere, AtNodes, OfNodes, OfPlaces, in_order
from .pointwise import pointwise
from .polynomials import Array
from .terms import Term

Index = NDArray[np.int64]
NOTHING: tuple[Index, Index] = (np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))


class Block(ABC):
    """One term's columns. `local` (local, C) below: local unknowns of the columns' intervals, less the reference's; theta (np,), base, data
    as in `Values`.

    `jacobian_rows`, `jacobian_columns`: places of the nonzeros of the derivative of the values m (K m,) in v; `bent_places`: of the upper
    triangle of the second one of lam . m.
    """

    def __init__(self, interpolation: Interpolation, index: Index, term: Term) -> None:
        self.term, self.index, self.local = term, index, interpolation.local
        self.trajectory_size = int(index.max()) + 1

    jacobian_rows: Index
    jacobian_columns: Index

    @property
    @abstractmethod
    def curved(self) -> bool:
        """Whether the values are not linear in v."""

    @property
    @abstractmethod
    def bent_places(self) -> tuple[Index, Index]:
        """See there."""

    @abstractmethod
    def valued(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> Array:
        """Values m, (K m, C)."""

    @abstractmethod
    def linearised(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> tuple[Array, Array]:
        """Values m and the nonzeros of their derivative in v."""

    @abstractmethod
    def bent(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array, lam: Array) -> Array:
        """Nonzeros of the second derivative of lam . m in v, lam (K m, C)."""

    @cached_property
    def intervals(self) -> Index:
        """Decision index of the local unknowns of every column's interval, (local, C)."""
        return np.asarray(self.index[:, self.term.interval])

    def jacobian_entries(self, offset: int) -> tuple[Index, Index]:
        """Constraint and decision index of every nonzero of every column's Jacobian, (nonzeros, C)."""
        m, count = self.term.target.shape
        rows = offset + self.jacobian_rows[:, None] + m * np.arange(count)[None, :]
        return rows, self._decision(self.jacobian_columns, self.term.interval)

    def _decision(self, local: Index, interval: Index) -> Index:
        """Decision index of local positions (k,) in intervals (m,), shape (k, m)."""
        out = np.empty((len(local), len(interval)), dtype=np.int64)
        inside = local < self.local
        out[inside] = self.index[local[inside]][:, interval]
        out[~inside] = (self.trajectory_size + local[~inside] - self.local)[:, None]
        return out


class Inside(Block):
    """Columns over whole intervals, with the same places in each."""

    def __init__(self, interpolation: Interpolation, index: Index, steps: Array, free: Sequence[int], term: Term) -> None:
        super().__init__(interpolation, index, term)
        nodes = np.asarray(term.nodes, dtype=np.float64)
        self._point = pointwise(term.function, free)
        self._lift = AtNodes(interpolation, len(free), nodes, steps[term.interval])
        self._moments = np.eye(len(nodes)) if term.moments is None else np.asarray(term.moments, dtype=np.float64)
        self._slopes = self._lift.slopes(self._point.pairs, self._moments, self._point.rows)
        self.jacobian_rows, self.jacobian_columns = self._slopes.places

    @cached_property
    def _bends(self) -> OfNodes:
        return self._lift.bends(self._point.bends)

    @property
    def curved(self) -> bool:
        return bool(len(self._point.bends[0]))

    @property
    def bent_places(self) -> tuple[Index, Index]:
        return self._bends.places

    def valued(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> Array:
        (phi,) = self._point.valued(*self._arguments(local, theta, parameters, base, data))
        return self._moments_of(phi)

    def linearised(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> tuple[Array, Array]:
        phi, nonzeros = self._point.linearised(*self._arguments(local, theta, parameters, base, data))
        return self._moments_of(phi), self._slopes(nonzeros)

    def bent(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array, lam: Array) -> Array:
        # of place s: sum over k of moments[s, k] lam_k
        K, m = self._moments.shape[1], self._point.rows
        weights = np.einsum("sk,kic->isc", self._moments, lam.reshape(K, m, -1)).reshape(m, -1)
        return self._bends(self._point.bent(*self._arguments(local, theta, parameters, base, data), weights)[0])

    def _arguments(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> list[Array]:
        rows, places, count = self._point.looked_at, self._lift.places, self.term.columns
        v = self._lift.at(rows, local) + _side_by_side(base, places)[rows]
        return self._point.arguments(v, theta, parameters, _side_by_side(data, places).reshape(-1, places * count))

    def _moments_of(self, phi: Array) -> Array:
        m = self._point.rows
        moments: Array = np.einsum("sk,isc->kic", self._moments, phi.reshape(m, self._lift.places, -1))
        return moments.reshape(-1, self.term.columns)


class Own(Block):
    """Columns with a place of their own each, which may also take moments mu of their whole interval (`Within`)."""

    def __init__(self, interpolation: Interpolation, index: Index, steps: Array, free: Sequence[int], term: Term) -> None:
        super().__init__(interpolation, index, term)
        self._rows, self._inner, within = interpolation.rows, None, term.within
        if within is not None:
            inner = replace(term, function=within.function, nodes=within.nodes, moments=within.weights, within=None)
            self._inner = Inside(interpolation, index, steps, free, inner)
            self._further = within.function.size1_in(3) * len(within.nodes)  # rows of the data that belong to the places inside
        mu = 0 if within is None else within.weights.shape[1] * within.function.size1_out(0)
        self._point = pointwise(term.function, free, mu)
        tau = term.tau if term.tau is not None else np.zeros(term.columns)
        values = interpolation.values(np.asarray(tau, dtype=np.float64), steps[term.interval])
        of_mu = NOTHING if self._inner is None else (self._inner.jacobian_rows, self._inner.jacobian_columns)
        self._lift = Anywhere(interpolation, len(free), values, of_mu)
        self._slopes = self._lift.slopes(self._point.pairs)
        self.jacobian_rows, self.jacobian_columns = self._slopes.places

    @cached_property
    def _bends(self) -> OfPlaces:
        return self._lift.bends(self._point.bends)

    @property
    def curved(self) -> bool:
        return bool(len(self._point.bends[0])) or (self._inner is not None and self._inner.curved)

    @property
    def bent_places(self) -> tuple[Index, Index]:
        return self._bends.places if self._inner is None else self._both[0]

    @cached_property
    def _both(self) -> tuple[tuple[Index, Index], sp.csr_matrix]:
        """Places of the second derivative with those of mu, and what adds the nonzeros of both there."""
        inner = NOTHING if self._inner is None else self._inner.bent_places
        pairs = [(i, j) for part in (self._bends.places, inner) for i, j in zip(*part, strict=True)]
        places, which = in_order(pairs)
        return places, sp.csr_matrix((np.ones(len(pairs)), (which, np.arange(len(pairs)))), shape=(len(places[0]), len(pairs)))

    def valued(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> Array:
        own, inside = self._parts(base, data)
        mu = None if self._inner is None else self._inner.valued(local, theta, parameters, *inside)
        return self._point.valued(*self._arguments(local, theta, parameters, *own, mu))[0]

    def linearised(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array) -> tuple[Array, Array]:
        (own, inside), mu, slopes = self._parts(base, data), None, np.empty((0, self.term.columns))
        if self._inner is not None:
            mu, slopes = self._inner.linearised(local, theta, parameters, *inside)
        phi, nonzeros = self._point.linearised(*self._arguments(local, theta, parameters, *own, mu))
        return phi, self._slopes(nonzeros, self._lift.table(slopes))

    def bent(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array, lam: Array) -> Array:
        (own, inside), mu, slopes = self._parts(base, data), None, np.empty((0, self.term.columns))
        if self._inner is not None:
            mu, slopes = self._inner.linearised(local, theta, parameters, *inside)
        arguments = self._arguments(local, theta, parameters, *own, mu)
        found = self._bends(self._point.bent(*arguments, lam)[0], self._lift.table(slopes))
        if self._inner is None or mu is None:
            return found
        # curvature of mu itself, by how much lam . phi hangs on it
        (i, a), nonzeros = self._point.pairs, self._point.linearised(*arguments)[1]
        first = self._point.unknowns - mu.shape[0]
        of_mu = np.zeros_like(mu)
        for row, entry, slope in zip(i, a, nonzeros, strict=True):
            if entry >= first:
                of_mu[entry - first] += lam[row] * slope
        return np.asarray(self._both[1] @ np.vstack([found, self._inner.bent(local, theta, parameters, *inside, of_mu)]))

    def _parts(self, base: Array, data: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Base and data of the columns' own places, and of those inside."""
        if self._inner is None:
            return (base, data), (base[:0], data[:0])
        own = data.shape[0] - self._further
        return (base[: self._rows], data[:own]), (base[self._rows :], data[own:])

    def _arguments(self, local: Array, theta: Array, parameters: Array, base: Array, data: Array, mu: Array | None) -> list[Array]:
        rows = self._point.looked_at
        v = self._lift.at(rows, local) + base[rows]
        return self._point.arguments(v, theta, parameters, data if mu is None else np.vstack([data, mu]))


def made(interpolation: Interpolation, index: Index, steps: Array, free: Sequence[int], term: Term) -> Block:
    """The block of a term."""
    return (Own if term.nodes is None else Inside)(interpolation, index, steps, free, term)


def _side_by_side(rows: Array, places: int) -> Array:
    """What stands one place below the other, (S n, C), one place after the other: (n, S C)."""
    return np.swapaxes(rows.reshape(places, rows.shape[0] // places, -1), 0, 1).reshape(rows.shape[0] // places, -1)
