"""Alias elimination and causal sorting: the flat equations in as few variables as plain algebra allows.

Three rules are applied until none fits, then the fourth, and so on. x' denotes a derivative; "safe" is a coefficient that is a number or a
product of parameters whose bounds keep it from zero.

    definition   0 = c v + e,  c safe           ->  v := -e/c everywhere, v' := d/dt(-e/c)     (connectors first, body states last)
    rate         0 = c s' + e, no other x'      ->  s' := -e/c in all other rows; the row stays  (it is the kinematics when it reads v - s')
    merging      balance of a body whose motion was replaced by another's, with a force of constraint  ->  solved for that force
    pruning      s is nobody's declared state and only s' is left, an ignorable coordinate  ->  s' becomes a variable of its own

Merging puts two rigidly coupled bodies on one row, in one set of coordinates; the residual of the second is then that of the first and is
dropped. A law whose residual is switched on is never used up, nor is an equation that would need the derivative of an input.

Only the rows that hold a variable are touched when it goes, and definitions are put into each other at the end, last to first: the cost
grows with the number of equations.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import casadi as ca

from .candidates import DEFINITION, KEPT, MERGING, RATE, Candidates, place_of
from .flat import FlatEquation, FlatModel, FlatVariable
from .rows import Held, Rows, is_smooth

SX = Any


@dataclass(frozen=True, kw_only=True)
class Heirs:
    """Where a residual acts whose equation was used up.

    left  origins of the equations that are left, nearest first
    laws  places of laws that were used up on the way there, then of those of joints that went into the same equations
    """

    left: tuple[str, ...]
    laws: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """What is left: rows over the surviving variables, and every eliminated variable as an expression of them.

    flat         the flat model without the coordinates that were pruned, and with the rates that were made variables instead
    definitions  may name a pruned coordinate
    merged       place that was dropped -> where its force went
    """

    flat: FlatModel
    equations: list[FlatEquation]
    definitions: dict[str, SX]
    merged: dict[str, Heirs]


class Eliminator:
    """Works on a private copy of the equations of a flat model.

    known   the inputs, by variable
    slots   the symbols w by place
    kept    variables that are measured: never pruned
    states  variables that are to stay states where there is a choice: never pruned, eliminated last
    """

    def __init__(
        self, flat: FlatModel, known: set[str], slots: dict[str, SX], kept: Collection[str] = (), states: Collection[str] = ()
    ) -> None:
        self.flat = replace(flat, variables=dict(flat.variables), symbols=dict(flat.symbols), derivatives=dict(flat.derivatives))
        self.known, self.slots = known, slots
        self.measured, self.kept = set(kept), {*kept, *states, *known}
        self.rows, self.numbers = Rows(), count(len(flat.equations))
        self.smooth = is_smooth(ca.vertcat(*(e.residual for e in flat.equations)))
        self.equations = dict(enumerate(flat.equations))  # not used up, by number of the row
        self.rate_rows: dict[str, int] = {}  # s -> the row that keeps s' = ...
        self.rate_equations: dict[str, FlatEquation] = {}
        self.watched: dict[str, int] = {}  # definitions kept up to date: those with derivatives, and of what is measured
        self.definitions: dict[str, SX] = {}  # in order of elimination; each may name variables that were eliminated after it
        self.merged: dict[str, int] = {}  # place that was dropped -> its row
        self.went: dict[int, list[int]] = {}  # row that was used up -> the rows that held what it was used for
        for i, e in self.equations.items():
            place = place_of(e)
            self.rows.put(i, self._held(e.residual - slots[place] if place in slots else e.residual))
        self.candidates = Candidates(self.flat, known, slots, states, self.rows, self.equations, self.rate_rows)

    def run(self) -> Reduced:
        """Apply the rules until none fits."""
        rules = {DEFINITION: self._define, RATE: self._rate, MERGING: self._merge}
        while (pick := self.candidates.next()) or self._prune():
            if pick:
                rule, i, name = pick
                rules[rule](i, name)
        rate_rows = [replace(e, residual=self.rows.held[self.rate_rows[name]].value) for name, e in self.rate_equations.items()]
        return Reduced(
            flat=self.flat,
            equations=[*rate_rows, *(replace(e, residual=self.rows.held[i].value) for i, e in self.equations.items())],
            definitions=self._resolved(),
            merged=self._heirs(),
        )

    # --- the four rules

    def _define(self, i: int, name: str) -> None:
        """Eliminate `name` by row i, unless the row is to be used for the rate."""
        if not self._is_velocity(i, name):
            self._eliminate(i, name)

    def _eliminate(self, i: int, name: str) -> None:
        self._passes_to(i, self.rows.where[name])
        value = self._use(i).solved_for(name)
        new = {name: value}
        held = self._held(value)
        if self.candidates.differentiated(name):
            new[f"der({name})"] = self._total_derivative(held)
        self.rows.substitute(new)
        self.definitions[name] = value
        if held.rates or name in self.measured:
            self.watched[name] = self._add(held)

    def _rate(self, i: int, name: str) -> None:
        """Use the row as s' = ... in all other rows, and keep it."""
        self.rate_equations[name] = self.equations[i]
        rate = self._derivative(name)
        holders = self.rows.where[rate.name()]
        value = self._use(i).solved_for(rate.name())
        self.rows.substitute({rate.name(): value})
        self.rate_rows[name] = self._add(self._held(rate - value))
        self._passes_to(i, {self.rate_rows[name], *holders})

    def _merge(self, i: int, name: str) -> None:
        """A balance whose component kept no derivative of its own is solved for a force of constraint."""
        place = place_of(self.equations[i])
        if place in self.slots:
            self.merged[place] = i
            self.rows.put(i, self.rows.held[i].replaced({self.slots[place].name(): ca.SX(0)}))
        self._eliminate(i, name)

    def _is_velocity(self, i: int, name: str) -> bool:
        """Whether row i makes a velocity that is to be kept the rate of a coordinate that other rows hold, too."""
        rates = self.rows.held[i].rates
        return self.candidates.rank[name] >= KEPT and len(rates) == 1 and not self.rows.where.get(rates[0], set()) <= {i}

    def _prune(self) -> bool:
        """Remove coordinates of which only the derivative is left; whether there was one."""
        idle = {self.watched[name] for name in self.watched.keys() - self.measured}

        def used(symbol: str) -> bool:
            return not self.rows.where.get(symbol, idle) <= idle

        names = [n for n in self.flat.variables if self.candidates.rank[n] < 2 and n not in self.kept and used(f"der({n})") and not used(n)]
        for name in names:
            if name in self.rate_rows:
                del self.rate_equations[name]
                self.rows.take(self.rate_rows.pop(name))
            else:
                self.rows.substitute({f"der({name})": self._ordinary(name)})
            del self.flat.variables[name]
        return bool(names)

    # --- what they share

    def _passes_to(self, i: int, others: Collection[int]) -> None:
        self.went[i] = sorted(set(others) - {i})

    def _heirs(self) -> dict[str, Heirs]:
        """Where the residuals of the merged balances act."""
        kept = {row: self.rate_equations[name] for name, row in self.rate_rows.items()} | self.equations
        laws = {row: place_of(e) for row, e in enumerate(self.flat.equations) if e.kind == "law" and row in self.went}
        joints = {name.partition(".")[0] for name, variable in self.flat.variables.items() if variable.rank >= KEPT}
        of_joints = {row: set(self._way(row)) for row in laws if self.flat.equations[row].component in joints}
        found = {}
        for place, i in self.merged.items():
            way = self._way(i)
            left = [row for row in way if row in kept]
            near = [row for row, reached in of_joints.items() if not reached.isdisjoint(left)]
            passed = dict.fromkeys([*(row for row in way if row in laws), *near])
            found[place] = Heirs(left=tuple(kept[row].origin for row in left), laws=tuple(laws[row] for row in passed))
        return found

    def _way(self, i: int) -> list[int]:
        """Row i and the rows that it went into, nearest first."""
        way = {i: None}
        front = [i]
        for row in front:  # which grows
            new = [j for j in self.went.get(row, ()) if j not in way]
            way |= dict.fromkeys(new)
            front += new
        return front

    def _use(self, i: int) -> Held:
        del self.equations[i]
        return self.rows.take(i)

    def _add(self, held: Held) -> int:
        i = next(self.numbers)
        self.rows.put(i, held)
        return i

    def _held(self, value: SX) -> Held:
        return Held(value, self.flat.parameters, smooth=self.smooth)

    def _derivative(self, name: str) -> SX:
        return self.flat.derivatives.setdefault(name, ca.SX.sym(f"der({name})"))

    def _ordinary(self, name: str) -> SX:
        """A variable in place of the derivative of `name`."""
        own = f"{name}'"
        self.flat.variables[own] = FlatVariable(name=own, unit=f"{self.flat.variables[name].unit}/s", rank=0)
        self.flat.symbols[own] = ca.SX.sym(own)
        self.candidates.add(own, rank=0)
        return self.flat.symbols[own]

    def _total_derivative(self, held: Held) -> SX:
        total = ca.SX(0)
        for name, slope in held.slopes.items():
            if name == "time":
                total += slope
            elif name in self.rate_rows:
                total += slope * self.rows.held[self.rate_rows[name]].solved_for(f"der({name})")
            elif name in self.flat.variables:
                total += slope * self._derivative(name)
        return total

    def _resolved(self) -> dict[str, SX]:
        """The definitions in terms of what survived."""
        done: dict[str, tuple[SX, dict[str, SX]]] = {}  # with the symbols
        for name, value in reversed(self.definitions.items()):
            if name in self.watched:
                held = self.rows.held[self.watched[name]]
                done[name] = held.value, held.symbols
                continue
            symbols = {own: s for s in ca.symvar(value) if (own := s.name()) not in self.flat.parameters}
            old = [done[other] for other in symbols if other in done]
            if old:
                value = ca.substitute(
                    value, ca.vertcat(*(symbols[n] for n in symbols if n in done)), ca.vertcat(*(part for part, _ in old))
                )
                parts = [{n: s for n, s in symbols.items() if n not in done}, *(part for _, part in old)]
                symbols = {n: s for part in parts for n, s in part.items()}
                if len(symbols) < sum(map(len, parts)):  # something may cancel
                    held = self._held(value)
                    value, symbols = held.value, held.symbols
            done[name] = value, symbols
        return {name: done[name][0] for name in self.definitions}


def clean(expression: SX) -> SX:
    """The expression without the symbols it does not depend on."""
    return Held(expression).value
