"""What each row may be used for, and which goes first.

The candidates wait in a heap, the least key on top. A step of elimination looks again only at the rows that it changed and at those of
variables that came to be, or ceased to be, differentiated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from heapq import heappop, heappush
from typing import Any

import casadi as ca

from .flat import FlatEquation, FlatModel
from .rows import Held, Rows

SX = Any
DEFINITION, RATE, MERGING = range(3)
KEPT = 3  # rank from which a velocity stays a variable beside its coordinate: joints, and what the model names as states


class Candidates:
    """Rows are judged by what they hold, `equations` are those not used up by row, `rate_rows` the variables whose rate a row keeps.

    rank   of a variable: the least is eliminated first
    order  of a variable: where it was declared
    """

    def __init__(
        self,
        flat: FlatModel,
        known: set[str],
        slots: Mapping[str, SX],
        states: Collection[str],
        rows: Rows,
        equations: dict[int, FlatEquation],
        rate_rows: Mapping[str, int],
    ) -> None:
        self.flat, self.known, self.rows, self.equations, self.rate_rows = flat, known, rows, equations, rate_rows
        self.slots, self.slot_names = slots, {symbol.name() for symbol in slots.values()}
        self.safe_parameters = {name for name, (p, _, _) in flat.parameters.items() if p.min > 0 or p.max < 0 or p.nonzero}
        wanted = {*states, *_rates_of(flat, states)}
        self.rank = {name: KEPT + 1 if name in wanted else variable.rank for name, variable in flat.variables.items()}
        self.order = {name: i for i, name in enumerate(flat.variables)}
        self.heap: list[tuple[tuple[int, ...], int, int, str]] = []  # key, row, version of the row, variable
        self.version: Counter[int] = Counter()
        self.moving: Counter[str] = Counter()  # component -> how many of its variables are differentiated
        self.balances: dict[str, list[int]] = {}
        for i, e in equations.items():
            if e.kind == "balance":
                self.balances.setdefault(e.component, []).append(i)

    def next(self) -> tuple[int, int, str] | None:
        """The rule, row and variable that go first; None when no rule fits."""
        self._look_again()
        while self.heap:
            (rule, *_), i, version, name = heappop(self.heap)
            if version == self.version[i] and i in self.equations:
                return rule, i, name
        return None

    def add(self, name: str, rank: int) -> None:
        """A new variable, declared last."""
        self.rank[name], self.order[name] = rank, len(self.order)

    def _look_again(self) -> None:
        """Judge anew the rows that changed, and those whose judgement rests on what is differentiated."""
        touched, toggled = self.rows.settle()
        for rate in toggled:
            if not rate.startswith("der("):
                continue
            name = rate[4:-1]
            touched |= self.rows.where.get(name, set())
            component = name.partition(".")[0]
            before = self.moving[component]
            self.moving[component] += 1 if rate in self.rows.where else -1
            if not before or not self.moving[component]:
                touched.update(self.balances.get(component, ()))
        for i in sorted(touched & self.equations.keys()):
            self.version[i] += 1
            for key, name in self._candidates(i):
                heappush(self.heap, (key, i, self.version[i], name))

    def _candidates(self, i: int) -> Iterator[tuple[tuple[int, ...], str]]:
        """What row i may be used for, each with its key: the least key of all rows goes first."""
        equation, held = self.equations[i], self.rows.held[i]
        if equation.kind != "balance" and place_of(equation) not in self.slots:
            keys = [(self._definition_key(i, name, held), name) for name in self._defined_by(held)]
            if keys:
                yield min(keys)
        if equation.kind == "equal" and len(held.rates) == 1:
            name = held.rates[0]
            if name not in self.rate_rows and self._is_safe(held.slopes[f"der({name})"]) and f"der({name})" not in held.steps:
                others = [other for other in self._unknowns(held) if other != name]
                rank = max((self.rank[other] for other in others), default=0) + self.rank[name]
                own = 0 if name.startswith(f"{equation.component}.") else 1
                yield (RATE, -rank, own, min((self.order[other] for other in others), default=0), i), name
        if equation.kind == "balance" and not self.moving[equation.component]:
            names = [name for name in self._defined_by(held) if not self.differentiated(name)]
            if names:
                yield (MERGING, -i), min(names, key=lambda name: (self.rank[name], -self.order[name]))

    def _definition_key(self, i: int, name: str, held: Held) -> tuple[int, ...]:
        """Least rank first, unit coefficients first, last declared first; but connectors in the order of the rows, aliases first.

        Aliases a = b do not lengthen other rows; a sum of three such as s_rel = a - b used before them would grow along a chain. Of rows
        that may define the same variable those go last that hold derivatives and belong to another component: a lag stays as it is whatever
        its input comes from.
        """
        rank, other = self.rank[name], 0 if _is_unit(held.slopes[name]) else 1
        plain = len(held.symbols) > 2, i, -self.order[name]
        foreign = bool(held.rates) and not name.startswith(f"{self.equations[i].component}.")
        return (DEFINITION, rank, other, *((-self.order[name], foreign, i) if rank or other else plain))

    def _defined_by(self, held: Held) -> list[str]:
        """The variables that this row may define."""
        present = held.symbols.keys()
        unknowns = self._unknowns(held)
        safe = {name for name in unknowns if self._is_safe(held.slopes[name])}
        safe -= held.steps if safe else set()
        differentiable = (
            not held.rates
            and not present & self.known
            and not present & self.slot_names
            and all(name in safe or self.differentiated(name) or self.rank[name] >= KEPT for name in unknowns)  # no new nonlinear state
        )
        return [
            name
            for name in unknowns
            if name in safe and f"der({name})" not in present and (differentiable or not self.differentiated(name))
        ]

    def differentiated(self, name: str) -> bool:
        """Whether the derivative of the variable occurs anywhere."""
        return f"der({name})" in self.rows.where

    def _unknowns(self, held: Held) -> list[str]:
        return [name for name in held.symbols if name in self.flat.variables and name not in self.known]

    def _is_safe(self, coefficient: SX) -> bool:
        """Whether it is a product or quotient of safe parameters and numbers other than zero."""
        factors = [coefficient]
        for factor in factors:  # which grows
            operation = factor.op()
            if operation in (ca.OP_MUL, ca.OP_DIV):
                factors += [factor.dep(0), factor.dep(1)]
            elif operation in (ca.OP_NEG, ca.OP_SQ, ca.OP_INV, ca.OP_TWICE):
                factors.append(factor.dep(0))
            elif operation == ca.OP_PARAMETER:
                if factor.name() not in self.safe_parameters:
                    return False
            elif operation != ca.OP_CONST or float(factor) == 0.0:
                return False
        return True


def place_of(equation: FlatEquation) -> str:
    """The place of an equation, "" where it has none."""
    return equation.slot[0] if equation.slot else ""


def _rates_of(flat: FlatModel, states: Collection[str]) -> set[str]:
    """The variables v of the rows v = s' for these s."""
    rates = {f"der({name})" for name in states}
    pairs = [set(e.held) for e in flat.equations if e.kind == "equal"]
    return {name for pair in pairs if len(pair) == 2 and pair & rates for name in pair - rates if name in flat.variables}


def _is_unit(coefficient: SX) -> bool:
    return bool(coefficient.is_constant()) and abs(float(coefficient)) == 1.0
