"""Least squares within bounds and on equality constraints: Gauss-Newton steps with multipliers, by elimination along time.

    | H  J' | | s |     | g |
    | J  0  | | l | = - | c |,          then X + a s with  cost + mu |c|_1  falling,  mu > |l|_inf

(J. Nocedal, S. Wright, Numerical Optimization, 2nd ed., sections 18.3 and 18.4), the matrix eliminated along time (`saddle_point.py`):
the work of a step is linear in the length of the record. Where a step leads off curved constraints it is corrected by J p = -c(X + s)
before it is shortened. Parameters stay within their bounds, all trajectories coming along.

Damping holds parameters too, for they go no further than trajectories come along: past a body that sticks and slips they creep. Where they
should be the step without damping tells well, and trajectories find their way there when it is done. So where damped steps have long saved
far less than it promises, parameters take that step alone and stay while trajectories follow. What it was worth is told some steps later:
a watchdog, for the cost may rise meanwhile (Nocedal & Wright, section 15.6).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .evaluated import Linearised
from .gauss_newton import FINE, ROUNDED, STILL, SUFFICIENT, Descent
from .nlp import Nlp, Values
from .polynomials import Array
from .saddle_point import SaddlePoint

FEASIBLE = 1e-8  # largest constraint, in the program's units; a ten-thousandth of the tolerance where that is more
DEARER = 2.0  # mu over the largest multiplier
CORRECTIONS, WORTH = 3, 0.05  # of a step that leads off curved constraints, of one this long at least
SHORTEST = 1e-4  # step length at which exact second derivatives lead further, as they do after
TIRED, LITTLE = 8, 0.1  # steps in a row that were as short, or were damped and saved no more, a log-likelihood
CURVED, STRAIGHT = 0.2, 0.9  # lengths of a step below which the next one is damped more, and above which less
DAMPED, LEAST_DAMPED, MOST_DAMPED = 1e-3, 1e-6, 1e3  # by how much at first, as a share of the diagonal, at least and at most
PACE, HOLD = 8, 10  # damped steps before parameters leap, and steps that they then stay for
PATIENCE = 25  # steps by which that must have paid; there must be room for twice as many
CREEPING, VAIN = 5.0, 2  # times what these steps saved: the promise of a leap; leaps in a row that have not paid: no more of them


def supported(nlp: Nlp, lower: Array, upper: Array) -> bool:
    """Whether only parameters have bounds that do not fix: those of trajectories take another method."""
    n = nlp.trajectory_size
    return bool(np.all(((lower == -np.inf) & (upper == np.inf) | (lower == upper))[:n]))


def descend_on_constraints(
    nlp: Nlp, values: Values, lower: Array, upper: Array, tolerance: float, limit: int, seconds: float = np.inf
) -> Descent:
    """From X = 0 to where the gradient of the Lagrangian is below the tolerance, and a rough one's promise, too; lower, upper (n + np,).

    Where a valley bends, or no part of a step leads down, steps are damped (D. W. Marquardt, J. SIAM 11, 1963). What cannot go on (numbers
    that are not finite, a matrix without an inverse, damped steps that lead nowhere) ends where it is, unsolved.
    """
    end, way, watchdog = time.monotonic() + seconds, _Way(nlp, values, lower, upper, tolerance), _Watchdog()
    for iteration in range(limit + 1):
        over = iteration == limit or time.monotonic() > end
        if not watchdog.goes_on(way, way.step(over), over):
            break
        if watchdog.before is None and way.damped >= PACE and watchdog.vain < VAIN and iteration + 2 * PATIENCE <= limit:
            there = way.here
            if way.leap():
                watchdog.before, watchdog.steps = there, 0
    here = way.here
    return Descent(
        X=here.X,
        cost=here.cost,
        iterations=iteration,
        solved=way.solved,
        acceptable=way.acceptable,
        finite=here.finite,
        multipliers=way.multipliers,
    )


class _Way:
    """Where a descent is, and how it goes on from there.

    mu: of the merit; damped: steps in a row that were; solved, acceptable: whether it is at its end.
    """

    def __init__(self, nlp: Nlp, values: Values, lower: Array, upper: Array, tolerance: float) -> None:
        self.nlp, self.values, self.lower, self.upper, self.tolerance = nlp, values, lower, upper, tolerance
        self.equal = [k for k, term in enumerate(nlp.terms) if term.equality]
        self.here = _at(nlp, np.clip(np.zeros(nlp.size), lower, upper), values)
        self.multipliers, self.mu = np.zeros(nlp.constraint_count), 0.0
        self.solved = self.acceptable = self._still = False
        self._damping, self.damped, self._lame, self._staying, self._first = 0.0, 0, 0, 0, self.here
        self._parts = list[Linearised]()

    def step(self, over: bool) -> bool:
        """One step, or damping where it leads nowhere; whether there may be another. over: there may not, and none is taken.

        Where trajectories have arrived while parameters stay, these move again: such an end is none.
        """
        goes_on = self._stepped(over)
        if goes_on or over or not self._staying:
            return goes_on
        self._move_again()
        self._lame = 0
        self.solved = self.acceptable = False
        return True

    def _move_again(self) -> None:
        self._staying, self._still = 0, False

    def _stepped(self, over: bool) -> bool:
        here = self.here
        if not here.finite or (found := self._newton(self._damping)) is None:
            return False
        kkt, g, s, self.multipliers = found
        v = g + self.nlp.evaluated.gradient(_with_rows([self._parts[k] for k in self.equal], self.multipliers))
        slope = float(np.max(np.abs(here.X - np.clip(here.X - v, self.lower, self.upper)), initial=0.0))
        on_them = float(np.max(np.abs(here.c), initial=0.0)) <= max(FEASIBLE, 1e-4 * self.tolerance)
        near, self.acceptable = slope <= self.tolerance and on_them, self._still and slope <= 1e3 * self.tolerance and on_them
        self.solved = near and (self.tolerance <= FINE or float(-g @ s) <= self.tolerance)
        if self.solved or self.acceptable or over:
            return False
        self.mu = max(self.mu, DEARER * float(np.max(np.abs(self.multipliers), initial=0.0)))
        promise, merit = float(g @ s) - self.mu * here.off, here.merit(self.mu)
        there = None
        if promise < -ROUNDED * merit:
            there = _searched(self.nlp, self.values, here, s, kkt, self.mu, promise, (self.lower, self.upper))
        if there is None:
            if -promise > max(LITTLE, ROUNDED * merit) and self._damping < MOST_DAMPED:
                self._damping = max(100 * self._damping, DAMPED)
                return True
            self.acceptable = on_them and slope <= 1e3 * self.tolerance
            return False
        length, saved = float(np.linalg.norm(there.X - here.X) / np.linalg.norm(s)), merit - there.merit(self.mu)
        self._damping = _damped(self._damping, length)
        self._first = here if self.damped == 0 else self._first
        self.damped = self.damped + 1 if self._damping > 0 and not self._staying else 0
        self._still = abs(saved) <= STILL * max(abs(merit), 1.0)
        self._to(there)
        if self._staying == 1:
            self._move_again()
        self._staying = max(self._staying - 1, 0)
        self._lame = self._lame + 1 if length < WORTH or (self._damping > 0 and saved < LITTLE) else 0
        return self._lame < TIRED

    def leap(self) -> bool:
        """Parameters alone to where the step without damping leads; whether they went there, for damped steps creep."""
        self.damped, here, n = 0, self.here, self.nlp.trajectory_size
        if (found := self._newton(0.0)) is None:
            return False
        _, g, s, _ = found
        if float(-g @ s) + self.mu * here.off < CREEPING * (self._first.merit(self.mu) - here.merit(self.mu)):
            return False
        X = here.X.copy()
        X[n:] = np.clip(X + s, self.lower, self.upper)[n:]
        self.restart(_at(self.nlp, X, self.values))
        self._staying = HOLD
        return True

    def restart(self, there: _Point) -> None:
        """Go on from another point, of which nothing is known yet."""
        self._to(there)
        self.solved = self.acceptable = self._still = False
        self._damping, self.damped, self._lame, self._staying = DAMPED, 0, 0, 0

    def _to(self, there: _Point) -> None:
        self.here, self._parts = there, []

    def _newton(self, damping: float) -> tuple[SaddlePoint, Array, Array, Array] | None:
        """The matrix here, the gradient of the cost, the step and the multipliers; None where there is none."""
        evaluated, here = self.nlp.evaluated, self.here
        self._parts = self._parts or [evaluated.linearised(number, here.X, self.values) for number in range(len(self.nlp.terms))]
        squares = [part for part in self._parts if part.number not in self.equal]
        g, H = evaluated.gradient(squares), evaluated.squares(squares)
        H[:, range(H.shape[1]), range(H.shape[1])] *= 1.0 + damping
        try:
            kkt = SaddlePoint(self.nlp, H, [self._parts[k] for k in self.equal], self.lower == self.upper)
            low, high = (here.X, here.X) if self._staying else (self.lower, self.upper)
            s, multipliers = kkt.step(g, here.c, low - here.X, high - here.X)
        except np.linalg.LinAlgError:
            return None
        return (kkt, g, s, multipliers) if np.all(np.isfinite(s)) and np.all(np.isfinite(multipliers)) else None


@dataclass
class _Watchdog:
    """before: where parameters leapt from, while nobody knows whether it paid; steps: since then; vain: leaps in a row that have not."""

    before: _Point | None = None
    steps: int = 0
    vain: int = 0

    def goes_on(self, way: _Way, may: bool, over: bool) -> bool:
        """Whether the way goes on after a step, back where it leapt from if that has not paid. may: the way by itself; over: none may."""
        if self.before is None:
            return may
        self.steps += 1
        if way.here.merit(way.mu) < self.before.merit(way.mu):
            self.before, self.vain = None, 0
        elif not may or self.steps >= PATIENCE:
            way.restart(self.before)
            self.before, self.vain, may = None, self.vain + 1, not over
        return may


@dataclass(frozen=True)
class _Point:
    """X, its cost and its constraints, these one after the other, column by column."""

    X: Array
    cost: float
    c: Array

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.cost) and np.all(np.isfinite(self.c)))

    @property
    def off(self) -> float:
        """|c|_1."""
        return float(np.abs(self.c).sum())

    def merit(self, mu: float) -> float:
        return self.cost + mu * self.off


def _at(nlp: Nlp, X: Array, values: Values) -> _Point:
    cost, c = 0.0, list[Array]()
    with np.errstate(over="ignore", invalid="ignore"):  # a step that leads too far is told by `finite`
        for term, rows in zip(nlp.terms, nlp.evaluated.rows(X, values), strict=True):
            if term.equality:
                c.append(rows.ravel(order="F"))
            else:
                cost += float(np.sum(rows**2)) / 2
        return _Point(X, cost, np.concatenate(c))


def _damped(damping: float, length: float) -> float:
    """What to add to the diagonal for the next step, as a share of it, after a step of this length."""
    if length < CURVED:
        return max(10 * damping, DAMPED)
    if length < STRAIGHT:
        return damping
    return damping / 10 if damping > LEAST_DAMPED else 0.0


def _searched(
    nlp: Nlp, values: Values, here: _Point, s: Array, kkt: SaddlePoint, mu: float, promise: float, bounds: tuple[Array, Array]
) -> _Point | None:
    """Where the merit falls as promised, on the step, or from its end back on the constraints; None where it does not."""
    length, merit = 1.0, here.merit(mu)

    def falls(point: _Point) -> bool:
        return point.finite and point.merit(mu) <= merit + SUFFICIENT * length * promise

    while length >= SHORTEST and -length * promise > ROUNDED * merit:
        there = _at(nlp, np.clip(here.X + length * s, *bounds), values)
        for number in range(CORRECTIONS if length >= WORTH else 0):
            if not there.finite or (falls(there) and number > 0):
                break
            back = _at(nlp, np.clip(there.X + kkt.onto(there.c), *bounds), values)
            if not back.merit(mu) < there.merit(mu):
                break
            there = back
        if falls(there):
            return there
        length *= 0.5 if there.finite else 0.1
    return None


def _with_rows(parts: Sequence[Linearised], rows: Array) -> list[Linearised]:
    """The same derivatives with other rows, one after the other, column by column."""
    out, first = list[Linearised](), 0
    for part in parts:
        out.append(Linearised(part.number, rows[first : first + part.r.size].reshape(part.r.shape, order="F"), part.J))
        first += part.r.size
    return out
