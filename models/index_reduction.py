"""Index reduction of what elimination left implicit: constraints between states, a Cartesian pendulum, a closed loop.

CasADi's `dae_reduce_index` (C. C. Pantelides, SIAM J. Sci. Stat. Comput. 9, 1988) differentiates constraints until the highest derivatives
are determined, and returns the undifferentiated ones as invariants. It promotes derivatives x' of constrained states to states of their
own; here those are folded back onto the velocities that the model already has, so the kinematics stay x' = v.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from .eliminate import clean
from .errors import ModelError
from .flatten import FlatEquation

SX = Any
_ORDINALS = ("", "derivative of ", "second derivative of ", "third derivative of ", "fourth derivative of ")


@dataclass(frozen=True, kw_only=True, eq=False)
class Semi:
    """Rows over states x (with dx) and algebraics z; names run parallel to the symbols."""

    x: list[SX]
    dx: list[SX]
    z: list[SX]
    equations: list[FlatEquation]
    invariants: list[SX]
    index: int


def reduce_index(system: Semi, known: SX, time: SX) -> Semi:
    """The system with its constraints differentiated as often as needed, and the constraints themselves as invariants.

    `known` stacks all symbols that are not unknowns (inputs, parameters, residuals) and is taken as constant: the caller checks that no
    invariant holds an input or residual. Raises ModelError when the equations have no finite index.
    """
    rows = ca.vertcat(*(e.residual for e in system.equations))
    dae = {
        "x_impl": ca.vertcat(*system.x),
        "dx_impl": ca.vertcat(*system.dx),
        "z": ca.vertcat(*system.z),
        "p": known,
        "t": time,
        "alg": rows,
    }
    try:
        reduced, facts = ca.dae_reduce_index(dae, {})
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise ModelError(
            f"the equations {_origins(system.equations)} have no finite index ({reason}); "
            "a constraint is stated twice, or a variable is free"
        ) from None
    work = _Promoted(reduced, system)
    work.fold()
    return work.result(int(facts["index"]))


class _Promoted:
    """CasADi's reduced equations while promoted derivatives are folded back."""

    def __init__(self, reduced: dict[str, SX], system: Semi) -> None:
        self.system = system
        self.own = {s.name() for s in system.x}
        self.explicit = _parts(reduced.get("x"))
        self.ode = _parts(reduced.get("ode"))
        self.implicit = _parts(reduced.get("x_impl"))
        self.rates = _parts(reduced.get("dx_impl"))
        self.z = _parts(reduced.get("z"))
        self.invariants = _parts(reduced.get("I"))
        self.alg = [(row, self._origin(row)) for row in _parts(reduced.get("alg"))]

    def derivative(self, expression: SX) -> SX:
        """Total derivative along the reduced system."""
        total = ca.SX(0)
        for symbol, rate in [*zip(self.explicit, self.ode, strict=True), *zip(self.implicit, self.rates, strict=True)]:
            total += ca.jacobian(expression, symbol) * rate
        return total

    def fold(self) -> None:
        """Replace each promoted derivative by the velocity that an invariant says it is."""
        for _ in range(len(self.implicit)):
            pick = next(
                (
                    (i, k)
                    for i, symbol in enumerate(self.implicit)
                    if symbol.name() not in self.own
                    for k, row in enumerate(self.invariants)
                    if self._solvable(row, symbol)
                ),
                None,
            )
            if pick is None:
                return
            i, k = pick
            symbol, rate, row = self.implicit[i], self.rates[i], self.invariants.pop(k)
            value = -ca.substitute(row, symbol, 0) / ca.jacobian(row, symbol)
            slope = self.derivative(value)
            del self.implicit[i], self.rates[i]
            old, new = [symbol, rate], [value, slope]
            self.ode = [clean(e) for e in ca.substitute(self.ode, old, new)] if self.ode else []
            self.invariants = [clean(e) for e in ca.substitute(self.invariants, old, new)] if self.invariants else []
            residuals = [clean(e) for e in ca.substitute([row for row, _ in self.alg], old, new)]
            self.alg = [(r, origin) for r, (_, origin) in zip(residuals, self.alg, strict=True) if not r.is_zero()]

    def result(self, index: int) -> Semi:
        states, equations = [*self.implicit], [*(replace(origin, residual=row) for row, origin in self.alg)]
        rates, kinematic = [*self.rates], []
        for symbol, ode in zip(self.explicit, self.ode, strict=True):
            states.append(symbol)
            rates.append(ca.SX.sym(f"der({symbol.name()})"))
            origin = next(
                (
                    e
                    for e in self.system.equations
                    if f"der({symbol.name()})" in {s.name() for s in ca.symvar(e.residual)} and e.kind == "equal"
                ),
                FlatEquation(residual=ca.SX(0), name="definition", component=symbol.name(), kind="equal"),
            )
            kinematic.append(replace(origin, residual=rates[-1] - ode))
        if len(equations) + len(kinematic) != len(states) + len(self.z):
            raise ModelError(
                f"index reduction of the equations {_origins(self.system.equations)} left {len(equations) + len(kinematic)} rows "
                f"for {len(states) + len(self.z)} unknowns; a constraint is stated twice"
            )
        return Semi(x=states, dx=rates, z=self.z, equations=[*kinematic, *equations], invariants=self.invariants, index=index)

    def _solvable(self, row: SX, symbol: SX) -> bool:
        slope = ca.jacobian(row, symbol)
        return bool(slope.is_constant()) and float(slope) != 0.0

    def _origin(self, row: SX) -> FlatEquation:
        """Which declared equation, differentiated how often, a row of the reduced system is: compared at a random point."""
        for order in range(len(_ORDINALS)):
            for equation in self.system.equations:
                expression = equation.residual
                for _ in range(order):
                    expression = self.derivative(expression)
                if _same(row, expression):
                    if order == 0:
                        return equation
                    return replace(equation, name=_ORDINALS[order] + equation.name, slot=None, kind="equal")
        raise ModelError(f"index reduction gave a row of unknown origin ({row}); the equations are {_origins(self.system.equations)}")


def _same(a: SX, b: SX) -> bool:
    if ca.is_equal(a, b, 20):
        return True
    symbols = ca.symvar(ca.vertcat(a, b))
    point = np.random.default_rng(len(symbols)).uniform(0.3, 1.7, (3, len(symbols)))
    both = ca.Function("both", [ca.vertcat(*symbols)], [a, b])
    for values in point:
        left, right = (float(v) for v in both(values))
        if not np.isclose(left, right, rtol=1e-10, atol=1e-12):
            return False
    return True


def _parts(column: SX | None) -> list[SX]:
    return [] if column is None else list(ca.vertsplit(column)) if column.shape[0] else []


def _origins(equations: list[FlatEquation]) -> str:
    return ", ".join(f"'{e.origin}'" for e in equations[:8]) + (" ..." if len(equations) > 8 else "")
