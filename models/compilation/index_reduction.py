"""Index reduction of what elimination left implicit: constraints between states, a Cartesian pendulum, a closed loop.

While the equations do not determine the highest derivatives, those of the over-determined part are differentiated (C. C. Pantelides, SIAM
J. Sci. Stat. Comput. 9, 1988); what was differentiated stays as an invariant. A derivative follows the kinematics that the model states,
x' = v(x), so constraints are differentiated in the model's own velocities and no derivative becomes a variable without need.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ..errors import ModelError
from .eliminate import clean
from .flat import FlatEquation
from .rows import steps
from .structure import fault, incidence

SX = Any
_ORDINALS = ("", "derivative of ", "second derivative of ", "third derivative of ", "fourth derivative of ")


@dataclass(frozen=True, kw_only=True, eq=False)
class Semi:
    """Rows over states x (with dx) and algebraics z; names run parallel to the symbols."""

    x: list[SX]
    dx: list[SX]
    z: list[SX]
    equations: list[FlatEquation]
    invariants: list[FlatEquation]
    index: int


def kinematics(system: Semi) -> dict[str, tuple[int, SX]]:
    """State -> (row, v) for every row that reads 0 = c (x' - v) with no other derivative in v, x' being in no other row."""
    held = [set(e.held) for e in system.equations]
    rates = {dx.name(): x.name() for x, dx in zip(system.x, system.dx, strict=True)}
    symbols = {dx.name(): dx for dx in system.dx}
    found = {}
    for i, equation in enumerate(system.equations):
        own = [name for name in held[i] if name in rates]
        if equation.kind != "equal" or len(own) != 1 or sum(own[0] in other for other in held) > 1:
            continue
        slope = ca.jacobian(equation.residual, symbols[own[0]])
        if slope.is_constant() and own[0] not in steps(equation.residual):
            found[rates[own[0]]] = i, -ca.substitute(equation.residual, symbols[own[0]], 0) / slope
    return found


def reduce_index(system: Semi, time: SX) -> Semi:
    """The system with its constraints differentiated as often as needed, and the constraints themselves as invariants.

    All other symbols (inputs, parameters, residuals) are taken as constant: the caller checks that no invariant holds an input or residual.
    Raises ModelError when the equations have no finite index.
    """
    work = _Differentiation(system, time)
    while work.differentiate():
        pass
    return work.result()


class _Differentiation:
    """Rows that determine the highest derivatives, beside the kinematic rows, while they are being differentiated."""

    def __init__(self, system: Semi, time: SX) -> None:
        self.time, self.declared = time.name(), system.equations
        explicit = kinematics(system)
        chosen = {row for row, _ in explicit.values()}
        self.explicit = {name: value for name, (_, value) in explicit.items()}
        self.kinematic = [system.equations[row] for row in sorted(chosen)]
        self.rows = [(e, 0, e) for i, e in enumerate(system.equations) if i not in chosen]  # row, times differentiated, declared as
        self.x, self.dx, self.z = list(system.x), list(system.dx), list(system.z)
        self.invariants: list[FlatEquation] = []

    def differentiate(self) -> bool:
        """Differentiate the over-determined rows once; False where there are none."""
        highest = [dx for x, dx in zip(self.x, self.dx, strict=True) if x.name() not in self.explicit]
        unknown = {symbol.name(): i for i, symbol in enumerate([*highest, *self.z])}
        over = fault(incidence([row for row, _, _ in self.rows], unknown))[0]
        for i in over:
            row, times, origin = self.rows[i]
            if times + 1 == len(_ORDINALS):
                raise ModelError(
                    f"the equations {_origins(self.declared)} have no finite index: '{origin.origin}' and its derivatives determine "
                    "nothing; a constraint is stated twice, or a variable is free"
                )
            self._prepare(row.held)
            row = self.rows[i][0]
            derivative = clean(self._derivative(row.residual))
            self.invariants.append(row)
            named = replace(origin, residual=derivative, name=_ORDINALS[times + 1] + origin.name, kind="equal", slot=None)
            self.rows[i] = named, times + 1, origin
        return bool(over)

    def _prepare(self, present: Collection[str]) -> None:
        """What is to be differentiated must be a state: algebraics become states, derivatives become variables of their own."""
        for x, dx in zip(list(self.x), list(self.dx), strict=True):
            if dx.name() in present:
                own = ca.SX.sym(f"{x.name()}'")
                self.explicit[x.name()] = own
                self.kinematic.append(FlatEquation(residual=dx - own, name="definition", component=x.name(), kind="equal"))
                self.rows = [(replace(e, residual=ca.substitute(e.residual, dx, own)), n, o) for e, n, o in self.rows]
                self._promote(own)
        for symbol in [z for z in self.z if z.name() in present]:
            self.z = [z for z in self.z if z.name() != symbol.name()]
            self._promote(symbol)

    def _promote(self, symbol: SX) -> None:
        self.x.append(symbol)
        self.dx.append(ca.SX.sym(f"der({symbol.name()})"))

    def _derivative(self, residual: SX) -> SX:
        rates = {x.name(): self.explicit.get(x.name(), dx) for x, dx in zip(self.x, self.dx, strict=True)} | {self.time: ca.SX(1)}
        symbols = [s for s in ca.symvar(residual) if s.name() in rates]
        return ca.jtimes(residual, ca.vertcat(*symbols), ca.vertcat(*(rates[s.name()] for s in symbols))) if symbols else ca.SX(0)

    def result(self) -> Semi:
        return Semi(
            x=self.x,
            dx=self.dx,
            z=self.z,
            equations=[*self.kinematic, *(row for row, _, _ in self.rows)],
            invariants=self.invariants,
            index=1 + max((times for _, times, _ in self.rows), default=0),
        )


def _origins(equations: list[FlatEquation]) -> str:
    return ", ".join(f"'{e.origin}'" for e in equations[:8]) + (" ..." if len(equations) > 8 else "")
