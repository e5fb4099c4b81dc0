"""Integration through events: between two of them the modes of all switches stand still, so that every step is smooth.

    m_k = +1, -1   the switching function a_k > 0, < 0; its law goes on smoothly beyond zero until the step is cut at the crossing
    held           a_k = 0 by its own unknown lambda_k (`switches`), until lambda_k leaves its bounds

At a crossing the step ends, modes change, and the next step starts with the same length. A body that comes to rest is held if its lambda
fits its bounds, otherwise it goes on to the side on which lambda left them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..dae import Dae
from ..errors import SolveError
from .consistent import Projection, ZeroOf, highest
from .events import NOISE, Event, component_of, first_crossing, slope_at
from .radau import STAGES, Step, Stepper, System
from .switches import Switched

SX = Any
Array = NDArray[np.float64]
_SMALLEST = 1e-15  # step over interval
_EDGE = 1e-9  # by which lambda may leave its bounds: the solution of linear equations
_LOCATE = 6  # steps to land on a crossing
_LEAST = 1e-3
_NEAR = 1e-9  # of a switching function's size: what a step that stops before it may be short of


@dataclass(eq=False)
class Point:
    """Where the integration is: states, algebraics (with the lambdas), rates, and what is to stay positive (`Integrator._build`)."""

    x: Array
    z: Array
    rate: Array
    positive: Array


class Integrator:
    """One model's integration at parameter values p; `events` collects what happened."""

    def __init__(self, dae: Dae, switched: Switched, values: Array, rtol: float) -> None:
        self.dae, self.switched, self.rtol = dae, switched, rtol
        self.switches = switched.switches
        self.nominal = np.array([q.nominal for q in dae.states])
        self.nz = dae.z.shape[0]
        self.seen = np.zeros(dae.x.shape[0])  # largest size of each state so far
        self.size = np.zeros(len(self.switches))  # and of each switching function
        self.m = np.ones(len(self.switches))
        self.held: tuple[int, ...] = ()
        self.rounded: frozenset[int] = frozenset()
        self.events: list[Event] = []
        self._steppers: dict[tuple[tuple[int, ...], frozenset[int]], tuple[Stepper, Any, Any]] = {}
        self._project = Projection(dae, values) if dae.invariants.shape[0] else None
        self._corners = {k: ZeroOf(dae, s.function) for k, s in enumerate(self.switches) if s.kind == "hold"}
        self._names: dict[int, str] = {}
        self._idle = 0  # events since the integration last moved

    # --- the smooth system in force

    @property
    def key(self) -> tuple[tuple[int, ...], frozenset[int]]:
        """What decides the equations in force, but for the signs m."""
        return self.held, self.rounded

    @property
    def stepper(self) -> Stepper:
        return self._compiled()[0]

    @property
    def output(self) -> Any:
        """(x', x, z, u, t, m) -> y."""
        return self._compiled()[1]

    def _compiled(self) -> tuple[Stepper, Any, Any]:
        if self.key not in self._steppers:
            self._steppers[self.key] = self._build()
        return self._steppers[self.key]

    def _build(self) -> tuple[Stepper, Any, Any]:
        """The stepper, the outputs, and what is to stay positive: m a of every switch, then the room of the lambdas on both sides."""
        dae, m, force = self.dae, ca.SX.sym("m", len(self.switches)), ca.SX.sym("lambda", len(self.held))
        natives, old, new = [], [], []
        for k, switch in enumerate(self.switches):
            for part in switch.parts:
                if k in self.rounded or switch.plain:
                    natives.append((part.symbol, part.native))
                    continue
                old.append(part.symbol)
                if k in self.held:
                    new.append(part.rest + part.span * force[self.held.index(k)])
                else:
                    new.append((part.above + part.below) / 2 + m[k] * ((part.above - part.below) / 2))

        def put(expression: SX) -> SX:
            for symbol, native in natives:
                expression = ca.substitute(expression, symbol, native)
            return ca.substitute(expression, ca.vertcat(*old), ca.vertcat(*new)) if old else expression

        rest = [ca.jacobian(self.switches[k].function, dae.x) @ dae.dx + ca.jacobian(self.switches[k].function, dae.t) for k in self.held]
        idle = {*self.held, *self.rounded}
        positive = [ca.SX(1) if k in idle else m[k] * put(s.function) for k, s in enumerate(self.switches)]
        positive += [self.switches[k].high - force[i] for i, k in enumerate(self.held)]
        positive += [force[i] - self.switches[k].low for i, k in enumerate(self.held)]
        system = System(
            residual=ca.vertcat(put(self.switched.residual), *rest),
            dx=dae.dx,
            x=dae.x,
            z=ca.vertcat(dae.z, force),
            u=dae.u,
            t=dae.t,
            m=m,
            positive=ca.vertcat(*positive) if positive else ca.SX(0, 1),
        )
        given = [dae.dx, dae.x, system.z, dae.u, dae.t, m]
        output = ca.Function("output", given, [ca.densify(put(self.switched.output))])
        return Stepper(system, self.nominal, self.rtol), output, ca.Function("positive", given, [ca.densify(system.positive)])

    # --- points

    def start(self, x: Array, z: Array, u: Array, t: float) -> Point:
        """The point at the first sample, with the modes that fit it. Raises SolveError where there is none."""
        self.seen = np.abs(x)
        self.size = self._sizes(x, z, u, t)
        for _ in range(len(self.switches) + 1):  # before anything is solved: a law may be no number on the wrong side
            self.m = np.where(self._compiled()[2](0.0, x, z, u, t, self.m).full()[:, 0] < 0.0, -self.m, self.m)
        point = self._point(x, z, u, t)
        for _ in range(len(self.switches) + 1):
            wrong = point.positive < 0.0
            if not wrong.any():
                break
            self.m = np.where(wrong, -self.m, self.m)
            point = self._point(x, z, u, t)
        resting = [k for k, s in enumerate(self.switches) if s.kind == "hold" and abs(point.positive[k]) <= 1e-300]
        return self._settled(point, u, t, resting, quiet=True)

    def _sizes(self, x: Array, z: Array, u: Array, t: float) -> Array:
        """A least size of every switching function, below which it may be rounding error: what 1e-3 of the nominal sizes would change."""
        dae = self.dae
        if not self.switches:
            return self.size
        symbols = ca.vertcat(*(part.symbol for switch in self.switches for part in switch.parts))
        slopes = ca.jacobian(ca.vertcat(*(switch.function for switch in self.switches)), ca.vertcat(dae.x, dae.z))
        at = ca.Function("slopes", [dae.dx, dae.x, dae.z, dae.u, dae.t, symbols], [ca.densify(slopes)])
        nominal = np.array([q.nominal for q in (*dae.states, *dae.algebraics)])
        return np.asarray(np.nan_to_num(np.abs(at(0.0, x, z, u, t, 1.0).full()) @ nominal, posinf=0.0) * _LEAST, dtype=np.float64)

    def sample(self, point: Point, u: Array, t: float) -> Point:
        """The point with the input of a sample acting."""
        point = self._point(point.x, point.z, u, t)
        return point if not self.switches or point.positive.min() > 0.0 else self._settled(point, u, t, ())

    def _point(self, x: Array, z: Array, u: Array, t: float) -> Point:
        stepper = self.stepper
        if len(z) != stepper.nz:
            z = np.concatenate([z[: self.nz], np.zeros(stepper.nz - self.nz)])
        found = stepper.rate(x, z, u, t, self.m)
        if found is None:
            _, z = highest(self.dae, stepper.equations, z, np.concatenate((x, u, (t,), self.m)), t)
            found = stepper.rate(x, z, u, t, self.m)
        if found is None:
            raise self._singular(t)
        rate, z, positive = found
        return Point(x, z, rate, positive)

    # --- modes

    def _settled(self, point: Point, u: Array, t: float, crossed: Iterable[int], *, quiet: bool = False) -> Point:
        """Change the modes of the switches that have crossed, and of those that do not fit the point then."""
        pending = list(crossed)
        for _ in range(20 + 6 * len(self.switches)):
            if not pending:
                pending = self._unfit(point)
            if not pending:
                return point
            point = self._changed(point, u, t, pending.pop(0), quiet)
        raise self._stuck(t)

    def _unfit(self, point: Point) -> list[int]:
        """Held switches whose lambda is out of bounds, others whose function has the wrong sign by more than rounding."""
        count = len(self.switches)
        if self.held:
            excess = -point.positive[count:]
            if excess.max() > _EDGE:
                return [self.held[int(np.argmax(excess)) % len(self.held)]]
        wrong = point.positive[:count] < -1e3 * NOISE * np.maximum(self.size, 1e-290)
        return list(np.flatnonzero(wrong).tolist())

    def _changed(self, point: Point, u: Array, t: float, k: int, quiet: bool) -> Point:
        switch = self.switches[k]
        if k in self.held:
            upper = point.z[self.nz + self.held.index(k)] > (switch.high + switch.low) / 2
            self.held = tuple(j for j in self.held if j != k)
            self.m[k] = switch.toward if upper else -switch.toward
            self._record(t, k, "slip", quiet)
            return self._point(point.x, point.z[: self.nz], u, t)
        near = abs(point.positive[k]) <= 1e-6 * max(self.size[k], 1e-290)
        if switch.kind == "hold" and near:
            before, self.held = self.held, tuple(sorted({*self.held, k}))
            x = self._at_rest(point.x, t)
            try:
                found = self._point(x, point.z[: self.nz], u, t)
            except SolveError:
                self._round([*self.held], t)
                return self._point(point.x, point.z[: self.nz], u, t)
            force = found.z[self.nz + self.held.index(k)]
            if switch.low - _EDGE <= force <= switch.high + _EDGE:
                self._record(t, k, "stick", quiet)
                return found
            self.held = before
            side = switch.toward if force > switch.high else -switch.toward
            if side != self.m[k]:
                self.m[k] = side
                self._record(t, k, "reverse", quiet)
            return self._point(x, point.z[: self.nz], u, t)
        self.m[k] = -self.m[k]
        self._record(t, k, "switch" if switch.kind != "hold" else "reverse", quiet)
        return self._point(point.x, point.z[: self.nz], u, t)

    def _at_rest(self, x: Array, t: float) -> Array:
        """The nearest x with a = 0 for all that is held, exactly."""
        for _ in range(3):
            values = [self._corners[k](x, t) for k in self.held]
            if all(abs(a) <= 1e-17 * self.size[k] for k, (a, _) in zip(self.held, values, strict=True)):
                break
            x = x - np.linalg.lstsq(np.vstack([g for _, g in values]), np.array([a for a, _ in values]), rcond=1e-12)[0]
        return x

    def _round(self, switches: list[int], t: float) -> None:
        """Give up modes where they do not determine the motion (two frictions in one rigid train): their laws as written, rounded."""
        hard = [k for k in switches if not self.switches[k].rounded]
        if hard:
            raise self._stuck(t, hard)
        self.rounded |= set(switches)
        self.held = tuple(k for k in self.held if k not in self.rounded)

    def _record(self, t: float, k: int, kind: Any, quiet: bool) -> None:
        if not quiet:
            if k not in self._names:
                self._names[k] = component_of(self.dae, self.switches[k])
            sign = 0 if k in self.held else int(self.m[k])
            self.events.append(Event(time=t, kind=kind, component=self._names[k], function=str(self.switches[k].declared), sign=sign))

    def _singular(self, t: float) -> SolveError:
        return SolveError(
            f"the equations of '{self.dae.name}' are singular at t = {t:.9g} s: they do not give x' and the algebraic variables"
        )

    def _stuck(self, t: float, switches: Iterable[int] | None = None) -> SolveError:
        """The error for modes that do not settle."""
        last = {event.component: event.function for event in self.events[-4:]}
        for k in switches or ():
            last[component_of(self.dae, self.switches[k])] = str(self.switches[k].declared)
        where = ", ".join(f"'{function}' of '{component}'" for component, function in last.items())
        return SolveError(
            f"the integration stopped at t = {t:.9g} s: the law that switches at {where} = 0 is thrown back and forth there and neither "
            "branch goes on; round it with a width (tanh(v/width)), or give its smoothing width a value in `parameters`"
        )

    # --- steps

    def across(self, point: Point, t: float, until: float, base: Array, slope: Array, try_first: float) -> tuple[Point, float]:
        """From t, with the input of its sample acting, to `until`: the point there, and the step length to try next.

        Raises SolveError naming the time at which no step, however short, meets the tolerance, or the law that does not settle.
        """
        interval = until - t
        since, h = 0.0, min(try_first, interval)  # time since t: what is added up must not drown in a large t
        while since < interval:
            last = interval - since <= h * (1 + 1e-9)
            h = interval - since if last else h
            step = self._attempt(point, t + since, h, since, base, slope)
            if step is None or step.error > 1.0:
                h *= 0.2 if step is None else max(0.1, 0.9 * step.error ** (-1 / (STAGES + 1)))
                if h < _SMALLEST * interval:
                    point = self._forced(point, base + slope * since, t + since)
                    h = 1e-6 * interval
                continue
            longer = h * min(10.0, 0.9 * max(step.error, 1e-12) ** (-1 / (STAGES + 1)))
            crossing = None if step.clear > 0.0 else self._crossing(step)
            if crossing is None:
                since = interval if last else since + h
                point = self._accepted(step, base + slope * since, t + since)
                h, self._idle = longer, 0
                continue
            part, landed = self._land(point, step, crossing, t, h, since, base, slope)
            if landed is not None:
                since += part
                point = self._accepted(landed, base + slope * since, t + since)
                if part > 1e-12 * interval:
                    self._idle = 0
            self._idle += 1
            if self._idle > 10 + 4 * len(self.switches):
                self._round([crossing[1]], t + since)
                self._idle = 0
            point = self._settled(point, base + slope * since, t + since, self._crossed(point, crossing[1], landed is None))
        return point, h

    def _attempt(self, point: Point, t: float, h: float, since: float, base: Array, slope: Array) -> Step | None:
        return self.stepper.attempt(point.x, point.z, point.rate, t, h, since, base, slope, self.m, self.seen)

    def _accepted(self, step: Step, u: Array, t: float) -> Point:
        x = step.x if self._project is None else self._project(step.x, u, t)
        if self.held:
            x = self._at_rest(x, t)
        self.seen = step.seen
        if self.switches:
            self.size = np.maximum(self.size, np.abs(step.positive[: len(self.switches), -1]))
        return Point(x, step.z, step.rate, step.positive[:, -1])

    def _crossing(self, step: Step) -> tuple[float, int, int] | None:
        """(theta, switch, row) of the first crossing in a step."""
        count = len(self.switches)
        found = first_crossing(step.positive, np.concatenate((self.size, np.ones(2 * len(self.held)))))
        if found is None:
            return None
        theta, row = found
        return theta, row if row < count else self.held[(row - count) % len(self.held)], row

    def _land(
        self, point: Point, step: Step, crossing: tuple[float, int, int], t: float, h: float, since: float, base: Array, slope: Array
    ) -> tuple[float, Step | None]:
        """The step that ends on the crossing, and its length; None for no step where the crossing is at the start."""
        theta, k, row = crossing
        noise = NOISE * (float(self.size[k]) if row < len(self.switches) else 1.0)
        part, rate = theta * h, slope_at(step.positive[row], theta) / h
        best: tuple[float, Step | None] = 0.0, None
        for _ in range(_LOCATE):
            if part <= 4e-16 * max(abs(since), abs(h)):
                break
            landed = self._attempt(point, t + since, part, since, base, slope)
            if landed is None:
                part /= 2
                continue
            best = part, landed
            value = float(landed.positive[row, -1])
            if abs(value) <= noise or rate == 0.0:
                break
            moved = part - value / rate
            if not 0.0 < moved <= h or moved == part:
                break
            part = moved
        return best

    def _crossed(self, point: Point, k: int, at_start: bool) -> list[int]:
        """The switch of a crossing, unless the true function has not come near zero where its polynomial has."""
        if k in self.rounded:
            return []
        reached = k in self.held or at_start or point.positive[k] <= 1e-6 * max(self.size[k], 1e-290)
        return [k] if reached else []

    def _forced(self, point: Point, u: Array, t: float) -> Point:
        """Where steps die at a switching function that all but vanished, its law has no continuation beyond zero: switch there."""
        close = np.abs(point.positive[: len(self.switches)]) <= _NEAR * np.maximum(self.size, 1e-290)
        near = [k for k in np.flatnonzero(close).tolist() if k not in self.held and k not in self.rounded]
        if near and self._idle <= 10 + 4 * len(self.switches):
            self._idle += 1
            return self._settled(point, u, t, near)
        fastest = int(np.argmax(np.abs(point.rate) / np.maximum(self.seen, self.nominal))) if len(point.rate) else 0
        state = f" '{self.dae.states[fastest].name}' changes fastest;" if len(point.rate) else ""
        raise SolveError(
            f"the integration stopped at t = {t:.9g} s: no step, however short, meets the tolerance {self.rtol:g};{state} "
            "look for values that run away, or a law that is discontinuous there"
        )
