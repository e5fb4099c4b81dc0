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

from dataclasses import dataclass, replace
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
    definition_rates: dict[str, SX]  # der(name) of eliminated variables, where it was needed
    merged: dict[str, str]  # place that was dropped -> place that stands for it


class Eliminator:
    """Works on a private copy of the equations of a flat model. `slots` are the symbols w by place, `known` the inputs."""

    def __init__(self, flat: FlatModel, known: set[str], slots: dict[str, SX]) -> None:
        self.flat, self.known, self.slots = flat, known, slots
        self.equations = [self._with_slot(e) for e in flat.equations]
        self.definitions: dict[str, SX] = {}
        self.rates: dict[str, SX] = {}
        self.merged: dict[str, str] = {}
        self.rate_of: dict[str, SX] = {}  # der(s) that a kept row defines
        self.rate_rows: list[FlatEquation] = []
        self.order = {name: i for i, name in enumerate(flat.variables)}
        self.safe_parameters = {name for name, (declared, _, _) in flat.parameters.items() if declared.min > 0 or declared.max < 0}

    def _with_slot(self, e: FlatEquation) -> FlatEquation:
        return replace(e, residual=e.residual - self.slots[e.slot[0]]) if e.slot and e.slot[0] in self.slots else e

    def run(self) -> Reduced:
        """Apply the rules until none fits."""
        while self._define() or self._rate() or self._merge():
            pass
        return Reduced(
            equations=[*self.rate_rows, *self.equations], definitions=self.definitions, definition_rates=self.rates, merged=self.merged
        )

    # --- the three rules

    def _define(self) -> bool:
        best: tuple[tuple[int, int, int], int, str] | None = None
        differentiated = self._differentiated()
        for row, equation in enumerate(self.equations):
            if equation.kind == "balance" or (equation.slot and equation.slot[0] in self.slots):
                continue
            for name in self._defined_by(equation.residual, differentiated):
                key = (self.flat.variables[name].rank, 0 if self._is_unit(equation.residual, name) else 1, -self.order[name])
                if best is None or key < best[0]:
                    best = key, row, name
            if best is not None and best[0][:2] == (0, 0):
                break
        if best is None:
            return False
        self._use(best[1], best[2])
        return True

    def _rate(self) -> bool:
        best: tuple[tuple[int, int], int, str, SX] | None = None
        for row, equation in enumerate(self.equations):
            rates = [s for s in ca.symvar(equation.residual) if s.name().startswith("der(")]
            if equation.kind != "equal" or len(rates) != 1 or rates[0].name() in self.rate_of:
                continue
            name = rates[0].name()[4:-1]
            coefficient = ca.jacobian(equation.residual, rates[0])
            if not self._is_safe(coefficient):
                continue
            others = [s.name() for s in ca.symvar(equation.residual) if s.name() in self.flat.variables and s.name() not in self.known]
            rank = max((self.flat.variables[other].rank for other in others if other != name), default=0)
            key = (-rank - self.flat.variables[name].rank, min((self.order[other] for other in others), default=0))
            if best is None or key < best[0]:
                best = key, row, name, coefficient
        if best is None:
            return False
        _, row, name, coefficient = best
        equation = self.equations.pop(row)
        rate = self.flat.derivatives[name]
        value = -ca.substitute(equation.residual, rate, 0) / coefficient
        self.rate_rows.append(replace(equation, residual=rate - value))
        self.rate_of[f"der({name})"] = value
        self._substitute([rate], [value], keep_rates=True)
        return True

    def _merge(self) -> bool:
        """A balance whose component kept no derivative of its own is solved for a force of constraint."""
        differentiated = self._differentiated()
        moving = {name.partition(".")[0] for name in differentiated if name not in self.definitions}
        for row in reversed(range(len(self.equations))):
            equation = self.equations[row]
            if equation.kind != "balance" or equation.component in moving:
                continue
            residual = equation.residual
            place = equation.slot[0] if equation.slot else ""
            if place in self.slots:
                residual = ca.substitute(residual, self.slots[place], 0)
            names = [name for name in self._defined_by(residual, differentiated) if name not in differentiated]
            if not names:
                continue
            name = min(names, key=lambda n: (self.flat.variables[n].rank, -self.order[n]))
            self.equations[row] = replace(equation, residual=residual)
            heirs = [
                other.slot[0]
                for i, other in enumerate(self.equations)
                if i != row and other.slot and self.slots.keys() >= {other.slot[0]} and self._mentions(other.residual, name)
            ]
            if place:
                self.merged[place] = heirs[0] if heirs else ""
            self._use(row, name)
            return True
        return False

    # --- what they share

    def _defined_by(self, residual: SX, differentiated: set[str]) -> list[str]:
        """The variables that this row may define."""
        symbols = ca.symvar(residual)
        present = {s.name() for s in symbols}
        dynamic = any(name.startswith("der(") for name in present)
        slots = {s.name() for s in self.slots.values()}
        fixed = not dynamic and not present & self.known and not present & slots  # may be differentiated
        found = []
        for symbol in symbols:
            name = symbol.name()
            if name not in self.flat.variables or name in self.known or f"der({name})" in present:
                continue
            if name in differentiated and not (fixed and self._keeps_states(residual, name, differentiated)):
                continue
            if self._is_safe(ca.jacobian(residual, symbol)):
                found.append(name)
        return found

    def _keeps_states(self, residual: SX, name: str, differentiated: set[str]) -> bool:
        """Whether defining a differentiated variable by this row makes no state of a variable that enters it nonlinearly and is none yet."""
        others = [s for s in ca.symvar(residual) if s.name() in self.flat.variables and s.name() not in (name, *differentiated)]
        return all(ca.jacobian(residual, other).is_constant() or self._is_safe(ca.jacobian(residual, other)) for other in others)

    def _use(self, row: int, name: str) -> None:
        """Eliminate `name` by the equation at `row`, in all other rows and in the earlier definitions."""
        equation, symbol = self.equations.pop(row), self.flat.symbols[name]
        value = -ca.substitute(equation.residual, symbol, 0) / ca.jacobian(equation.residual, symbol)
        old, new = [symbol], [value]
        if name in self.flat.derivatives and f"der({name})" in self._present():
            old.append(self.flat.derivatives[name])
            new.append(self._total_derivative(value))
            self.rates[name] = new[-1]
        self._substitute(old, new)
        self.definitions[name] = value

    def _substitute(self, old: list[SX], new: list[SX], keep_rates: bool = False) -> None:
        rows = [e.residual for e in self.equations]
        kept = [] if keep_rates else [e.residual for e in self.rate_rows]
        known = [*self.definitions.values(), *self.rates.values(), *self.rate_of.values()]
        results = [clean(e) for e in ca.substitute([*rows, *kept, *known], old, new)]
        self.equations = [replace(e, residual=r) for e, r in zip(self.equations, results, strict=False)]
        del results[: len(rows)]
        if kept:
            self.rate_rows = [replace(e, residual=r) for e, r in zip(self.rate_rows, results, strict=False)]
            del results[: len(kept)]
        for table in (self.definitions, self.rates, self.rate_of):
            for key in table:
                table[key] = results.pop(0)

    def _total_derivative(self, expression: SX) -> SX:
        total = ca.SX(0)
        for symbol in ca.symvar(expression):
            name = symbol.name()
            if name == "time":
                total += ca.jacobian(expression, symbol)
            elif name in self.flat.variables:
                rate = self.rate_of.get(f"der({name})")
                if rate is None:
                    rate = self.flat.derivatives.setdefault(name, ca.SX.sym(f"der({name})"))
                total += ca.jacobian(expression, symbol) * rate
        return total

    def _present(self) -> set[str]:
        rows = [e.residual for e in [*self.equations, *self.rate_rows]]
        every = [*rows, *self.definitions.values(), *self.rates.values(), *self.rate_of.values()]
        return {s.name() for s in ca.symvar(ca.vertcat(*every))}

    def _differentiated(self) -> set[str]:
        """Variables whose derivative occurs anywhere."""
        return {name[4:-1] for name in self._present() if name.startswith("der(")}

    def _mentions(self, expression: SX, name: str) -> bool:
        return any(s.name() == name for s in ca.symvar(expression))

    def _is_unit(self, residual: SX, name: str) -> bool:
        coefficient = ca.jacobian(residual, self.flat.symbols[name])
        return bool(coefficient.is_constant()) and abs(float(coefficient)) == 1.0

    def _is_safe(self, coefficient: SX) -> bool:
        if coefficient.is_constant():
            return float(coefficient) != 0.0
        product = _factors(coefficient)
        return product is not None and product <= self.safe_parameters


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
    """The expression without the symbols it does not depend on, as in (s + x) - s."""
    for symbol in ca.symvar(expression):
        slope = ca.jacobian(expression, symbol)
        if slope.nnz() == 0 or (slope.is_constant() and float(slope) == 0.0):
            expression = ca.substitute(expression, symbol, 0)
    return expression


def refuse_dropped(place: str, merged: dict[str, str]) -> ModelError:
    """The error for a place that was asked for and has no row of its own."""
    other = merged[place]
    return ModelError(
        f"place '{place}' has no residual of its own: it moves rigidly with '{other}', whose residual stands for both; "
        f"ask for '{other}' instead"
    )
