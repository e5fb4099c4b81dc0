"""Equations indexed by the symbols they hold, so that a substitution visits only the rows that hold what is replaced.

`where[name]` is the set of rows that hold the symbol of that name. With rows that hold a few symbols each, eliminating all n variables of a
model costs O(n) substitutions; tables of all rows against all variables would cost O(n^2). Common subexpressions are shared as they appear:
a train of n gears would otherwise hold n products of up to n ratios.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from functools import cached_property
from typing import Any

import casadi as ca

SX = Any


class Held:
    """An expression with its symbols and slopes, found once. Symbols it does not depend on, as in (s + x) - s, are dropped.

    `fixed` names symbols that are left alone and not listed: the parameters.
    """

    def __init__(self, value: SX, fixed: Container[str] = ()) -> None:
        symbols, slopes = _slopes(value, fixed)
        idle = [symbols.pop(name) for name, slope in slopes.items() if slope.is_zero() and not _steps(value, symbols[name])]
        if idle:
            value = ca.substitute(value, ca.vertcat(*idle), ca.DM.zeros(len(idle)))
            symbols, slopes = _slopes(value, fixed)
        self.value, self.symbols, self.slopes, self.fixed = value, symbols, slopes, fixed

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
        return Held(ca.substitute(self.value, old, ca.vertcat(*(new[name] for name in names))), self.fixed)

    def solved_for(self, name: str) -> SX:
        """0 = c v + e as v = -e/c."""
        return -ca.substitute(self.value, self.symbols[name], 0) / self.slopes[name]


def _steps(value: SX, symbol: SX) -> bool:
    """Whether the value depends on a symbol by steps, sgn(v): its slope is zero and it matters all the same."""
    node = ca.Function("node", [ca.vertcat(*ca.symvar(value))], [value])
    stepping = (ca.OP_SIGN, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_FLOOR, ca.OP_CEIL)
    return any(node.instruction_id(i) in stepping for i in range(node.n_instructions())) and ca.depends_on(value, symbol)


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
            self.put(i, Held(value, row.fixed))
            self.work += len(self.held[i].symbols)

    def settle(self) -> tuple[set[int], set[str]]:
        """`touched` and `toggled`, which start anew."""
        touched, toggled = self.touched, self.toggled
        self.touched, self.toggled = set(), set()
        return touched, toggled
