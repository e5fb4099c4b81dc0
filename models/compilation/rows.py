"""Equations indexed by the symbols they hold, so that a substitution visits only the rows that hold what is replaced.

`where[name]` is the set of rows that hold the symbol of that name. With rows that hold a few symbols each, eliminating all n variables of a
model costs O(n) substitutions; tables of all rows against all variables would cost O(n^2). Common subexpressions are shared as they appear:
a train of n gears would otherwise hold n products of up to n ratios.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from functools import cached_property, reduce
from operator import or_
from typing import Any

import casadi as ca

SX = Any
_RELATIONS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}
_KINKED = {ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX}  # whose derivatives step
_ROOTS = {ca.OP_SQRT, ca.OP_POW, ca.OP_CONSTPOW}  # of what becomes a square they are |x|
_STEPPING = _RELATIONS | {ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN}


class Held:
    """An expression with its symbols and slopes, found once. Symbols it does not depend on, as in (s + x) - s, are dropped.

    `fixed` names symbols that are left alone and not listed: the parameters. `smooth`: it is known that nothing in the value steps.
    """

    def __init__(self, value: SX, fixed: Container[str] = (), *, smooth: bool = False) -> None:
        symbols, slopes = _slopes(value, fixed)
        flat = [name for name, slope in slopes.items() if slope.is_zero()]
        stepping = steps(value) if flat and not smooth else set()
        idle = [symbols.pop(name) for name in flat if name not in stepping]
        if idle:
            value = ca.substitute(value, ca.vertcat(*idle), ca.DM.zeros(len(idle)))
            symbols, slopes = _slopes(value, fixed)
        self.value, self.symbols, self.slopes, self.fixed, self.smooth = value, symbols, slopes, fixed, smooth

    @cached_property
    def steps(self) -> set[str]:
        """The symbols in which the value steps, sgn(v): it is affine in none of them, whatever its slope."""
        return set() if self.smooth else steps(self.value)

    @cached_property
    def rates(self) -> list[str]:
        """The variables whose derivative occurs."""
        return [name[4:-1] for name in self.symbols if name.startswith("der(")]

    def replaced(self, new: Mapping[str, SX]) -> Held:
        """The expression with symbols replaced, by name; itself where none of them occurs."""
        names = [name for name in new if name in self.symbols]
        if not names:
            return self
        old = ca.vertcat(*(self.symbols[name] for name in names))
        return self.with_value(ca.substitute(self.value, old, ca.vertcat(*(new[name] for name in names))))

    def with_value(self, value: SX) -> Held:
        """Another value, of which the same is known."""
        return Held(value, self.fixed, smooth=self.smooth)

    def solved_for(self, name: str) -> SX:
        """0 = c v + e as v = -e/c, for a v in which the value does not step."""
        return -ca.substitute(self.value, self.symbols[name], 0) / self.slopes[name]


def steps(value: SX) -> set[str]:
    """The names of the symbols in which a value steps: their derivative says nothing of what sgn(v), a comparison or a rounding does."""
    symbols, node, operations = _evaluated(value)
    if _STEPPING.isdisjoint(operations):
        return set()
    held: dict[int, int] = {}  # work place -> bits of the symbols that it depends on
    stepped: dict[int, int] = {}  # and of those that it steps in
    found = 0
    for i, operation in enumerate(operations):
        into, out = node.instruction_input(i), node.instruction_output(i)
        if operation == ca.OP_INPUT:
            held[out[0]], stepped[out[0]] = 1 << into[1], 0
        elif operation == ca.OP_CONST:
            held[out[0]], stepped[out[0]] = 0, 0
        elif operation == ca.OP_OUTPUT:
            found |= stepped[into[0]]
        else:
            every, by_steps = (reduce(or_, (bits[k] for k in into), 0) for bits in (held, stepped))
            if operation == ca.OP_IF_ELSE_ZERO:
                by_steps |= held[into[0]]
            elif operation in _STEPPING:
                by_steps = every
            held[out[0]], stepped[out[0]] = every, by_steps
    return {symbol.name() for k, symbol in enumerate(symbols) if found >> k & 1}


def is_smooth(values: SX) -> bool:
    """Whether neither they nor their derivatives step, whatever symbols in them are replaced by that does not."""
    return (_STEPPING | _KINKED | _ROOTS).isdisjoint(_evaluated(values)[2])


def _evaluated(values: SX) -> tuple[list[SX], ca.Function, list[int]]:
    """Its symbols, its evaluation from them, and the operations of that in order."""
    symbols = ca.symvar(values)
    node = ca.Function("node", [ca.vertcat(*symbols)], [ca.SX(values)])
    return symbols, node, [node.instruction_id(i) for i in range(node.n_instructions())]


def _slopes(value: SX, fixed: Container[str]) -> tuple[dict[str, SX], dict[str, SX]]:
    symbols = {name: symbol for symbol in ca.symvar(value) if (name := symbol.name()) not in fixed}
    slopes = ca.horzsplit(ca.densify(ca.jacobian(value, ca.vertcat(*symbols.values())))) if symbols else []
    return symbols, dict(zip(symbols, slopes, strict=True))


class Rows:
    """Numbered rows and their occurrence index.

    touched   numbers of the rows that are new or changed since `settle` was last called
    toggled   symbols that have since come to occur somewhere or nowhere
    work      symbols in the rows that substitutions rewrote so far: what elimination costs, machine aside
    """

    def __init__(self) -> None:
        self.held: dict[int, Held] = {}
        self.where: dict[str, set[int]] = {}
        self.touched: set[int] = set()
        self.toggled: set[str] = set()
        self.work = 0

    def put(self, i: int, held: Held) -> None:
        """Row i is now this expression."""
        if i in self.held:
            self.take(i)
        self.held[i] = held
        self.touched.add(i)
        for name in held.symbols:
            rows = self.where.setdefault(name, set())
            if not rows:
                self.toggled ^= {name}
            rows.add(i)

    def take(self, i: int) -> Held:
        """Remove row i."""
        held = self.held.pop(i)
        self.touched.discard(i)
        for name in held.symbols:
            rows = self.where[name]
            rows.remove(i)
            if not rows:
                self.toggled ^= {name}
                del self.where[name]
        return held

    def substitute(self, new: Mapping[str, SX]) -> None:
        """Replace symbols, by name, in all rows that hold one of them: in one pass, so that what rows share stays shared."""
        numbers = sorted(set().union(*(self.where.get(name, ()) for name in new)))
        if not numbers:
            return
        rows = [self.held[i] for i in numbers]
        old = {name: symbol for row in rows for name, symbol in row.symbols.items() if name in new}
        column = ca.substitute(
            ca.vertcat(*(row.value for row in rows)), ca.vertcat(*old.values()), ca.vertcat(*(new[name] for name in old))
        )
        for i, row, value in zip(numbers, rows, ca.vertsplit(ca.cse(column)), strict=True):
            self.put(i, row.with_value(value))
            self.work += len(self.held[i].symbols)

    def settle(self) -> tuple[set[int], set[str]]:
        """`touched` and `toggled`, which start anew."""
        touched, toggled = self.touched, self.toggled
        self.touched, self.toggled = set(), set()
        return touched, toggled
