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

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import casadi as ca

from ..errors import ModelError
from .candidates import DEFINITION, KEPT, MERGING, RATE, Candidates, place_of
from .flat import FlatEquation, FlatModel, FlatVariable
from .rows import Held, Rows

SX = Any


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """What is left: rows over the surviving variables, and every eliminated variable as an expression of them.

    flat         the flat model without the coordinates that were pruned, and with the rates that were made variables instead
    definitions  may name a pruned coordinate
    merged       place that was dropped -> places of the equations that its force went into
    """

    flat: FlatModel
    equations: list[FlatEquation]
    definitions: dict[str, SX]
    merged: dict[str, list[str]]


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
        self.equations = dict(enumerate(flat.equations))  # not used up, by number of the row
        self.rate_rows: dict[str, int] = {}  # s -> the row that keeps s' = ...
        self.rate_equations: dict[str, FlatEquation] = {}
        self.watched: dict[str, int] = {}  # definitions kept up to date: those with derivatives, and of what is measured
        self.definitions: dict[str, SX] = {}  # in order of elimination; each may name variables that were eliminated after it
        self.merged: dict[str, list[str]] = {}
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
            merged=self.merged,
        )

    # --- the four rules

    def _define(self, i: int, name: str) -> None:
        """Eliminate `name` by row i, unless the row is to be used for the rate."""
        if not self._is_velocity(i, name):
            self._eliminate(i, name)

    def _eliminate(self, i: int, name: str) -> None:
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
        rate, value = self._derivative(name), self._use(i).solved_for(f"der({name})")
        self.rows.substitute({rate.name(): value})
        self.rate_rows[name] = self._add(self._held(rate - value))

    def _merge(self, i: int, name: str) -> None:
        """A balance whose component kept no derivative of its own is solved for a force of constraint."""
        place = place_of(self.equations[i])
        if place in self.slots:
            others = [place_of(self.equations[j]) for j in sorted(self.rows.where[name] & self.equations.keys()) if j != i]
            self.merged[place] = [other for other in others if other in self.slots]
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

    def _use(self, i: int) -> Held:
        del self.equations[i]
        return self.rows.take(i)

    def _add(self, held: Held) -> int:
        i = next(self.numbers)
        self.rows.put(i, held)
        return i

    def _held(self, value: SX) -> Held:
        return Held(value, self.flat.parameters)

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


def standing(merged: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """For every place that was dropped the first that its force still acts on, through others that were dropped; "" for none."""
    found = {}
    for place in merged:
        front, seen = [place], {place}
        while front and front[0] in merged:
            behind = [other for other in merged[front.pop(0)] if other not in seen]
            front += behind
            seen.update(behind)
        found[place] = front[0] if front else ""
    return found


def refuse_dropped(place: str, merged: Mapping[str, Sequence[str]]) -> ModelError:
    """The error for a place that was asked for and has no row of its own."""
    other = standing(merged)[place]
    if not other:
        return ModelError(f"place '{place}' has no residual: what holds it takes any force there; ask for another place")
    return ModelError(
        f"place '{place}' has no residual of its own: it moves rigidly with '{other}', whose residual stands for both; "
        f"ask for '{other}' instead"
    )
