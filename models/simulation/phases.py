"""The equations of a model while each of its friction laws sticks or slides one way: smooth, without any rounding.

    slides forwards (+1), backwards (-1)     psi = psi(+inf), psi(-inf)                                    margin  +v, -v
    sticks (0)                               psi = psi(0) + (max psi - min psi) lambda,  d v/dt = 0        margins  high - lambda, lambda - low

psi is what the law makes of the sign of its velocity v (`switches.py`: a switch that holds); lambda is an algebraic variable,
`<law>.hold`. A phase lasts as long as its margins are positive. Parameters stay symbols, also those of the levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..dae import Dae, EquationInfo, Quantity
from .events import component_of
from .switch_graph import Found, Graph
from .switches import FAR, find_switches, law_range

SX = Any
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class InPhase:
    """The model in one phase of every law; margins (m,): expressions in x', x, z, u, p, t, positive as long as it lasts.

    Each margin is of the law `of[i]` (its place among the laws), which beyond it slides the way `beyond[i]`: at rest it breaks away so;
    sliding it comes to rest, 0, and if nothing holds it there goes on that way.
    """

    dae: Dae
    margins: SX
    of: tuple[int, ...]
    beyond: tuple[int, ...]


class Phases:
    """The laws of a model that stick and slide; values p (np,): of which the strengths are looked at, and zero is none.

    names: of the laws, as their components are called.
    """

    def __init__(self, dae: Dae, values: Array) -> None:
        self._dae, self._values = dae, values
        switched = find_switches(dae, values, ())
        holding = [s for s in switched.switches if s.kind == "hold" and s.width]
        self._graph = Graph(dae, [q.name for q in dae.parameters if q.smoothing])
        own = [(s, [f for f in self._graph.found if f.width == s.width and f.parts]) for s in holding]
        kept = [(s, found[0]) for s, found in own if len(found) == 1]
        self.names = tuple(component_of(dae, s) for s, _ in kept)
        self._laws = [found for _, found in kept]

    def velocities(self) -> SX:
        """Of the laws, expressions in x and t."""
        return ca.vertcat(*(self._written(f.function) for f in self._laws))

    def within(self, phase: Sequence[int]) -> InPhase:
        """The model while every law is in its phase: +1, -1 or 0."""
        dae, symbols, values = self._dae, [], []
        margins, of, beyond, holds, rows = [], [], [], [], []
        for k, (law, s, name) in enumerate(zip(self._laws, phase, self.names, strict=True)):
            v = self._written(law.function)
            if s:
                values += [ca.substitute(psi, law.s, ca.SX(s * FAR)) for _, psi in law.parts]
                margins, of, beyond = [*margins, s * v], [*of, k], [*beyond, -s]
            else:
                hold = ca.SX.sym(f"{name}.hold")
                (low, high, toward), ends = self._range(law)
                for (_, psi), (bottom, top) in zip(law.parts, ends, strict=True):
                    values.append(ca.substitute(psi, law.s, ca.SX(0)) + (top - bottom) * hold)
                holds.append((hold, Quantity(name=f"{name}.hold", unit="1", description="share of the law's range that holds at rest")))
                rate = ca.jacobian(v, dae.x) @ dae.dx + ca.jacobian(v, dae.t)
                rows.append((rate, EquationInfo(name="at rest", component=name, origin=f"{name}: its velocity stays zero")))
                margins, of, beyond = [*margins, high - hold, hold - low], [*of, k, k], [*beyond, toward, -toward]
            symbols += [symbol for symbol, _ in law.parts]

        def put(expression: SX) -> SX:
            return self._written(ca.substitute(expression, ca.vertcat(*symbols), ca.vertcat(*values)) if symbols else expression)

        smooth = replace(
            dae,
            residual=ca.vertcat(put(self._graph.residual), *(row for row, _ in rows)),
            output=put(self._graph.output),
            z=ca.vertcat(dae.z, *(z for z, _ in holds)),
            algebraics=(*dae.algebraics, *(q for _, q in holds)),
            equations=(*dae.equations, *(info for _, info in rows)),
        )
        return InPhase(dae=smooth, margins=put(ca.vertcat(*margins)), of=tuple(of), beyond=tuple(beyond))

    def _range(self, law: Found) -> tuple[tuple[float, float, int], list[tuple[SX, SX]]]:
        """Bounds of lambda with the sign of v at the upper one, and of every part the expressions of psi at both ends."""
        psi = ca.Function("psi", [law.s, self._dae.p], [ca.vertcat(*(e for _, e in law.parts))])
        s = ca.SX.sym("s")
        numbers = ca.Function("psi", [s], [psi(s, ca.DM(self._values))])
        _, bounds, (bottom, top) = law_range(numbers, numbers(0.0).full()[:, 0], np.ones(len(law.parts), dtype=bool))
        if bounds is None:
            raise RuntimeError(f"{law.width}: a law that holds has a range")
        return bounds, [tuple(ca.substitute(e, law.s, ca.SX(end)) for end in (bottom, top)) for _, e in law.parts]

    def _written(self, expression: SX) -> SX:
        """What is no law of friction as it was."""
        for corner in reversed(self._graph.corners):
            expression = ca.substitute(expression, corner.symbol, corner.written)
        for found in reversed(self._graph.found):
            for symbol, psi in found.parts:
                expression = ca.substitute(expression, symbol, ca.substitute(psi, found.s, found.function / found.scale))
        return expression
