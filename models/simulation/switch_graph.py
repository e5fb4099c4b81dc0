"""The graph of a model's equations with every switch taken out: functions that have a corner become symbols of their own.

Nodes are visited once, in the order in which they are computed. A node that depends on parameters and on one switch only, tanh(v/width) or
(1 + sgn a)/2, stays a function psi(s) of that switch until another variable meets it; there it becomes a symbol.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from ..dae import Dae

SX = Any


@dataclass(eq=False)
class Found:
    """A switch as found: function, its scaled symbol s, the width's name, and the parts (symbol, psi(s), as written)."""

    function: SX
    s: SX
    scale: SX
    width: str
    parts: list[tuple[SX, SX]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Corner:
    """A rounded |q|: its symbol, the switch, |q| by modes, and as written."""

    symbol: SX
    switch: int
    sharp: SX
    written: SX


_TINY = 1e-150  # so that what is divided by |q| stays a number at q = 0
_CONSTANT, _MIXED = -2, -1  # owners of a node: parameters only, anything; else the index of the one switch it is a function of


class Graph:
    """The equations rebuilt node by node, with switches taken out."""

    def __init__(self, dae: Dae, smooth: Collection[str]) -> None:
        self.found: list[Found] = []
        self.corners: list[Corner] = []
        self.smooth = set(smooth)
        self._symbols: dict[int, SX] = {}
        self._switch: dict[tuple[int, int], int] = {}
        moving: SX = ca.vertcat(dae.dx, dae.x, dae.z, dae.u, dae.w, dae.t)
        function = ca.Function("graph", [moving, dae.p], [dae.residual, dae.output])
        work: dict[int, tuple[SX, int]] = {}
        outputs: list[dict[int, SX]] = [{}, {}]
        for i in range(function.n_instructions()):
            op, into, out = function.instruction_id(i), function.instruction_input(i), function.instruction_output(i)
            if op == ca.OP_INPUT:
                work[out[0]] = (moving[into[1]], _MIXED) if into[0] == 0 else (dae.p[into[1]], _CONSTANT)
            elif op == ca.OP_CONST:
                work[out[0]] = ca.SX(function.instruction_constant(i)), _CONSTANT
            elif op == ca.OP_OUTPUT:
                outputs[out[0]][out[1]] = self._use(*work[into[0]])
            else:
                work[out[0]] = self._node(op, [work[j] for j in into])
        self.residual, self.output = (_scatter(e, rows) for e, rows in zip((dae.residual, dae.output), outputs, strict=True))

    def _node(self, op: int, operands: list[tuple[SX, int]]) -> tuple[SX, int]:
        owners = {owner for _, owner in operands} - {_CONSTANT}
        if not owners or (len(owners) == 1 and _MIXED not in owners):
            return _pure(op, [e for e, _ in operands]), owners.pop() if owners else _CONSTANT
        if op == ca.OP_DIV and operands[1][1] == _CONSTANT and operands[1][0].is_symbolic() and operands[1][0].name() in self.smooth:
            width = operands[1][0]
            factor, function = _factored(self._use(*operands[0]))
            k = self._new(function, width, width.name())
            return factor * self.found[k].s, k
        e = [self._use(*operand) for operand in operands]
        if op in (ca.OP_FABS, ca.OP_SIGN):
            sign = self._sign(e[0])
            return (sign * e[0] if op == ca.OP_FABS else sign), _MIXED
        if op in (ca.OP_FMAX, ca.OP_FMIN):
            first = self._condition(e[0] - e[1] if op == ca.OP_FMAX else e[1] - e[0])
            return _select(first, e[0]) + _select(1 - first, e[1]), _MIXED
        if op in (ca.OP_LT, ca.OP_LE):
            k = self._new(e[1] - e[0], ca.SX(1), "")
            return (1 + ca.sign(self.found[k].s)) / 2, k
        if op == ca.OP_SQRT and (corner := self._rounded_corner(e[0])) is not None:
            return self._magnitude(*corner, ca.sqrt(e[0])), _MIXED
        return _pure(op, e), _MIXED

    def _new(self, function: SX, scale: SX, width: str) -> int:
        key = function.element_hash(), scale.element_hash() if width else 0
        if key not in self._switch:
            self._switch[key] = len(self.found)
            self.found.append(Found(function, ca.SX.sym("s"), scale, width))
        return self._switch[key]

    def _sign(self, function: SX) -> SX:
        k = self._new(function, ca.SX(1), "")
        return self._use(ca.sign(self.found[k].s), k)

    def _condition(self, function: SX) -> SX:
        k = self._new(function, ca.SX(1), "")
        return self._use((1 + ca.sign(self.found[k].s)) / 2, k)

    def _use(self, expression: SX, owner: int) -> SX:
        """The expression where other variables meet it: a function of one switch becomes a symbol."""
        if owner < 0:
            return expression
        key = expression.element_hash()
        if key not in self._symbols:
            same = next((symbol for symbol, psi in self.found[owner].parts if ca.is_equal(psi, expression, 20)), None)
            self._symbols[key] = same if same is not None else ca.SX.sym("psi")
            if same is None:
                self.found[owner].parts.append((self._symbols[key], expression))
        return self._symbols[key]

    def _magnitude(self, q: SX, width: str, written: SX) -> SX:
        """A symbol that stands for |q|, or for sqrt(q^2 + r^2) where that has to stay."""
        k = self._new(q, ca.SX(1), "")
        self.found[k].width = width
        symbol = ca.SX.sym("corner")
        self.corners.append(Corner(symbol, k, self._use(ca.sign(self.found[k].s), k) * q + _TINY, written))
        return symbol

    def _rounded_corner(self, square: SX) -> tuple[SX, str] | None:
        """q and the name of the width, when the argument of a square root is q^2 + r^2 and r is nothing but rounding."""
        if square.op() != ca.OP_ADD:
            return None
        for q, r in ((square.dep(0), square.dep(1)), (square.dep(1), square.dep(0))):
            zero = [s for s in ca.symvar(r) if s.name() in self.smooth]
            if q.op() == ca.OP_SQ and zero and ca.substitute(r, ca.vertcat(*zero), ca.DM.zeros(len(zero))).is_zero():
                return q.dep(0), zero[0].name()
        return None


def _factored(expression: SX) -> tuple[float, SX]:
    """c and a of c a, c a number."""
    if expression.op() == ca.OP_NEG:
        factor, rest = _factored(expression.dep(0))
        return -factor, rest
    if expression.op() == ca.OP_MUL:
        for c, rest in ((expression.dep(0), expression.dep(1)), (expression.dep(1), expression.dep(0))):
            if c.is_constant():
                factor, rest = _factored(rest)
                return float(c) * factor, rest
    return 1.0, expression


def _pure(op: int, operands: list[SX]) -> SX:
    """A node as it is; logic as arithmetic on 0 and 1, so that what lies between has a meaning at a switch."""
    if op == ca.OP_NOT:
        return 1 - operands[0]
    if op == ca.OP_AND:
        return operands[0] * operands[1]
    if op == ca.OP_OR:
        return operands[0] + operands[1] - operands[0] * operands[1]
    if op == ca.OP_IF_ELSE_ZERO:
        return _select(operands[0], operands[1])
    return ca.SX.unary(op, operands[0]) if len(operands) == 1 else ca.SX.binary(op, operands[0], operands[1])


def _select(condition: SX, value: SX) -> SX:
    """condition * value, but 0 where the condition is 0 and the value is not a number."""
    return condition * ca.SX.binary(ca.OP_IF_ELSE_ZERO, condition, value)


def _scatter(like: SX, rows: dict[int, SX]) -> SX:
    """The column with nonzeros `rows` in the places that `like` has them."""
    column = ca.SX.zeros(like.shape[0], 1)
    for j, row in enumerate(ca.SX(like).sparsity().row()):
        column[row] = rows[j]
    return column
