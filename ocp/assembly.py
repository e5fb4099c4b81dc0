"""A program's symbolic functions, each made when it is first asked for: cost, constraints, derivatives; `evaluated` has its numbers."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .blocks import Block, Scatter
from .evaluated import Evaluated

if TYPE_CHECKING:
    from .nlp import Nlp


class Assembled:
    """CasADi functions of (X, p): decisions of the scaled program and its numbers, packed as `Values.packed` does."""

    def __init__(self, nlp: Nlp) -> None:
        self._nlp = nlp
        self._blocks = [Block(nlp.interpolation, nlp.index, nlp.steps, nlp.free, term) for term in nlp.terms]

    @cached_property
    def evaluated(self) -> Evaluated:
        """The terms in numbers."""
        return Evaluated(self._nlp, self._blocks)

    @cached_property
    def linear_constraints(self) -> bool:
        """Whether no constraint bends."""
        return not any(block.curved for block in self._blocks if block.term.equality)

    # ---- symbols, of the whole program: plain steps need none

    @cached_property
    def x(self) -> Any:
        """X."""
        return ca.MX.sym("X", self._nlp.size)

    @property
    def p(self) -> Any:
        """The packed numbers."""
        return self._packed[0]

    @cached_property
    def _packed(self) -> tuple[Any, tuple[Any, Any, list[tuple[Any, Any, Any, Any]]]]:
        return _symbols(self._nlp)

    @property
    def _unit(self) -> Any:
        return self._packed[1][1]

    @property
    def _numbers(self) -> list[tuple[Any, Any, Any, Any]]:
        return self._packed[1][2]

    @property
    def _scales(self) -> list[Any]:
        return [scale for _, _, _, scale in self._numbers]

    @cached_property
    def _lam_f(self) -> Any:
        return ca.MX.sym("lam_f")

    @cached_property
    def _lam_g(self) -> Any:
        return ca.MX.sym("lam_g", self._nlp.constraint_count)

    # ---- expressions, one per term

    @cached_property
    def _arguments(self) -> list[Any]:
        step, n, parameters = self._unit * self.x, self._nlp.trajectory_size, self._packed[1][0]
        places = step[:n], parameters[list(self._nlp.free)] + step[n:], parameters
        pairs = zip(self._blocks, self._numbers, strict=True)
        return [block.arguments(*places, base, data) for block, (base, data, _, _) in pairs]

    @cached_property
    def _rows(self) -> list[Any]:
        parts = zip(self._blocks, self._arguments, self._numbers, strict=True)
        return [(block.value(*arguments) - target) * scale for block, arguments, (_, _, target, scale) in parts]

    @cached_property
    def _jacobians(self) -> list[Any]:
        return [block.jacobian(*arguments) for block, arguments in zip(self._blocks, self._arguments, strict=True)]

    @property
    def _cost(self) -> Any:
        return sum((ca.sumsqr(r) / 2 for r, block in zip(self._rows, self._blocks, strict=True) if not block.term.equality), ca.MX(0))

    @property
    def _constraints(self) -> Any:
        parts = [ca.vec(r) for r, block in zip(self._rows, self._blocks, strict=True) if block.term.equality]
        return ca.vertcat(*parts) if parts else ca.MX(0, 1)

    def _multipliers(self) -> list[Any]:
        """What each value m is multiplied with in the gradient of the Lagrangian, shaped as m."""
        out, offset = [], 0
        for block, r, scale in zip(self._blocks, self._rows, self._scales, strict=True):
            if block.term.equality:
                stop = offset + block.term.target.size
                out.append(ca.reshape(self._lam_g[offset:stop], *block.term.target.shape) * scale)
                offset = stop
            else:
                out.append(self._lam_f * r * scale)
        return out

    # ---- functions

    @cached_property
    def f(self) -> Any:
        """Cost."""
        return self._function("f", [], [self._cost], [], ["f"])

    @cached_property
    def g(self) -> Any:
        """Constraints."""
        return self._function("g", [], [self._constraints], [], ["g"])

    @cached_property
    def grad(self) -> Any:
        """Cost and its gradient."""
        gradient = ca.MX.zeros(self._nlp.size)
        for block, arguments, r, scale in zip(self._blocks, self._arguments, self._rows, self._scales, strict=True):
            if not block.term.equality:
                gradient += block.to_decisions(block.adjoint(*arguments, r * scale))
        return self._function("grad_f", [], [self._cost, self._unit * gradient], [], ["f", "grad_f_x"])

    @cached_property
    def jac(self) -> Any:
        """Constraints and their Jacobian."""
        entries, offset = Scatter(), 0
        for block, J, scale in zip(self._blocks, self._jacobians, self._scales, strict=True):
            if block.term.equality:
                entries.add(*block.jacobian_entries(offset), block.scaled(J, scale))
                offset += block.term.target.size
        matrix = entries.matrix(offset, self._nlp.size, None, self._unit)
        return self._function("jac_g", [], [self._constraints, matrix], [], ["g", "jac_g_x"])

    @cached_property
    def hess(self) -> Any:
        """Upper triangle of the Hessian of the Lagrangian."""
        entries = self._squares()
        for block, arguments, multiplier in zip(self._blocks, self._arguments, self._multipliers(), strict=True):
            if block.curved:
                entries.add(*block.hessian_entries(), block.to_intervals(block.hessian(*arguments, multiplier)))
        return self._hessian(entries)

    @cached_property
    def gauss_newton(self) -> Any:
        """Upper triangle of the cost's Gauss-Newton Hessian, as a function of the same arguments."""
        return self._hessian(self._squares())

    def _squares(self) -> Scatter:
        entries = Scatter()
        for block, J, scale in zip(self._blocks, self._jacobians, self._scales, strict=True):
            if not block.term.equality:
                entries.add(*block.square_entries(), self._lam_f * block.to_intervals(block.square(block.scaled(J, scale))))
        return entries

    def _hessian(self, entries: Scatter) -> Any:
        matrix = entries.matrix(self._nlp.size, self._nlp.size, self._unit, self._unit)
        return self._function("hess_l", [self._lam_f, self._lam_g], [matrix], ["lam_f", "lam_g"], ["triu_hess_gamma_x_x"])

    def _function(self, name: str, inputs: list[Any], outputs: list[Any], names_in: list[str], names_out: list[str]) -> Any:
        return ca.Function(f"nlp_{name}", [self.x, self.p, *inputs], outputs, ["x", "p", *names_in], names_out)


def _symbols(nlp: Nlp) -> tuple[Any, tuple[Any, Any, list[tuple[Any, Any, Any, Any]]]]:
    """The packed `p` of the program and its parts, in the order of `Values.packed`."""
    shapes = [(nlp.parameter_count, 1), (nlp.size, 1)]
    for term in nlp.terms:
        shapes += [(nlp.interpolation.rows * term.places, term.columns), term.data.shape, term.target.shape, term.scale.shape]
    sizes = [rows * columns for rows, columns in shapes]
    p = ca.MX.sym("p", sum(sizes))
    edges = np.cumsum([0, *sizes]).tolist()
    parts = [ca.reshape(p[a:b], *shape) for a, b, shape in zip(edges[:-1], edges[1:], shapes, strict=True)]
    return p, (parts[0], parts[1], list(zip(*(parts[k::4] for k in range(2, 6)), strict=True)))
