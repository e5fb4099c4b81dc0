"""Where the laws of a model switch: found in the graph of its equations, so that no step of an integration needs to straddle a corner.

A switch has a switching function a(x', x, z, u, t): the law is one smooth formula where a > 0 and another where a < 0.

    fabs(a), fmax, fmin, sign, <, <=, if_else            hard switches
    psi(a / width)                                       rounded ones, for a parameter `width` that is marked as smoothing: psi(+-inf)
    sqrt(a^2 + r^2)                                      |a|, for an r that vanishes with such a parameter

Each becomes a number psi of its own in the equations, constant on either side. What psi does there decides the kind of the switch:

    kink    the equations are continuous at a = 0 (contact, backlash, a limit): two modes
    jump    they are not (a relay): two modes
    hold    a jump whose psi acts on the rate of a = a(x, t), as Coulomb friction on a velocity, has a third one:

        a = 0:   psi = psi(0) + (max psi - min psi) lambda,   d a(x, t)/dt = 0,   low <= lambda <= high

in which lambda is an algebraic variable: the force that sticks, exact and without creep, up to the largest psi, which for friction with a
breakaway force is more than psi(inf) (A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, 1988, section 4).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ..dae import Dae
from .switch_graph import Found, Graph

SX = Any
Array = NDArray[np.float64]
FAR = 1e6  # widths away from the corner: where a rounded law must have arrived
_NEAR = 40.0  # widths within which it has its extremes
_SEED = 0
_POINTS = 24
_DECADES = 6.0
_PAIRS = 5
_HALVINGS = 45
_BESIDE = (1e-7, 1e-10)  # how far beside a corner it is looked at, of the way between two points: the strength of a kink falls with it
_JUMP, _ROOT = 0.3, 3e-3  # ratio of the strengths at these: 1 for a jump, 0.03 for a square root, 0.001 for a kink
_KINK = 1e-9  # what of the strength is rounding error


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A place in the equations that sees a switch: its symbol there, psi at a < 0, at 0 and at a > 0, and the law as it is written."""

    symbol: SX
    below: float
    rest: float
    above: float
    span: float
    native: SX


@dataclass(frozen=True, kw_only=True, eq=False)
class Switch:
    """One switching function and what it switches.

    function  a(x', x, z, u, t), parameters put in
    parts     the psi that it decides
    kind      "kink", "jump", or "hold": a jump that can also rest at a = 0
    low, high       bounds of lambda at rest;  toward  the sign of a beyond `high`
    rounded   whether the law as written is a rounded one, and can stand in
    plain     its branches cannot be continued beyond a = 0 (a root of a negative number): the law stays as written
    width     name of the smoothing parameter, "" without
    members   places among the graph's switches, with the sign of their function over this one's
    """

    function: SX
    parts: tuple[Part, ...]
    kind: Literal["kink", "jump", "hold"]
    low: float = 0.0
    high: float = 0.0
    toward: int = 1
    rounded: bool = False
    plain: bool = False
    width: str = ""
    members: tuple[tuple[int, int], ...] = ()
    declared: SX = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Switched:
    """The equations with a symbol for every part of every switch; parameters put in, residual forces zero."""

    residual: SX
    output: SX
    switches: tuple[Switch, ...]


def find_switches(dae: Dae, values: Array, given: Collection[str]) -> Switched:
    """The switches of a model at parameter values p (np,); laws whose smoothing width is in `given` stay as they are written."""
    smooth = [q.name for q in dae.parameters if q.smoothing and q.name not in given]
    graph = Graph(dae, smooth)
    return _Classified(dae, graph, values).result() if graph.found else unswitched(dae, values)


def unswitched(dae: Dae, values: Array) -> Switched:
    """The equations as they are written."""
    return Switched(residual=_put(dae, dae.residual, values), output=_put(dae, dae.output, values), switches=())


def _put(dae: Dae, expression: SX, values: Array) -> SX:
    return ca.substitute(dae.undisturbed(expression), dae.p, ca.DM(values))


class _Classified:
    """Switches merged where one function is a multiple of another, and told apart by experiment at random points."""

    def __init__(self, dae: Dae, graph: Graph, values: Array) -> None:
        self.dae, self.graph, self.values = dae, graph, values
        self.known = ca.vertcat(dae.dx, dae.x, dae.z, dae.u, dae.t)
        self.symbols = ca.vertcat(*(symbol for found in graph.found for symbol, _ in found.parts))
        self.natives = {}
        for f in graph.found:
            argument = self._sharp(f.function / f.scale)
            for symbol, psi in f.parts:
                self.natives[symbol.element_hash()] = symbol, ca.substitute(_put(dae, psi, values), f.s, argument)
        self.residual = self._sharp(graph.residual)
        sizes = np.array([*(q.nominal for q in dae.states)] * 2 + [q.nominal for q in (*dae.algebraics, *dae.inputs)] + [1.0])
        generator = np.random.default_rng(_SEED)
        decades = np.where(np.arange(_POINTS) % 2, _DECADES, 0.0)  # every other point has quantities of very different size
        self.points = [sizes * generator.uniform(-1.7, 1.7, len(sizes)) * 10 ** generator.uniform(-d, 0, len(sizes)) for d in decades]
        ends = [self._ends(f) for f in graph.found if f.parts]
        below, above = (np.concatenate(column) for column in zip(*ends, strict=True))
        self.modes = [np.where(generator.random(len(below)) < 0.5, below, above) for _ in range(_POINTS)]

    def result(self) -> Switched:
        """The switches that matter; all others are written back as they were."""
        switches: list[Switch] = []
        kept: set[int] = set()
        left: set[str] = set()
        for group in self._merged():
            found = [self.graph.found[k] for k, _ in group]
            switch = self._switch([(f, sign) for f, (_, sign) in zip(found, group, strict=True)], group)
            if switch is not None:
                switches.append(switch)
                kept.update(k for k, _ in group)
            else:
                left.update(f.width for f in found)
        gone = {f.width for f in self.graph.found} - left - {""}
        limit = np.array([0.0 if q.name in gone else v for q, v in zip(self.dae.parameters, self.values, strict=True)])

        def final(expression: SX) -> SX:
            expression = self._sharp(expression, limit, kept)
            for k, f in reversed(list(enumerate(self.graph.found))):  # a later one may hold an earlier one
                for symbol, _ in f.parts if k not in kept else ():
                    expression = ca.substitute(expression, symbol, self.natives[symbol.element_hash()][1])
            return expression

        whole = tuple(
            replace(s, function=final(s.declared), parts=tuple(replace(q, native=final(q.native)) for q in s.parts)) for s in switches
        )
        return Switched(residual=final(self.graph.residual), output=final(self.graph.output), switches=whole)

    def _sharp(self, expression: SX, values: Array | None = None, kept: Collection[int] | None = None) -> SX:
        """Numbers for the parameters, and rounded corners by modes (those of the switches `kept`)."""
        for corner in reversed(self.graph.corners):
            by_modes = kept is None or corner.switch in kept
            expression = ca.substitute(expression, corner.symbol, corner.sharp if by_modes else corner.written)
        return _put(self.dae, expression, self.values if values is None else values)

    def _ends(self, f: Found) -> tuple[Array, Array]:
        """psi far below and far above the corner."""
        psi = ca.Function("psi", [f.s], [_put(self.dae, ca.vertcat(*(e for _, e in f.parts)), self.values)])
        below, above = psi(-FAR).full()[:, 0], psi(FAR).full()[:, 0]
        return below, above

    def _merged(self) -> list[list[tuple[int, int]]]:
        """Groups of (switch, sign): functions that are multiples of each other have their corner at the same place."""
        functions = ca.vertcat(*(self._sharp(f.function) for f in self.graph.found))
        evaluate = ca.Function("a", [self.known, self.symbols], [functions])
        table = np.array([evaluate(point, psi).full()[:, 0] for point, psi in zip(self.points, self.modes, strict=True)])
        groups: list[list[tuple[int, int]]] = []
        heads: list[Array] = []
        for k, column in enumerate(table.T):
            for head, group in zip(heads, groups, strict=True):
                ratio = float(column @ head / max(head @ head, 1e-300))
                if ratio and np.all(np.isfinite(column)) and np.abs(column - ratio * head).max() <= 1e-12 * np.abs(column).max():
                    group.append((k, 1 if ratio > 0 else -1))
                    break
            else:
                heads.append(column)
                groups.append([(k, 1)])
        return groups

    def _switch(self, group: list[tuple[Found, int]], members: list[tuple[int, int]]) -> Switch | None:
        """The switch of a group; None where it has no effect, or is none in the limit of no rounding."""
        indices = {k for k, _ in members}
        s = ca.SX.sym("s")
        parts = [(symbol, ca.substitute(_put(self.dae, psi, self.values), f.s, sign * s)) for f, sign in group for symbol, psi in f.parts]
        function = self._sharp(group[0][0].function)
        if not parts or not ca.depends_on(function, self.known):
            return None
        psi = ca.Function("psi", [s], [ca.vertcat(*(p for _, p in parts))])
        below, rest, above = (psi(at).full()[:, 0] for at in (-FAR, 0.0, FAR))
        if not (np.all(np.isfinite(below)) and np.all(np.isfinite(above))):
            return None
        farther = np.concatenate([psi(-2 * FAR).full()[:, 0] - below, psi(2 * FAR).full()[:, 0] - above])
        if not np.abs(farther).max() <= 1e-9 * (1.0 + np.abs(above).max()):
            return None
        symbols = [symbol for symbol, _ in parts]
        general, beside, steep = self._strength(function, symbols, above - below)
        if not general.any():
            return None
        acting = beside > _KINK * general.max()
        span, bounds, _ = law_range(psi, rest, acting) if acting.any() else (above - below, None, (0.0, 0.0))
        kind: Literal["kink", "jump", "hold"] = "jump" if acting.any() else "kink"
        rounded = all(f.width for f, _ in group)
        corner_law = any(corner.switch in indices for corner in self.graph.corners)
        if corner_law and (steep > _KINK * general.max()).any():  # where a root of |a| leaves zero is up to its rounding
            return None
        if kind == "jump" and (chases := self._drives(function, symbols, span)):
            if chases == "held" and bounds is not None and not corner_law:
                kind = "hold"
            elif rounded or corner_law:
                return None
        low, high, toward = bounds or (0.0, 0.0, 1)
        numbers = zip(symbols, below.tolist(), rest.tolist(), above.tolist(), span.tolist(), strict=True)
        return Switch(
            function=function,
            declared=group[0][0].function,
            parts=tuple(
                Part(symbol=symbol, below=b, rest=r, above=a, span=d, native=self.natives[symbol.element_hash()][1])
                for symbol, b, r, a, d in numbers
            ),
            kind=kind,
            low=low,
            high=high,
            toward=toward,
            rounded=rounded,
            plain=kind == "kink" and self._ends_at_corner(function, symbols, below, above),
            width=group[0][0].width,
            members=tuple(members),
        )

    def _strength(self, function: SX, symbols: list[SX], span: Array) -> tuple[Array, Array, Array]:
        """How much each part moves the residual at random points, and beside a = 0 if it jumps there, or has a root there."""
        rows = ca.jacobian(self.residual, ca.vertcat(*symbols)) @ ca.diag(ca.DM(span))
        evaluate = ca.Function("strength", [self.known, self.symbols], [ca.densify(rows)])
        sign = ca.Function("a", [self.known, self.symbols], [function])
        general, beside, steep = np.zeros((3, len(symbols)))
        pairs = 0
        for point, following, psi in zip(self.points, np.roll(self.points, -1, axis=0), self.modes, strict=True):
            general = np.fmax(general, np.abs(evaluate(point, psi).full()).max(axis=0, initial=0.0))
            low, high = 0.0, 1.0
            first = float(sign(point, psi))
            if pairs == _PAIRS or not first * float(sign(following, psi)) < 0.0:
                continue
            pairs += 1
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                low, high = (middle, high) if first * float(sign(point + middle * (following - point), psi)) > 0 else (low, middle)
            near, nearer = (np.abs(evaluate(point + (low + d) * (following - point), psi).full()).max(axis=0, initial=0.0) for d in _BESIDE)
            beside = np.fmax(beside, np.where(nearer > _JUMP * near, nearer, 0.0))
            steep = np.fmax(steep, np.where(nearer > _ROOT * near, nearer, 0.0))
        return general, beside, steep

    def _ends_at_corner(self, function: SX, symbols: list[SX], below: Array, above: Array) -> bool:
        """Whether a branch of the law is no number on the other side of its corner."""
        rows = ca.Function("rows", [self.known, self.symbols], [ca.densify(self.residual), function])
        places = [i for i, symbol in enumerate(ca.vertsplit(self.symbols)) if any(ca.is_equal(symbol, own) for own in symbols)]
        order = [next(j for j, own in enumerate(symbols) if ca.is_equal(self.symbols[i], own)) for i in places]
        for point, psi in zip(self.points, self.modes, strict=True):
            own, other = psi.copy(), psi.copy()
            positive = float(rows(point, psi)[1]) > 0
            own[places], other[places] = (above[order], below[order]) if positive else (below[order], above[order])
            if np.all(np.isfinite(rows(point, own)[0].full())) and not np.all(np.isfinite(rows(point, other)[0].full())):
                return True
        return False

    def _drives(self, function: SX, symbols: list[SX], span: Array) -> Literal["", "held", "unknown"]:
        """Whether psi acts on d a/dt at once, and so may chatter: "held" where it can keep a(x, t) at zero."""
        dae = self.dae
        if ca.depends_on(function, ca.vertcat(dae.dx, dae.z, self.symbols)):
            return "unknown"
        if not ca.depends_on(function, dae.x):
            return ""
        push = ca.jacobian(self.residual, ca.vertcat(*symbols)) @ ca.DM(span)
        motion = ca.horzcat(ca.jacobian(function, dae.x), ca.SX.zeros(1, dae.z.shape[0] + 1))
        own = ca.horzcat(ca.jacobian(self.residual, ca.vertcat(dae.dx, dae.z)), push)
        matrix = ca.Function("hold", [self.known, self.symbols], [ca.densify(ca.vertcat(own, motion))])
        if not any(_regular(matrix(point, psi).full()) for point, psi in zip(self.points, self.modes, strict=True)):
            return ""
        return "unknown" if ca.depends_on(function, dae.u) else "held"


def _regular(matrix: Array) -> bool:
    if not np.all(np.isfinite(matrix)):
        return False
    for axis in (1, 0):
        matrix = matrix / np.maximum(np.abs(matrix).max(axis=axis, keepdims=True), 1e-300)
    spread = np.linalg.svd(matrix, compute_uv=False)
    return bool(spread[-1] > 1e-12 * spread[0])


def law_range(psi: Any, rest: Array, acting: NDArray[np.bool_]) -> tuple[Array, tuple[float, float, int] | None, tuple[float, float]]:
    """max psi - min psi, the bounds of lambda with the sign of s at the upper one, and the s of min psi and of max psi.

    No bounds where the acting parts differ in shape.
    """
    grid = np.concatenate([[-FAR], np.linspace(-_NEAR, _NEAR, 1601), [FAR]])
    table = np.where(acting, psi(grid[None, :]).full().T - rest, 0.0)
    lead = int(np.argmax(np.ptp(table, axis=0)))
    top, bottom = (_extreme(psi, lead, grid, sign * table[:, lead], sign) for sign in (1.0, -1.0))
    span = np.where(acting, (psi(top) - psi(bottom)).full()[:, 0], 0.0)
    size = float(span[lead])
    shape = table[:, lead, None] / (size or 1.0) * span
    if not np.all(np.isfinite(table)) or size == 0.0 or np.abs(table - shape).max() > 1e-9 * np.abs(table).max() or top * bottom > 0:
        return span, None, (bottom, top)
    low, high = ((float(psi(s)[lead]) - float(rest[lead])) / size for s in (bottom, top))
    return span, (low, high, 1 if top > bottom else -1), (bottom, top)


def _extreme(psi: Any, lead: int, grid: Array, column: Array, sign: float) -> float:
    """s where the leading part is largest (sign 1) or smallest (-1); far out unless there is a true peak."""
    k = int(np.argmax(column))
    ends = column[[0, -1]]
    if column[k] <= ends.max() + 1e-9 * max(np.ptp(column), 1e-300):
        return float(grid[0 if ends[0] >= ends[1] else -1])
    around = (float(grid[max(k - 1, 1)]), float(grid[min(k + 1, len(grid) - 2)]))
    found = minimize_scalar(lambda s: -sign * float(psi(s)[lead]), bounds=around, method="bounded", options={"xatol": 1e-10})
    return float(found.x)
