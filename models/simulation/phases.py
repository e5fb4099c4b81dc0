"""The equations of a model while each of its friction laws sticks or slides one way: smooth, without any rounding.

    slides forwards (+1), backwards (-1)     psi = psi(+inf), psi(-inf)                                margin  +v, -v
    sticks (0)                               psi = psi(0) + (max psi - min psi) lambda,  d v/dt = 0    margins  high - lambda, lambda - low

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
from .switch_graph import Graph
from .switches import FAR, find_switches, law_range

SX = Any
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class InPhase:
    """The model in one phase of every law; margins (m,): expressions in x', x, z, u, p, t, positive as long as it lasts.

    Margin i is of law number of[i], which goes on the way beyond[i] where it ends, unless it was sliding and is held there.
    """

    dae: Dae
    margins: SX
    of: tuple[int, ...]
    beyond: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """Of a velocity v(x, t): the symbols that it puts into the equations, what each is of s = v over its width, and its range.

    low, high: bounds of lambda, the sign of v beyond the upper one, and s at min psi and at max psi.
    """

    name: str
    velocity: SX
    s: SX
    parts: tuple[tuple[SX, SX], ...]
    bounds: tuple[float, float, int]
    ends: tuple[float, float]

    def sliding(self, way: int) -> list[SX]:
        """psi of every part."""
        return [ca.substitute(psi, self.s, ca.SX(way * FAR)) for _, psi in self.parts]

    def held(self, share: SX) -> list[SX]:
        """psi of every part, `share` of its range from rest."""
        rest, bottom, top = ([ca.substitute(psi, self.s, ca.SX(s)) for _, psi in self.parts] for s in (0.0, *self.ends))
        return [r + (t - b) * share for r, b, t in zip(rest, bottom, top, strict=True)]


class Phases:
    """The laws of a model that stick and slide, at values p (np,) with which their strengths are looked at: zero is none."""

    def __init__(self, dae: Dae, values: Array) -> None:
        self._dae, self._values = dae, values
        self._graph = Graph(dae, [q.name for q in dae.parameters if q.smoothing])
        switches = find_switches(dae, values, ()).switches
        self.laws = [self._law(component_of(dae, s), s.members) for s in switches if s.kind == "hold"]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the components whose laws they are."""
        return tuple(law.name for law in self.laws)

    def within(self, phase: Sequence[int]) -> InPhase:
        """The model while every law is in its phase: +1, -1 or 0."""
        dae, psi, margins = self._dae, list[SX](), list[tuple[SX, int, int]]()
        holds, rows = list[tuple[SX, Quantity]](), list[tuple[SX, EquationInfo]]()
        for k, (law, way) in enumerate(zip(self.laws, phase, strict=True)):
            v = law.velocity
            if way:
                psi += law.sliding(way)
                margins.append((way * v, k, -way))
                continue
            share, (low, high, up) = ca.SX.sym(f"{law.name}.hold"), law.bounds
            psi += law.held(share)
            margins += [(high - share, k, up), (share - low, k, -up)]
            holds.append((share, Quantity(name=f"{law.name}.hold", unit="1", description="share of the law's range that holds")))
            rate = ca.jacobian(v, dae.x) @ dae.dx + ca.jacobian(v, dae.t)
            rows.append((rate, EquationInfo(name="at rest", component=law.name, origin=f"{law.name}: its velocity stays zero")))
        symbols = [symbol for law in self.laws for symbol, _ in law.parts]

        def put(expression: SX) -> SX:
            return self._as_written(ca.substitute(expression, ca.vertcat(*symbols), ca.vertcat(*psi)) if symbols else expression)

        smooth = replace(
            dae,
            residual=ca.vertcat(put(self._graph.residual), *(row for row, _ in rows)),
            output=put(self._graph.output),
            z=ca.vertcat(dae.z, *(z for z, _ in holds)),
            algebraics=(*dae.algebraics, *(q for _, q in holds)),
            equations=(*dae.equations, *(info for _, info in rows)),
        )
        g, of, beyond = zip(*margins, strict=True) if margins else ((), (), ())
        return InPhase(dae=smooth, margins=put(ca.vertcat(*g)), of=of, beyond=beyond)

    def _law(self, name: str, members: Sequence[tuple[int, int]]) -> Law:
        """Several switches of one velocity hold together."""
        s, found = ca.SX.sym("s"), [(self._graph.found[k], sign) for k, sign in members]
        parts = [(symbol, ca.substitute(psi, f.s, sign * s)) for f, sign in found for symbol, psi in f.parts]
        psi = ca.Function("psi", [s, self._dae.p], [ca.vertcat(*(e for _, e in parts))])
        numbers = ca.Function("psi", [s], [psi(s, ca.DM(self._values))])
        _, bounds, ends = law_range(numbers, numbers(0.0).full()[:, 0], np.ones(len(parts), dtype=bool))
        if bounds is None:
            raise RuntimeError(f"{name}: a law that holds has a range")
        return Law(name=name, velocity=self._as_written(found[0][0].function), s=s, parts=tuple(parts), bounds=bounds, ends=ends)

    def _as_written(self, expression: SX) -> SX:
        """What is no law of friction as it was."""
        for corner in reversed(self._graph.corners):
            expression = ca.substitute(expression, corner.symbol, corner.written)
        for found in reversed(self._graph.found):
            for symbol, psi in found.parts:
                expression = ca.substitute(expression, symbol, ca.substitute(psi, found.s, found.function / found.scale))
        return expression
