"""The nonlinear program: terms on a mesh, with gradient, Jacobian and Hessian assembled from small blocks.

Decision vector X: the unknowns less a reference, each in its own unit, so that a solver sees numbers of order one:

    reference + unit * X = [ x(t_0) | interior_0 | x(t_1) | interior_1 | ... | x(t_N) |  (the next horizon) ...  | p_free ]
                             n unknowns of the trajectories, in time order                                   np

What the reference trajectory is at every place is computed once, in extended precision. Without that an acceleration would be the
difference of two positions of full size over h^2, and the rounding of a stiffly weighted balance would drown the last steps of a solve.

Constraint vector g: the equality terms one after the other, each column by column (interval by interval).

No derivative is taken of the whole program, nor of a column of it. Each term's function is differentiated once, symbolically, at a point
(`pointwise.py`); its numbers at all points are lifted to the columns' unknowns by constant sparse matrices (`lifting.py`), summed, and
scattered into the known sparsity (`evaluated.py`). Work and memory are therefore linear in the number of columns, construction hangs on
the model alone, and the sparsity is never searched.

The Hessian is  sum J'J + sum r . d2r + sum lambda . d2g;  Gauss-Newton's is the first sum alone.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .evaluated import Evaluated
from .interpolation import Interpolation
from .polynomials import Array
from .terms import Term, stacked

Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Values:
    """The numbers of a program that may change without building it anew.

    parameters (np_all,): every model parameter; of the free ones the reference, which is where the decisions are measured from.
    data, target, scale: one array per term, shaped as in `Term`. reference, unit (n + np,): decisions = reference + unit * X.
    base: per term, [dx; x; z; w] of the reference at its places, (S * rows of T, C).
    """

    parameters: Array
    data: tuple[Array, ...]
    target: tuple[Array, ...]
    scale: tuple[Array, ...]
    reference: Array
    unit: Array
    base: tuple[Array, ...]

    def scaled(self, decisions: Array) -> Array:
        """X of decisions in the units of the model."""
        return (decisions - self.reference) / self.unit

    def decisions(self, X: Array) -> Array:
        """Decisions in the units of the model."""
        return np.asarray(self.reference + self.unit * X, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Nlp:
    """Terms, where their unknowns stand, and the functions that a solver needs.

    index (local, N): decision index of every local unknown of every interval. steps (N,): interval lengths.
    free: which of the model's parameters are unknown.
    """

    interpolation: Interpolation
    index: NDArray[np.int64]
    steps: Array
    terms: tuple[Term, ...]
    parameter_count: int
    free: tuple[int, ...]

    def __getstate__(self) -> dict[str, Any]:
        """What it was made of; functions and tables are made anew where it arrives."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @property
    def trajectory_size(self) -> int:
        """n: unknowns of the trajectories."""
        return int(self.index.max()) + 1

    @property
    def size(self) -> int:
        """n + np."""
        return self.trajectory_size + len(self.free)

    @property
    def constraint_count(self) -> int:
        """Number of scalar equality constraints."""
        return sum(t.target.size for t in self.terms if t.equality)

    @cached_property
    def referred(self) -> NDArray[np.int64]:
        """Which of the free parameters the terms also take at the reference (places in `free`)."""
        used = {i for t in self.terms for i in t.function.jac_sparsity(0, 2).get_col()}
        return np.array([k for k, i in enumerate(self.free) if i in used], dtype=np.int64)

    @cached_property
    def evaluated(self) -> Evaluated:
        """The terms in numbers: rows, derivatives and what is summed of them."""
        return Evaluated(self)

    def values(self, parameters: Array) -> Values:
        """The numbers that the terms were made with."""
        reference = np.zeros(self.size)
        reference[self.trajectory_size :] = parameters[list(self.free)]
        return Values(
            parameters=parameters,
            data=tuple(t.data for t in self.terms),
            target=tuple(t.target for t in self.terms),
            scale=tuple(t.scale for t in self.terms),
            reference=reference,
            unit=np.ones(self.size),
            base=tuple(np.zeros((self.interpolation.rows * t.places, t.columns)) for t in self.terms),
        )

    def about(self, values: Values, decisions: Array) -> Values:
        """The same numbers with the decisions measured from these, (n + np,)."""
        local = decisions[: self.trajectory_size].astype(np.longdouble)[self.index]
        base = []
        for term, basis in zip(self.terms, self._long_basis, strict=True):
            interval, _ = term.all_places()
            base.append(stacked(self.interpolation.apply(basis, local[:, interval]).astype(np.float64), term.columns))
        parameters = values.parameters.copy()
        parameters[list(self.free)] = decisions[self.trajectory_size :]
        return replace(values, parameters=parameters, reference=np.array(decisions), base=tuple(base))

    @cached_property
    def _long_basis(self) -> tuple[NDArray[np.longdouble], ...]:
        places = (t.all_places() for t in self.terms)
        return tuple(self.interpolation.values(tau.astype(np.longdouble), self.steps[interval]) for interval, tau in places)

    def local(self, trajectory: Array) -> Array:
        """Local unknowns of every interval from the trajectory unknowns (n,), shape (local, N)."""
        return np.asarray(trajectory[self.index], dtype=np.float64)
