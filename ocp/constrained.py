"""Least squares within bounds and on equality constraints: Gauss-Newton steps with multipliers, by elimination along time.

    | H  J' | | s |     | g |
    | J  0  | | l | = - | c |,          then X + a s with  cost + mu |c|_1  falling,  mu > |l|_inf

(J. Nocedal, S. Wright, Numerical Optimization, 2nd ed., sections 18.3 and 18.4). The matrix is block-tridiagonal in time with a border, as
in `curvature.py`: block k holds the interior of interval k, x(t_(k+1)) and the multipliers of the interval's constraints, which determine
them from x(t_k); the first knot of every horizon, the multipliers of what must hold there, and the parameters form the border. Where a
step leads off curved constraints it is corrected by J p = -c(X + s) before it is shortened. Parameters stay within their bounds: the
step is the least of its quadratic there, all trajectories coming along. The work of a step is linear in the length of the record.

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
from numpy.typing import NDArray

from .blocktridiagonal import BlockTridiagonal, factor, times
from .evaluated import Linearised
from .gauss_newton import FINE, ROUNDED, STILL, SUFFICIENT, Descent
from .nlp import Nlp, Values
from .polynomials import Array

Index = NDArray[np.int64]

FEASIBLE = 1e-8  # largest constraint, in the program's units; a ten-thousandth of the tolerance where that is more
DEARER = 2.0  # mu over the largest multiplier
DEPENDENT = 1e-12  # eigenvalues of the border, in units in which its diagonal is one, that are rounding
CORRECTIONS, WORTH = 3, 0.05  # of a step that leads off curved constraints, of one this long at least
SHORTEST = 1e-4  # step length at which exact second derivatives lead further, as they do after
TIRED, LITTLE = 8, 0.1  # steps in a row that were as short, or were damped and saved no more, a log-likelihood
CURVED, STRAIGHT = 0.2, 0.9  # lengths of a step below which the next one is damped more, and above which less
DAMPED, LEAST_DAMPED, MOST_DAMPED = 1e-3, 1e-6, 1e3  # by how much at first, as a share of the diagonal, at least and at most
PACE, HOLD = 8, 10  # damped steps before parameters leap, and steps that they then stay for
PATIENCE = 25  # steps by which that must have paid; there must be room for twice as many
CREEPING, VAIN = 5.0, 2  # times what these steps saved: the promise of a leap; leaps in a row that have not paid: no more of them
EPS = float(np.finfo(np.float64).tiny)


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
    end, way, before, vain, since = time.monotonic() + seconds, _Way(nlp, values, lower, upper, tolerance), None, 0, 0
    for iteration in range(limit + 1):
        over = iteration == limit or time.monotonic() > end
        goes_on = way.step(over)
        if before is not None and way.here.merit(way.mu) < before.merit(way.mu):
            before, vain = None, 0
        if before is not None and (not goes_on or iteration - since >= PATIENCE):
            way.restart(before)
            before, vain, goes_on = None, vain + 1, not over
        if not goes_on:
            break
        if before is None and way.damped >= PACE and vain < VAIN and iteration + 2 * PATIENCE <= limit:
            there = way.here
            if way.leap():
                before, since = there, iteration
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
        self._damping, self.damped, self._lame, self._staying, self._first = 0.0, 0, 0, 0, np.inf
        self._parts = list[Linearised]()

    def step(self, over: bool) -> bool:
        """One step, or damping where it leads nowhere; whether there may be another. over: there may not, and none is taken."""
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
        self._first = merit if self.damped == 0 else self._first
        self.damped = self.damped + 1 if self._damping > 0 and not self._staying else 0
        self._still = abs(saved) <= STILL * max(abs(merit), 1.0)
        self._to(there)
        self._staying = max(self._staying - 1, 0)
        self._lame = self._lame + 1 if length < WORTH or (self._damping > 0 and saved < LITTLE) else 0
        return self._lame < TIRED

    def leap(self) -> bool:
        """Parameters alone to where the step without damping leads; whether they went there, for damped steps creep."""
        self.damped, here, n = 0, self.here, self.nlp.trajectory_size
        if (found := self._newton(0.0)) is None:
            return False
        _, g, s, _ = found
        if float(-g @ s) < CREEPING * (self._first - here.merit(self.mu)):
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

    def _newton(self, damping: float) -> tuple[_Kkt, Array, Array, Array] | None:
        """The matrix here, the gradient of the cost, the step and the multipliers; None where there is none."""
        evaluated, here = self.nlp.evaluated, self.here
        self._parts = self._parts or [evaluated.linearised(number, here.X, self.values) for number in range(len(self.nlp.terms))]
        squares = [part for part in self._parts if part.number not in self.equal]
        g, H = evaluated.gradient(squares), evaluated.squares(squares)
        H[:, range(H.shape[1]), range(H.shape[1])] *= 1.0 + damping
        try:
            kkt = _Kkt(self.nlp, H, [self._parts[k] for k in self.equal], self.lower == self.upper)
            low, high = (here.X, here.X) if self._staying else (self.lower, self.upper)
            s, multipliers = kkt.step(g, here.c, low - here.X, high - here.X)
        except np.linalg.LinAlgError:
            return None
        return (kkt, g, s, multipliers) if np.all(np.isfinite(s)) and np.all(np.isfinite(multipliers)) else None


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
    nlp: Nlp, values: Values, here: _Point, s: Array, kkt: _Kkt, mu: float, promise: float, bounds: tuple[Array, Array]
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


class _Kkt:
    """The matrix at one X, factored, with some decisions fixed."""

    def __init__(self, nlp: Nlp, squares: Array, constraints: Sequence[Linearised], fixed: NDArray[np.bool_]) -> None:
        """squares (N, local + np, local + np); constraints: linearised; fixed (n + np,)."""
        self._place(nlp, constraints)
        self._fill(squares, constraints)
        self._scale(fixed)
        self._tree: BlockTridiagonal = factor(self.diagonal, self.lower, self._knot)
        self._X = self._tree.solve(self.border)
        R = self.border - times(self.diagonal, self.lower, self._knot, self._X)
        better = self._X + self._tree.solve(R)
        S = self.corner - np.einsum("kbi,kbj->ij", self.border, self._X) - np.einsum("kbi,kbj->ij", better, R)
        self._X, self._S = better, (S + S.T) / 2

    def step(self, g: Array, c: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Step s (n + np,) and multipliers, the parameters' step within [low, high]."""
        return self._solved(-g, -c, low[self._n :], high[self._n :])

    def onto(self, c: Array) -> Array:
        """The step that takes the constraints back, parameters unmoved."""
        zero = np.zeros(self._size - self._n)
        return self._solved(np.zeros(self._size), -c, zero, zero)[0]

    # ---- places

    def _place(self, nlp: Nlp, constraints: Sequence[Linearised]) -> None:
        index, nx = nlp.index, nlp.interpolation.states
        self._n, self._size, self._nx = nlp.trajectory_size, nlp.size, nx
        self._own, self._local = len(index) - nx, len(index)
        self._knot = slice(self._own - nx, self._own)
        self._starts = np.flatnonzero(np.insert(index[0, 1:] != index[self._own, :-1], 0, True))
        self._later = np.setdiff1d(np.arange(index.shape[1]), self._starts)
        self._inside, self._first = index[nx:].T, index[:nx, self._starts].T  # decisions of the blocks, and of the border
        self._offsets, self._edges = list[int](), list[int]()
        used, edge = self._own, self._first.size
        for part in constraints:
            at_start = nlp.terms[part.number].nodes is None
            self._offsets.append(-1 if at_start else used)
            self._edges.append(edge if at_start else -1)
            used, edge = used + (0 if at_start else part.J.shape[1]), edge + (part.r.size if at_start else 0)
        self._width, self._edge = used, edge
        self._intervals = [nlp.terms[part.number].interval for part in constraints]
        self._counts = [part.J.shape[1] for part in constraints]

    def _fill(self, squares: Array, constraints: Sequence[Linearised]) -> None:
        count, nx, own, local = len(squares), self._nx, self._own, self._local
        P, knot, later, starts = slice(self._edge, self._edge + squares.shape[1] - local), self._knot, self._later, self._starts
        self.diagonal, self.lower = np.zeros((count, self._width, self._width)), np.zeros((count - 1, self._width, nx))
        self.border, self.corner = np.zeros((count, self._width, P.stop)), np.zeros((P.stop, P.stop))
        self.diagonal[:, :own, :own] = squares[:, nx:local, nx:local]
        self.diagonal[later - 1, knot, knot] += squares[later, :nx, :nx]
        self.lower[later - 1, :own] = squares[later, nx:local, :nx]
        self.border[:, :own, P] = squares[:, nx:local, local:]
        self.border[later - 1, knot, P] += squares[later, :nx, local:]
        self.corner[P, P] = squares[:, local:, local:].sum(axis=0)
        firsts = [slice(nx * k, nx * (k + 1)) for k in range(len(starts))]
        for k, F in zip(starts, firsts, strict=True):
            self.border[k, :own, F] = squares[k, nx:local, :nx]
            self.corner[F, F] = squares[k, :nx, :nx]
            self.corner[F, P], self.corner[P, F] = squares[k, :nx, local:], squares[k, :nx, local:].T
        for part, offset, edge, where in zip(constraints, self._offsets, self._edges, self._intervals, strict=True):
            m = part.J.shape[1]
            if offset < 0:
                for j, k in enumerate(where):
                    rows, F = slice(edge + m * j, edge + m * (j + 1)), firsts[int(np.searchsorted(starts, k))]
                    self.border[k, :own, rows] = part.J[j, :, nx:local].T
                    for columns, block in ((F, part.J[j, :, :nx]), (P, part.J[j, :, local:])):
                        self.corner[rows, columns], self.corner[columns, rows] = block, block.T
                continue
            rows = slice(offset, offset + m)
            self.diagonal[where, rows, :own] = part.J[:, :, nx:local]
            self.diagonal[where, :own, rows] = np.swapaxes(part.J[:, :, nx:local], 1, 2)
            self.border[where, rows, P] = part.J[:, :, local:]
            follows = ~np.isin(where, starts)
            self.lower[where[follows] - 1, rows] = part.J[follows, :, :nx]
            for k, F in zip(starts, firsts, strict=True):
                self.border[k, rows, F] = part.J[np.searchsorted(where, k), :, :nx]

    def _scale(self, fixed: NDArray[np.bool_]) -> None:
        """Units in which unknowns have a diagonal of one and constraints a largest entry of one; what is fixed, or idle, stands alone."""
        own, count = self._own, len(self.diagonal)
        inner, outer = np.ones((count, self._width)), np.ones(len(self.corner))
        pivots = np.einsum("kii->ki", self.diagonal)[:, :own]
        inner[:, :own] = np.where(pivots > 0, 1.0 / np.sqrt(np.where(pivots > 0, pivots, 1.0)), 1.0)
        inner[:, :own][fixed[self._inside]] = 0.0
        pivots = np.diag(self.corner)
        outer = np.where(pivots > 0, 1.0 / np.sqrt(np.where(pivots > 0, pivots, 1.0)), 1.0)
        outer[: self._first.size][fixed[self._first.ravel()]] = 0.0
        outer[self._edge :][fixed[self._n :]] = 0.0
        largest = np.max(np.abs(self.diagonal[:, own:, :own]) * inner[:, None, :own], axis=2, initial=0.0)
        inner[:, own:] = np.where(largest > 0, 1.0 / np.where(largest > 0, largest, 1.0), 0.0)
        R = slice(self._first.size, self._edge)
        largest = np.max(np.abs(self.corner[R]) * outer, axis=1, initial=0.0)
        outer[R] = np.where(largest > 0, 1.0 / np.where(largest > 0, largest, 1.0), 0.0)
        self.diagonal *= inner[:, :, None] * inner[:, None, :]
        self.lower *= inner[1:, :, None] * inner[:-1, None, self._knot]
        self.border *= inner[:, :, None] * outer
        self.corner *= outer[:, None] * outer
        k, i = np.nonzero(inner == 0)
        self.diagonal[k, i, i] = 1.0
        gone = np.flatnonzero(outer == 0)
        self.corner[gone, gone] = 1.0
        self._inner, self._outer = inner, outer

    # ---- solving

    def _solved(self, of_unknowns: Array, of_constraints: Array, low: Array, high: Array) -> tuple[Array, Array]:
        blocks, edge = self._arranged(of_unknowns, of_constraints)
        x = self._tree.solve(blocks[:, :, None])
        x += self._tree.solve(blocks[:, :, None] - times(self.diagonal, self.lower, self._knot, x))
        # what the border has to solve is exact to the second order in the error of x, as S is
        rest = edge - np.einsum("kbi,kb->i", self.border, x[:, :, 0])
        q = self._bounded(rest, low, high)
        return self._back(x[:, :, 0] - self._X @ q, q)

    def _bounded(self, rest: Array, low: Array, high: Array) -> Array:
        """The border's unknowns: stationary, the parameters within their bounds."""
        unit, first = self._outer[self._edge :], self._edge
        movable = unit > 0
        low, high = np.where(movable, low, 0.0), np.where(movable, high, 0.0)
        held, of_edge = np.zeros(len(rest), dtype=bool), np.zeros(len(rest), dtype=bool)
        of_edge[self._first.size : first] = True
        q = np.zeros(len(rest))
        for _ in range(len(unit) + 1):
            free = np.flatnonzero(~held)
            q[free] = _least(self._S[np.ix_(free, free)], rest[free] - self._S[np.ix_(free, held)] @ q[held], of_edge[free])
            moved = q[first:] * unit
            beyond = ((moved < low) | (moved > high)) & movable & ~held[first:]
            if not beyond.any():
                break
            q[first:][beyond] = np.clip(moved, low, high)[beyond] / unit[beyond]
            held[first:] |= beyond
        return q

    def _arranged(self, of_unknowns: Array, of_constraints: Array) -> tuple[Array, Array]:
        blocks, edge = np.zeros(self._inner.shape), np.zeros(len(self._outer))
        blocks[:, : self._own] = of_unknowns[self._inside]
        edge[: self._first.size] = of_unknowns[self._first.ravel()]
        edge[self._edge :] = of_unknowns[self._n :]
        for offset, at, where, rows in self._of_constraints(of_constraints):
            if offset < 0:
                edge[at : at + rows.size] = rows.ravel()
            else:
                blocks[where, offset : offset + rows.shape[1]] = rows
        return blocks * self._inner, edge * self._outer

    def _back(self, blocks: Array, edge: Array) -> tuple[Array, Array]:
        blocks, edge = blocks * self._inner, edge * self._outer
        s = np.empty(self._size)
        s[self._inside] = blocks[:, : self._own]
        s[self._first.ravel()] = edge[: self._first.size]
        s[self._n :] = edge[self._edge :]
        multipliers = np.zeros(sum(m * len(where) for m, where in zip(self._counts, self._intervals, strict=True)))
        for offset, at, where, rows in self._of_constraints(multipliers):
            rows[:] = edge[at : at + rows.size].reshape(rows.shape) if offset < 0 else blocks[where, offset : offset + rows.shape[1]]
        return s, multipliers

    def _of_constraints(self, rows: Array) -> list[tuple[int, int, Index, Array]]:
        """Offset in the block, or place in the border, intervals, and a view (C, m) of every term's rows."""
        out, first = list[tuple[int, int, Index, Array]](), 0
        for offset, edge, where, m in zip(self._offsets, self._edges, self._intervals, self._counts, strict=True):
            out.append((offset, edge, where, rows[first : first + m * len(where)].reshape(len(where), m)))
            first += m * len(where)
        return out


def _least(S: Array, rhs: Array, multipliers: NDArray[np.bool_]) -> Array:
    """S^-1 rhs, nothing along what S leaves open."""
    size = np.sqrt(np.abs(np.diag(S)))
    size = np.where(size > 0, size, 1.0)
    size[multipliers] = np.max(np.abs(S[multipliers][:, ~multipliers]) / size[~multipliers], axis=1, initial=EPS)
    e, Q = np.linalg.eigh(S / np.outer(size, size))
    told = np.abs(e) > DEPENDENT
    return np.asarray((Q[:, told] / e[told]) @ (Q[:, told].T @ (rhs / size)) / size)
