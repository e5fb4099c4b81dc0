"""The nonlinear program: terms on a mesh, with gradient, Jacobian and Hessian assembled from small blocks.

Decision vector X: the unknowns less a reference, each in its own unit, so that a solver sees numbers of order one:

    reference + unit * X = [ x(t_0) | interior_0 | x(t_1) | interior_1 | ... | x(t_N) |  (the next horizon) ...  | p_free ]
                             n unknowns of the trajectories, in time order                                   np

What the reference trajectory is at every place is computed once, in extended precision. Without that an acceleration would be the
difference of two positions of full size over h^2, and the rounding of a stiffly weighted balance would drown the last steps of a solve.

Constraint vector g: the equality terms one after the other, each column by column (interval by interval).

No derivative is taken of the whole program. Each term's function is differentiated once, symbolically, for one column;
that small function is mapped over all columns and its values are summed and scattered into the known sparsity. Work,
memory and construction time are therefore linear in the number of columns, and the sparsity is never searched.

The Hessian is  sum J'J + gamma * sum r . d2r + gamma * sum lambda . d2g:  gamma = 0 is Gauss-Newton, gamma = 1 is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .blocks import Block, Scatter
from .interpolation import Interpolation
from .polynomials import Array
from .terms import Term, stacked

Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Values:
    """The numbers of a program that may change without building it anew.

    parameters (np_all,): every model parameter; free ones are overwritten by the decision vector.
    data, target, scale: one array per term, shaped as in `Term`. reference, unit (n + np,): decisions = reference + unit * X.
    base: per term, [dx; x; z; w] of the reference at its places, (S * rows of T, C). gamma: see above.
    """

    parameters: Array
    data: tuple[Array, ...]
    target: tuple[Array, ...]
    scale: tuple[Array, ...]
    reference: Array
    unit: Array
    base: tuple[Array, ...]
    free: int
    gamma: float = 1.0

    def scaled(self, decisions: Array) -> Array:
        """X of decisions in the units of the model."""
        return (decisions - self.reference) / self.unit

    def decisions(self, X: Array) -> Array:
        """Decisions in the units of the model."""
        return np.asarray(self.reference + self.unit * X, dtype=np.float64)

    def packed(self) -> Array:
        """One vector, the program's `p`."""
        arrays = [self.parameters, self.reference[self.reference.size - self.free :], self.unit, np.array([self.gamma])]
        for term in zip(self.base, self.data, self.target, self.scale, strict=True):
            arrays += [a.ravel(order="F") for a in term]
        return np.concatenate(arrays)


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
    def assembled(self) -> Assembled:
        """CasADi functions of (X, p)."""
        return _assemble(self)

    def values(self, parameters: Array, *, gamma: float = 1.0) -> Values:
        """The numbers that the terms were made with."""
        return Values(
            parameters=parameters,
            data=tuple(t.data for t in self.terms),
            target=tuple(t.target for t in self.terms),
            scale=tuple(t.scale for t in self.terms),
            reference=np.zeros(self.size),
            unit=np.ones(self.size),
            base=tuple(np.zeros((self.interpolation.rows * t.places, t.columns)) for t in self.terms),
            free=len(self.free),
            gamma=gamma,
        )

    def about(self, values: Values, decisions: Array) -> Values:
        """The same numbers with the decisions measured from these, (n + np,)."""
        local = decisions[: self.trajectory_size].astype(np.longdouble)[self.index]
        base = []
        for term, basis in zip(self.terms, self._long_basis, strict=True):
            interval, _ = term.all_places()
            base.append(stacked(self.interpolation.apply(basis, local[:, interval]).astype(np.float64), term.columns))
        return replace(values, reference=np.array(decisions), base=tuple(base))

    @cached_property
    def _long_basis(self) -> tuple[NDArray[np.longdouble], ...]:
        places = (t.all_places() for t in self.terms)
        return tuple(self.interpolation.values(tau.astype(np.longdouble), self.steps[interval]) for interval, tau in places)

    def local(self, trajectory: Array) -> Array:
        """Local unknowns of every interval from the trajectory unknowns (n,), shape (local, N)."""
        return np.asarray(trajectory[self.index], dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Assembled:
    """f, grad, g, jac, hess of (X, p); for inspection the rows of every term and, unscaled, the nonzeros of their Jacobians.

    patterns: (row, column) of these nonzeros in one column's (K m, local + np) matrix, per term.
    """

    x: Any
    p: Any
    f: Any
    g: Any
    grad: Any
    jac: Any
    hess: Any
    rows: Any
    jacobians: Any
    patterns: tuple[tuple[Index, Index], ...]


def _assemble(nlp: Nlp) -> Assembled:
    n, size = nlp.trajectory_size, nlp.size
    X, lam_f, lam_g = ca.MX.sym("X", size), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.constraint_count)
    p, (parameters, theta_0, unit, gamma, numbers) = _symbols(nlp)
    step = unit * X
    c, theta = step[:n], theta_0 + step[n:]
    f, gradient = ca.MX(0), ca.MX.zeros(size)
    rows, jacobians, patterns, constraints, offset = [], [], [], [], 0
    hessian, jacobian = Scatter(), Scatter()
    for term, (base, data, target, scale) in zip(nlp.terms, numbers, strict=True):
        block = Block(nlp.interpolation, nlp.index, nlp.steps, nlp.free, term)
        arguments = block.arguments(c, theta, parameters, base, data)
        r = (block.value(*arguments) - target) * scale
        J = block.jacobian(*arguments)
        rows.append(r)
        jacobians.append(J)
        patterns.append((block.jacobian_rows, block.jacobian_columns))
        if term.equality:
            constraints.append(ca.vec(r))
            jacobian.add(*block.jacobian_entries(offset), block.scaled(J, scale))
            multiplier = ca.reshape(lam_g[offset : offset + term.target.size], *term.target.shape) * scale
            offset += term.target.size
        else:
            f += ca.sumsqr(r) / 2
            multiplier = r * scale
            gradient += block.to_decisions(block.adjoint(*arguments, multiplier))
            multiplier *= lam_f
            hessian.add(*block.square_entries(), lam_f * block.to_intervals(block.square(block.scaled(J, scale))))
        if block.curved:
            hessian.add(*block.hessian_entries(), gamma * block.to_intervals(block.hessian(*arguments, multiplier)))
    H = hessian.matrix(size, size, unit, unit)
    g = ca.vertcat(*constraints) if constraints else ca.MX(0, 1)
    jac = jacobian.matrix(offset, size, None, unit)
    functions = {
        "f": ([X, p], [f], ["x", "p"], ["f"]),
        "g": ([X, p], [g], ["x", "p"], ["g"]),
        "grad": ([X, p], [f, unit * gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac": ([X, p], [g, jac], ["x", "p"], ["g", "jac_g_x"]),
        "hess": ([X, p, lam_f, lam_g], [H], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]),
        "rows": ([X, p], rows, ["x", "p"], [f"rows_{i}" for i in range(len(rows))]),
        "jacobians": ([X, p], jacobians, ["x", "p"], [f"jacobian_{i}" for i in range(len(rows))]),
    }
    return Assembled(x=X, p=p, patterns=tuple(patterns), **{name: ca.Function(f"nlp_{name}", *parts) for name, parts in functions.items()})


def _symbols(nlp: Nlp) -> tuple[Any, tuple[Any, Any, Any, Any, list[tuple[Any, Any, Any, Any]]]]:
    """The packed `p` of the program and its parts, in the order of `Values.packed`."""
    shapes = [(nlp.parameter_count, 1), (len(nlp.free), 1), (nlp.size, 1), (1, 1)]
    for term in nlp.terms:
        shapes += [(nlp.interpolation.rows * term.places, term.columns), term.data.shape, term.target.shape, term.scale.shape]
    sizes = [rows * columns for rows, columns in shapes]
    p = ca.MX.sym("p", sum(sizes))
    edges = np.cumsum([0, *sizes]).tolist()
    parts = [ca.reshape(p[a:b], *shape) for a, b, shape in zip(edges[:-1], edges[1:], shapes, strict=True)]
    return p, (parts[0], parts[1], parts[2], parts[3], list(zip(*(parts[k::4] for k in range(4, 8)), strict=True)))
