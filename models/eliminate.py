"""Alias elimination and causal sorting: the flat equations in as few variables as plain algebra allows.

Three rules are applied until none fits. x' denotes a derivative, p parameters; "safe" is a coefficient that is a number or an expression of
parameters whose bounds keep it from zero.

    definition   0 = c v + e,  c safe           ->  v := -e/c everywhere, v' := d/dt(-e/c)     (connectors first, body states last)
    rate         0 = c s' + e, no other x'      ->  s' := -e/c in all other rows; the row stays  (it is the kinematics when it reads v - s')
    merging      balance of a body whose motion was replaced by another's, with a force of constraint  ->  solved for that force

Merging puts two rigidly coupled bodies on one row, in one set of coordinates; the residual of the second is then that of the first and is
dropped. A law whose residual is switched on is never used up, nor is an equation that would need the derivative of an input.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca

from .errors import ModelError
from .flatten import FlatEquation, FlatModel

SX = Any


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """What is left: rows over the surviving variables, and every eliminated variable as an expression of them."""

    equations: list[FlatEquation]
    definitions: dict[str, SX]
    merged: dict[str, str]  # place that was dropped -> place that stands for it


class Held:
    """An expression with its symbols and slopes, found once. Symbols it does not depend on, as in (s + x) - s, are dropped."""

    def __init__(self, value: SX) -> None:
        symbols, slopes = _slopes(value)
        idle = [symbol for symbol, slope in zip(symbols, slopes, strict=True) if slope.is_zero()]
        if idle:
            value = ca.substitute([value], idle, [ca.SX(0)] * len(idle))[0]
            symbols, slopes = _slopes(value)
        self.value = value
        self.symbols = {symbol.name(): symbol for symbol in symbols}
        self.slopes = {symbol.name(): slope for symbol, slope in zip(symbols, slopes, strict=True)}

    @cached_property
    def rates(self) -> list[str]:
        """The variables whose derivative occurs."""
        return [name[4:-1] for name in self.symbols if name.startswith("der(")]

    def replaced(self, old: dict[str, SX], new: list[SX]) -> Held:
        """The expression with symbols replaced; itself where none of them occurs."""
        if not any(name in self.symbols for name in old):
            return self
        return Held(ca.substitute([self.value], list(old.values()), new)[0])

    def solved_for(self, name: str) -> SX:
        """0 = c v + e as v = -e/c."""
        return -ca.substitute(self.value, self.symbols[name], 0) / self.slopes[name]


def _slopes(value: SX) -> tuple[list[SX], list[SX]]:
    symbols = ca.symvar(value)
    return symbols, list(ca.horzsplit(ca.densify(ca.jacobian(value, ca.vertcat(*symbols))))) if symbols else []


@dataclass(frozen=True)
class Row:
    """An equation of the flat model and what has become of its residual."""

    equation: FlatEquation
    held: Held


class Eliminator:
    """Works on a private copy of the equations of a flat model. `slots` are the symbols w by place, `known` the inputs."""

    def __init__(self, flat: FlatModel, known: set[str], slots: dict[str, SX]) -> None:
        self.flat, self.known, self.slots = flat, known, slots
        self.slot_names = {symbol.name() for symbol in slots.values()}
        self.rows = [Row(e, Held(e.residual - slots[e.slot[0]] if e.slot and e.slot[0] in slots else e.residual)) for e in flat.equations]
        self.rate_rows: list[Row] = []
        self.definitions: dict[str, Held] = {}
        self.rate_of: dict[str, Held] = {}  # s -> the s' that a kept row defines
        self.merged: dict[str, str] = {}
        self.order = {name: i for i, name in enumerate(flat.variables)}
        self.safe_parameters = {name for name, (declared, _, _) in flat.parameters.items() if declared.min > 0 or declared.max < 0}

    def run(self) -> Reduced:
        """Apply the rules until none fits."""
        while self._define() or self._rate() or self._merge():
            pass
        return Reduced(
            equations=[replace(row.equation, residual=row.held.value) for row in [*self.rate_rows, *self.rows]],
            definitions={name: held.value for name, held in self.definitions.items()},
            merged=self.merged,
        )

    # --- the three rules

    def _define(self) -> bool:
        best: tuple[tuple[int, int, int], int, str] | None = None
        differentiated = self._differentiated()
        for i, row in enumerate(self.rows):
            if row.equation.kind == "balance" or self._place(row) in self.slots:
                continue
            for name in self._defined_by(row.held, differentiated):
                key = (self.flat.variables[name].rank, 0 if _is_unit(row.held.slopes[name]) else 1, -self.order[name])
                if best is None or key < best[0]:
                    best = key, i, name
            if best is not None and best[0][:2] == (0, 0):  # nothing goes before a plain alias of a connector
                break
        if best is None:
            return False
        self._use(best[1], best[2], differentiated)
        return True

    def _rate(self) -> bool:
        best: tuple[tuple[int, int], int, str] | None = None
        for i, row in enumerate(self.rows):
            if row.equation.kind != "equal" or len(row.held.rates) != 1:
                continue
            name = row.held.rates[0]
            if name in self.rate_of or not self._is_safe(row.held.slopes[f"der({name})"]):
                continue
            others = [other for other in self._variables(row.held) if other != name]
            rank = max((self.flat.variables[other].rank for other in others), default=0) + self.flat.variables[name].rank
            key = (-rank, min((self.order[other] for other in others), default=0))
            if best is None or key < best[0]:
                best = key, i, name
        if best is None:
            return False
        _, i, name = best
        row = self.rows.pop(i)
        rate = self.flat.derivatives[name]
        value = row.held.solved_for(f"der({name})")
        self._substitute({rate.name(): rate}, [value])
        self.rate_of[name] = Held(value)
        self.rate_rows.append(Row(row.equation, Held(rate - value)))
        return True

    def _merge(self) -> bool:
        """A balance whose component kept no derivative of its own is solved for a force of constraint."""
        differentiated = self._differentiated()
        moving = {name.partition(".")[0] for name in differentiated}
        for i in reversed(range(len(self.rows))):
            row = self.rows[i]
            if row.equation.kind != "balance" or row.equation.component in moving:
                continue
            place = self._place(row)
            held = row.held.replaced({self.slots[place].name(): self.slots[place]}, [ca.SX(0)]) if place in self.slots else row.held
            names = [name for name in self._defined_by(held, differentiated) if name not in differentiated]
            if not names:
                continue
            name = min(names, key=lambda n: (self.flat.variables[n].rank, -self.order[n]))
            heirs = [
                p for j, other in enumerate(self.rows) if j != i and name in other.held.symbols and (p := self._place(other)) in self.slots
            ]
            if place in self.slots:
                self.merged[place] = heirs[0] if heirs else ""
            self.rows[i] = Row(row.equation, held)
            self._use(i, name, differentiated)
            return True
        return False

    # --- what they share

    def _defined_by(self, held: Held, differentiated: set[str]) -> list[str]:
        """The variables that this row may define."""
        present = held.symbols.keys()
        smooth = not held.rates and not present & self.known and not present & self.slot_names  # may be differentiated
        return [
            name
            for name in self._variables(held)
            if f"der({name})" not in present
            and self._is_safe(held.slopes[name])
            and (name not in differentiated or (smooth and self._keeps_states(held, name, differentiated)))
        ]

    def _keeps_states(self, held: Held, name: str, differentiated: set[str]) -> bool:
        """Whether, `name` being defined by this row, no variable becomes a state that enters nonlinearly and is none yet."""
        return all(other in differentiated or self._is_safe(held.slopes[other]) for other in self._variables(held) if other != name)

    def _use(self, i: int, name: str, differentiated: set[str]) -> None:
        """Eliminate `name` by row i, in all other rows and in the earlier definitions."""
        value = self.rows.pop(i).held.solved_for(name)
        symbol = self.flat.symbols[name]
        old, new = {symbol.name(): symbol}, [value]
        if name in differentiated:
            rate = self.flat.derivatives[name]
            old[rate.name()] = rate
            new.append(self._total_derivative(Held(value)))
        self._substitute(old, new)
        self.definitions[name] = Held(value)

    def _substitute(self, old: dict[str, SX], new: list[SX]) -> None:
        self.rows = [Row(row.equation, row.held.replaced(old, new)) for row in self.rows]
        self.rate_rows = [Row(row.equation, row.held.replaced(old, new)) for row in self.rate_rows]
        self.definitions = {name: held.replaced(old, new) for name, held in self.definitions.items()}
        self.rate_of = {name: held.replaced(old, new) for name, held in self.rate_of.items()}

    def _total_derivative(self, held: Held) -> SX:
        total = ca.SX(0)
        for name, slope in held.slopes.items():
            if name == "time":
                total += slope
            elif name in self.rate_of:
                total += slope * self.rate_of[name].value
            elif name in self.flat.variables:
                total += slope * self.flat.derivatives.setdefault(name, ca.SX.sym(f"der({name})"))
        return total

    def _differentiated(self) -> set[str]:
        """Variables whose derivative occurs anywhere."""
        every = [
            *(row.held for row in self.rows),
            *(row.held for row in self.rate_rows),
            *self.definitions.values(),
            *self.rate_of.values(),
        ]
        return {name for held in every for name in held.rates}

    def _variables(self, held: Held) -> Iterable[str]:
        return [name for name in held.symbols if name in self.flat.variables and name not in self.known]

    def _place(self, row: Row) -> str:
        return row.equation.slot[0] if row.equation.slot else ""

    def _is_safe(self, coefficient: SX) -> bool:
        if coefficient.is_constant():
            return float(coefficient) != 0.0
        product = _factors(coefficient)
        return product is not None and product <= self.safe_parameters


def _is_unit(coefficient: SX) -> bool:
    return bool(coefficient.is_constant()) and abs(float(coefficient)) == 1.0


def _factors(expression: SX) -> set[str] | None:
    """The parameters of a product or quotient, None for anything else."""
    if expression.is_constant():
        return set() if float(expression) != 0.0 else None
    if expression.is_symbolic():
        return {expression.name()}
    if expression.op() in (ca.OP_MUL, ca.OP_DIV):
        parts = [_factors(expression.dep(i)) for i in range(2)]
        return None if parts[0] is None or parts[1] is None else parts[0] | parts[1]
    if expression.op() in (ca.OP_NEG, ca.OP_SQ, ca.OP_INV, ca.OP_TWICE):
        return _factors(expression.dep(0))
    return None


def clean(expression: SX) -> SX:
    """The expression without the symbols it does not depend on."""
    return Held(expression).value


def refuse_dropped(place: str, merged: dict[str, str]) -> ModelError:
    """The error for a place that was asked for and has no row of its own."""
    other = merged[place]
    return ModelError(
        f"place '{place}' has no residual of its own: it moves rigidly with '{other}', whose residual stands for both; "
        f"ask for '{other}' instead"
    )
