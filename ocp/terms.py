"""Terms: what a nonlinear program over a mesh is made of.

A term evaluates one function at many points of the mesh and gathers its values into rows:

    m[:, r] = sum over points k of G[k, r] phi(v_k, p, d_k)         v_k = [dx; x; z; w] at point k = T_k l_i(k)
    r[:, r] = (m[:, r] - target[:, r]) * scale[:, r]

The points of one row lie in one interval, so every derivative is a small dense block on that interval's local unknowns
and the parameters. Rows either enter the cost as squares, 1/2 sum r^2, or must vanish.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .polynomials import Array


@dataclass(frozen=True, kw_only=True)
class Term:
    """One family of residuals or constraints.

    function: casadi.Function (v, p, d) -> phi, shapes (rows of T), (all parameters), (nd) -> (m).
    interval (M,), tau (M,): where the points are. data (nd, M): what belongs to each point (held inputs, ...).
    gather (M, R) sparse G; None is the identity: every point a row of its own.
    target, scale (m, R).
    """

    name: str
    function: Any
    interval: NDArray[np.int64]
    tau: Array
    data: Array
    target: Array
    scale: Array
    gather: sp.csc_matrix | None = None
    equality: bool = False

    @property
    def points(self) -> int:
        """M, number of points."""
        return len(self.interval)

    @property
    def rows(self) -> int:
        """R, number of columns of rows (each of m values)."""
        return self.points if self.gather is None else int(self.gather.shape[1])

    @property
    def row_interval(self) -> NDArray[np.int64]:
        """The interval of every row, shape (R,)."""
        if self.gather is None:
            return self.interval
        first = self.gather.indices[self.gather.indptr[:-1]]
        return np.asarray(self.interval[first], dtype=np.int64)
