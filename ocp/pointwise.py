"""A function of the model at points of the mesh, phi(v, p, p_ref, d), and its derivatives in e = [v; theta; mu], at many points at once.

theta are the free ones of p, mu the last rows of d. The derivatives are taken once for a function and whatever program it stands in:
of a column of a program phi knows nothing (`blocks.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .columnwise import Columnwise
from .polynomials import Array

Index = NDArray[np.int64]

COMMON = (1, 2)  # arguments that all points have in common: theta and p
ALIVE = 24  # functions that are kept with their derivatives


def pointwise(function: Any, free: Sequence[int], further: int = 0) -> Pointwise:
    """The `Pointwise` of a function; of the same function once more, as programs on other meshes have it, the same one."""
    return _made(function.serialize(), tuple(free), further)


@lru_cache(maxsize=ALIVE)
def _made(text: str, free: tuple[int, ...], further: int) -> Pointwise:
    return Pointwise(ca.Function.deserialize(text), free, further)


class Pointwise:
    """phi (m) and its derivatives; those are given by their nonzeros, one row each.

    pairs: (row of phi, entry of e) of every nonzero of the first one; bends: (entry, entry) of the upper triangle of that of lam . phi.
    """

    def __init__(self, function: Any, free: Sequence[int], further: int) -> None:
        v, p = ca.SX.sym("v", function.size1_in(0)), ca.SX.sym("p", function.size1_in(1))
        theta, d = ca.SX.sym("theta", len(free)), ca.SX.sym("d", function.size1_in(3))
        merged = ca.SX(p)
        for k, i in enumerate(free):
            merged[i] = theta[k]
        self._phi = function(v, merged, p, d)
        self.rows, self.unknowns = int(self._phi.shape[0]), v.shape[0] + len(free) + further
        self._e = ca.vertcat(v, theta, d[d.shape[0] - further :])
        self._lam = ca.SX.sym("lam", self.rows)
        symbols = (v, theta, p, d)
        # what the function does not look at is not carried to its points
        self._used = [_used(self._phi, s) for s in symbols]
        self._arguments = [s[used] for s, used in zip(symbols, self._used, strict=True)]
        self._jacobian = ca.jacobian(self._phi, self._e)
        self.pairs = _triplet(self._jacobian)

    @cached_property
    def _hessian(self) -> Any:
        return ca.triu(ca.jacobian(ca.jtimes(self._phi, self._e, self._lam, True), self._e))

    @cached_property
    def bends(self) -> tuple[Index, Index]:
        """See there."""
        return _triplet(self._hessian)

    @property
    def looked_at(self) -> list[int]:
        """The rows of v that phi depends on."""
        return self._used[0]

    def arguments(self, v: Array, theta: Array, parameters: Array, d: Array) -> list[Array]:
        """What the functions below take; v: of the rows looked at, and d, at all points; theta, parameters: which these have in common."""
        _, free, fixed, rows = self._used
        return [v, theta[free], parameters[fixed], d[rows]]

    @cached_property
    def valued(self) -> Columnwise:
        """phi."""
        return Columnwise(_function("value", self._arguments, self._phi), COMMON)

    @cached_property
    def linearised(self) -> Columnwise:
        """phi and the nonzeros of its derivative in e."""
        return Columnwise(_function("linearised", self._arguments, self._phi, _nonzeros(self._jacobian)), COMMON)

    @cached_property
    def bent(self) -> Columnwise:
        """Nonzeros of the second derivative of lam . phi in e, upper triangle; one more argument, lam (m)."""
        return Columnwise(_function("hessian", [*self._arguments, self._lam], _nonzeros(self._hessian)), COMMON)


def _function(name: str, inputs: list[Any], *outputs: Any) -> Any:
    return ca.Function(name, inputs, [ca.densify(part) for part in outputs], {"cse": True})


def _used(expression: Any, symbols: Any) -> list[int]:
    """Which of the symbols an expression depends on."""
    return sorted(set(ca.jacobian_sparsity(expression, symbols).get_col()))


def _triplet(matrix: Any) -> tuple[Index, Index]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _nonzeros(matrix: Any) -> Any:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)
