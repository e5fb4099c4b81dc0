"""How the unknowns of one mesh interval give states, their derivatives, algebraic variables and residual forces in it.

Local unknowns of interval i, in this order (both transcriptions):

    l_i = [ x(t_i) | interior_i | x(t_(i+1)) ]                     nx + n_interior + nx of them

Inside the interval everything is linear in them, with coefficients that depend on the place tau = (t - t_i)/h alone:

    [dx; x; z; w](tau) = T(tau, h) l_i

`Interpolation` keeps the fixed pattern of T and fills its entries for any number of points at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from .polynomials import Array, cardinal_basis, hermite_basis, lagrange_basis, legendre, radau


@dataclass(frozen=True, kw_only=True)
class Entry:
    """T[row, column] = d^order/dtau^order polynomial(tau) * h^power."""

    row: int
    column: int
    polynomial: Polynomial
    order: int
    power: int

    @cached_property
    def differentiated(self) -> Polynomial:
        """d^order/dtau^order polynomial."""
        return self.polynomial.deriv(self.order) if self.order else self.polynomial

    def at(self, tau: Array) -> Array:
        """The differentiated polynomial at any places, in their precision."""
        out = np.zeros_like(tau)
        for a in self.differentiated.coef[::-1]:
            out *= tau
            out += a
        return out


@dataclass(frozen=True, kw_only=True)
class Interpolation:
    """The map T(tau, h) of one transcription; rows [dx (nx) | x (nx) | z (nz) | w (nw)]."""

    states: int
    algebraics: int
    forces: int
    interior: int
    entries: tuple[Entry, ...]

    @property
    def local(self) -> int:
        """Number of local unknowns."""
        return 2 * self.states + self.interior

    @property
    def rows(self) -> int:
        """Number of rows of T."""
        return 2 * self.states + self.algebraics + self.forces

    @cached_property
    def kinds(self) -> tuple[tuple[Entry, ...], tuple[int, ...]]:
        """The entries that differ in value, and for every entry of T which of these it is."""
        different: dict[tuple[tuple[float, ...], int, int], int] = {}
        first: list[Entry] = []
        kind = []
        for e in self.entries:
            key = (tuple(float(a) for a in e.polynomial.coef), e.order, e.power)
            if key not in different:
                different[key] = len(first)
                first.append(e)
            kind.append(different[key])
        return tuple(first), tuple(kind)

    def values(self, tau: Array, h: Array) -> Array:
        """The different entries of T at M places, (len(kinds[0]), M), in the precision of `tau`; h: length of each place's interval."""
        out = np.empty((len(self.kinds[0]), len(tau)), dtype=tau.dtype)
        for row, e in zip(out, self.kinds[0], strict=True):
            row[:] = e.at(tau) * h.astype(tau.dtype) ** e.power
        return out

    def apply(self, values: Array, local: Array) -> Array:
        """[dx; x; z; w] at M places from `values` (as above) and local unknowns (local, M); shape (rows, M)."""
        out = np.zeros((self.rows, values.shape[1]), dtype=values.dtype)
        for e, kind in zip(self.entries, self.kinds[1], strict=True):
            out[e.row] += values[kind] * local[e.column]
        return out

    def matrix(self, values: Array) -> Array:
        """T itself at M places, shape (M, rows, local)."""
        out = np.zeros((values.shape[1], self.rows, self.local))
        for e, kind in zip(self.entries, self.kinds[1], strict=True):
            out[:, e.row, e.column] = values[kind]
        return out


def spline_interpolation(degree: int, states: int, algebraics: int, pairs: Sequence[tuple[int, int]]) -> Interpolation:
    """Implicit splines of `degree` K >= 2.

    A position with its velocity (a pair) is one C1 polynomial of degree K + 1, whose derivative *is* the velocity; any other
    state a C0 polynomial of degree K; an algebraic variable a discontinuous one of degree K - 1. Each brings K unknowns an
    interval, as many as its equation has moments (`spline.py`): the count is square, whatever the weights.
    """
    entries: list[Entry] = []
    column = states
    velocities = {j for _, j in pairs}
    positions = dict(pairs)
    interior = (degree - 2) * len(pairs) + (degree - 1) * (states - 2 * len(pairs)) + degree * algebraics
    right = states + interior

    def put(basis: Sequence[tuple[int, Polynomial, int]], row: int, order: int) -> None:
        for col, polynomial, power in basis:
            entries.append(Entry(row=row, column=col, polynomial=polynomial, order=order, power=power - order))

    for i in range(states):
        if i in velocities:
            continue
        if i in positions:
            j = positions[i]
            h00, h10, h01, h11, *bubbles = hermite_basis(degree + 1)
            basis = [(i, h00, 0), (j, h10, 1), (right + i, h01, 0), (right + j, h11, 1)]
            basis += [(column + k, b, 0) for k, b in enumerate(bubbles)]
            column += len(bubbles)
            put(basis, states + i, 0)
            put(basis, states + j, 1)
            put(basis, i, 1)
            put(basis, j, 2)
        else:
            left, far, *bubbles = lagrange_basis(degree)
            basis = [(i, left, 0), (right + i, far, 0)] + [(column + k, b, 0) for k, b in enumerate(bubbles)]
            column += len(bubbles)
            put(basis, states + i, 0)
            put(basis, i, 1)
    for i in range(algebraics):
        for k in range(degree):
            entries.append(Entry(row=2 * states + i, column=column, polynomial=_legendre_polynomial(k), order=0, power=0))
            column += 1
    return Interpolation(states=states, algebraics=algebraics, forces=0, interior=interior, entries=tuple(entries))


def collocation_interpolation(degree: int, states: int, algebraics: int, forces: int) -> Interpolation:
    """Radau collocation of `degree` K: states by their values at 0 and the K Radau points, z and w by theirs at the Radau points.

    The last Radau point is the next knot, so the interior holds K - 1 values of x, then K of z, then K of w.
    """
    nodes = np.concatenate([[0.0], radau(degree)])
    of_state, of_stage = cardinal_basis(nodes), cardinal_basis(nodes[1:])
    interior = (degree - 1) * states + degree * (algebraics + forces)
    entries: list[Entry] = []
    for i in range(states):
        columns = [i, *(states + k * states + i for k in range(degree - 1)), states + interior + i]
        for order, row in ((1, i), (0, states + i)):
            entries += [Entry(row=row, column=c, polynomial=b, order=order, power=-order) for c, b in zip(columns, of_state, strict=True)]
    start = states + (degree - 1) * states
    for offset, count, row in ((start, algebraics, 2 * states), (start + degree * algebraics, forces, 2 * states + algebraics)):
        for i in range(count):
            for k, b in enumerate(of_stage):
                entries.append(Entry(row=row + i, column=offset + k * count + i, polynomial=b, order=0, power=0))
    return Interpolation(states=states, algebraics=algebraics, forces=forces, interior=interior, entries=tuple(entries))


def local_index(count: int, interpolation: Interpolation, start: int = 0) -> tuple[NDArray[np.int64], int]:
    """Decision indices of the local unknowns of `count` intervals in a row, shape (local, count), and the index after the last.

    The unknowns stand in time order: x(t_0), interior_0, x(t_1), interior_1, ..., x(t_N).
    """
    stride = interpolation.states + interpolation.interior
    index = start + np.arange(interpolation.local)[:, None] + stride * np.arange(count)[None, :]
    return index.astype(np.int64), start + stride * count + interpolation.states


def _legendre_polynomial(order: int) -> Polynomial:
    tau = np.linspace(0.0, 1.0, order + 1)
    values = legendre(order + 1, tau)[order] if order else np.ones(1)
    return Polynomial(np.linalg.solve(np.vander(tau, increasing=True), values)) if order else Polynomial([1.0])
