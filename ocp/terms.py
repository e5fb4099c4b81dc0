"""Terms: what a nonlinear program over a mesh is made of.

A term looks at the model at some places of an interval and gathers what it sees into one column of rows:

    m[k, :] = sum over places s of moments[s, k] phi(v_s, p, p_ref, d_s)            v_s = [dx; x; z; w] at place s = T(tau_s, h) l_i
    r = (m - target) * scale                                                 all rows of the column below each other

Two kinds: columns with a place of their own each (samples, initial states), and columns over whole intervals with the same places in
each (moments of an equation, collocation points). Every derivative is a small dense block on the interval's local unknowns and the
parameters. Rows either enter the cost as squares, 1/2 sum r^2, or must vanish.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .polynomials import Array


@dataclass(frozen=True, kw_only=True)
class Within:
    """What a column also takes from its whole interval: moments (q K,) of function (v, p, p_ref, d) -> (q) at nodes (S,).

    weights (S, K): m = sum over nodes of weights[s, k] phi_s.
    """

    function: Any
    nodes: Array
    weights: Array


@dataclass(frozen=True, kw_only=True)
class Term:
    """One family of residuals or constraints, in C columns.

    function: casadi.Function (v, p, p_ref, d) -> phi, shapes (rows of T), (all parameters) twice, (nd) -> (m); p_ref: `Values`.
    interval (C,): of every column. tau (C,): its place there; or nodes (S,): the same places in all.
    moments (S, K): None is the identity, every node a row group of its own.
    within: beside a place of its own, see there: its moments follow the place's data in d, and its places' data the column's in `data`.
    heavy: squares over whole intervals whose weight may grow until they are all but constraints.
    data (S nd, C): what belongs to the places (held inputs, ...), one place below the other. target, scale (K m, C).
    """

    name: str
    function: Any
    interval: NDArray[np.int64]
    data: Array
    target: Array
    scale: Array
    tau: Array | None = None
    nodes: Array | None = None
    moments: Array | None = None
    equality: bool = False
    heavy: bool = False
    within: Within | None = None

    @property
    def columns(self) -> int:
        """C."""
        return len(self.interval)

    @property
    def places(self) -> int:
        """S, number of places that a column looks at."""
        return (1 if self.within is None else 1 + len(self.within.nodes)) if self.nodes is None else len(self.nodes)

    def all_places(self) -> tuple[NDArray[np.int64], Array]:
        """Interval and tau of every place of every column, (C S,), the places of a column side by side."""
        if self.nodes is None:
            tau = np.zeros(self.columns) if self.tau is None else self.tau
            if self.within is None:
                return self.interval, tau
            every = np.column_stack([tau, np.tile(self.within.nodes, (self.columns, 1))])
            return np.repeat(self.interval, self.places), every.ravel()
        return np.repeat(self.interval, self.places), np.tile(self.nodes, self.columns)


def stacked(values: Array, columns: int) -> Array:
    """Values at the places of every column, (n, C S) in the order of `all_places`, one place below the other: (S n, C)."""
    n, places = values.shape[0], values.shape[1] // columns
    return np.ascontiguousarray(values.reshape(n, columns, places).transpose(2, 0, 1).reshape(places * n, columns))
