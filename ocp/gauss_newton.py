"""Least squares within bounds by Gauss-Newton steps: programs whose every equation may have a residual.

    (J'J) s = -J'r        | H   B | |s|     |g|
                          | B'  C | |q| = - |h|        H block-tridiagonal along time, q the parameters

A decision that is on a bound with a gradient that pushes it outwards stays there; the step of the others is projected on the bounds and
halved until the cost falls as its slope promises (D. P. Bertsekas, Projected Newton methods for optimization problems with simple
constraints, SIAM J. Control Optim. 20, 1982). The work of a step is linear in the length of the record.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .blocktridiagonal import factor
from .nlp import Nlp, Values
from .polynomials import Array

SUFFICIENT = 1e-4  # share of the slope's promise that a step must keep
SHORTEST = 1e-10  # step length at which the cost is rounding
ROUNDED = 1e-14  # of the cost: a promise that rounding hides
STILL = 1e-8  # relative change of the cost that makes a gradient of 1e3 tolerances acceptable
FINE = 1e-4  # tolerance from which on Ipopt has the last word; beyond it a step tells what there is to be gained
RIDGE = 1e-12  # of the diagonal, where it is not definite; a thousand times as much each time
RIDGES = 4


@dataclass(frozen=True, kw_only=True)
class Descent:
    """X (n + np,), its cost, steps taken, and whether it is stationary: to the tolerance, or as far as the cost's rounding tells.

    multipliers: of the constraints, one after the other, column by column.
    """

    X: Array
    cost: float
    iterations: int
    solved: bool
    acceptable: bool
    finite: bool = True
    multipliers: Array = field(default_factory=lambda: np.zeros(0))


def descend(nlp: Nlp, values: Values, lower: Array, upper: Array, tolerance: float, limit: int, seconds: float = math.inf) -> Descent:
    """From X = 0, or what is nearest to it within the bounds (n + np,), to where the projected gradient is below the tolerance.

    A rough one is one on what a step promises of the cost, too: many small gradients that point the same way are one large one.
    limit: of iterations; seconds: after which none begins.
    """
    end = time.monotonic() + seconds
    if nlp.constraint_count:
        raise ValueError(f"descend(nlp=...) is for programs without constraints; this one has {nlp.constraint_count}.")
    evaluated = nlp.evaluated
    X = np.clip(np.zeros(nlp.size), lower, upper)
    cost = evaluated.cost(X, values)
    still = False
    for iteration in range(limit + 1):
        if not np.isfinite(cost):
            return Descent(X=X, cost=cost, iterations=iteration, solved=False, acceptable=False, finite=False)
        parts = [evaluated.linearised(number, X, values) for number in range(len(nlp.terms))]
        g = evaluated.gradient(parts)
        slope = float(np.max(np.abs(X - np.clip(X - g, lower, upper)), initial=0.0))
        near, acceptable = slope <= tolerance, still and slope <= 1e3 * tolerance
        solved = near and tolerance <= FINE
        if solved or acceptable or iteration == limit or time.monotonic() > end:
            return Descent(X=X, cost=cost, iterations=iteration, solved=solved, acceptable=acceptable)
        held = ((lower >= X) & (g > 0)) | ((upper <= X) & (g < 0))
        s = _step(nlp, evaluated.squares(parts), g, held)
        if s is None:
            return Descent(X=X, cost=cost, iterations=iteration, solved=False, acceptable=False, finite=False)
        length, promise = 1.0, float(g @ s)
        if near and -promise <= tolerance:
            return Descent(X=X, cost=cost, iterations=iteration, solved=True, acceptable=False)
        if -promise <= ROUNDED * cost:
            return Descent(X=X, cost=cost, iterations=iteration, solved=False, acceptable=True)
        while True:
            there = np.clip(X + length * s, lower, upper)
            then = evaluated.cost(there, values)
            if np.isfinite(then) and then <= cost + SUFFICIENT * length * promise:
                break
            if length < SHORTEST or -length * promise <= ROUNDED * cost:
                return Descent(X=X, cost=cost, iterations=iteration, solved=False, acceptable=slope <= 1e3 * tolerance)
            length = _shorter(cost, promise, length, then)
        still = cost - then <= STILL * max(abs(cost), 1.0)
        X, cost = there, then
    raise RuntimeError("the limit of iterations is checked in the loop")


def _shorter(cost: float, promise: float, length: float, then: float) -> float:
    """Where the parabola through the cost, its slope and the cost at `length` is least, between a tenth and a half of it."""
    if not np.isfinite(then):
        return length / 10
    bend = then - cost - length * promise
    best = -promise * length**2 / (2 * bend) if bend > 0 else length / 2
    return float(np.clip(best, 0.1 * length, 0.5 * length))


def _step(nlp: Nlp, squares: Array, g: Array, held: Array) -> Array | None:
    """The Gauss-Newton step with some decisions held; None where the matrix cannot be made definite."""
    n, at = nlp.trajectory_size, knots_and_interiors(nlp)
    diagonal, lower, border, corner = at.arranged(squares)
    free = at.of(np.where(held[:n], 0.0, 1.0), 0.0)
    unit = free / np.sqrt(_positive(np.einsum("kii->ki", diagonal)))  # of every unknown its own: a unit diagonal
    size = np.where(held[n:], 0.0, 1.0) / np.sqrt(_positive(np.diag(corner)))
    diagonal *= unit[:, :, None] * unit[:, None, :]
    lower *= unit[1:, :, None] * unit[:-1, None, at.knot]
    border *= unit[:, :, None] * size
    corner = size[:, None] * corner * size
    gone = (free == 0) | (np.einsum("kii->ki", diagonal) == 0)
    k, i = np.nonzero(gone)
    diagonal[k, i, i] = 1.0
    rhs, h = -unit * at.of(g[:n], 0.0), -size * g[n:]
    every = np.arange(diagonal.shape[1])
    for ridge in (0.0, *(RIDGE * 1e3**k for k in range(RIDGES))):
        damped = diagonal.copy()
        damped[:, every, every] += ridge
        try:
            solved = factor(damped, lower, at.knot).solve(np.concatenate([rhs[:, :, None], border], axis=2))
            S = corner - np.einsum("kbi,kbj->ij", border, solved[:, :, 1:]) + np.diag(np.where(held[n:], 1.0, max(ridge, RIDGE)))
            q = np.linalg.solve(S, h - np.einsum("kbi,kb->i", border, solved[:, :, 0]))
        except np.linalg.LinAlgError:
            continue
        s = np.concatenate([at.back(unit * (solved[:, :, 0] - solved[:, :, 1:] @ q)), size * q])
        if np.all(np.isfinite(s)) and g @ s <= 0:
            return s
    return None


@dataclass(frozen=True, kw_only=True)
class Places:
    """Trajectories in blocks: x at the start of every horizon, padded, and [interior_i | x(t_(i+1))] of every interval.

    last (N,): block of every interval, the one before ends with its left knot. where (blocks, b): decision index, -1 for padding.
    """

    last: NDArray[np.int64]
    where: NDArray[np.int64]
    states: int
    size: int

    @property
    def knot(self) -> slice:
        """The places of x at the end of an interval in its block."""
        b = self.where.shape[1]
        return slice(b - self.states, b)

    def of(self, trajectory: Array, padding: float) -> Array:
        """A vector (n,) in blocks (blocks, b)."""
        return np.asarray(np.where(self.where >= 0, trajectory[self.where], padding), dtype=np.float64)

    def back(self, blocks: Array) -> Array:
        """The vector (n,) of blocks."""
        out = np.empty(self.size)
        out[self.where[self.where >= 0]] = blocks[self.where >= 0]
        return out

    def arranged(self, squares: Array) -> tuple[Array, Array, Array, Array]:
        """Diagonal and lower blocks, border and corner of the sum of the intervals' matrices (N, local + np, local + np)."""
        count, b = self.where.shape
        nx, knot, here, before = self.states, self.knot, self.last, self.last - 1
        local = b + nx
        diagonal, lower = np.zeros((count, b, b)), np.zeros((count - 1, b, nx))
        border = np.zeros((count, b, squares.shape[1] - local))
        diagonal[here] = squares[:, nx:local, nx:local]
        diagonal[before, knot, knot] += squares[:, :nx, :nx]
        lower[before] = squares[:, nx:local, :nx]
        border[here] = squares[:, nx:local, local:]
        border[before, knot] += squares[:, :nx, local:]
        return diagonal, lower, border, squares[:, local:, local:].sum(axis=0)


def knots_and_interiors(nlp: Nlp) -> Places:
    """The blocks of a program."""
    nx, b, index = nlp.interpolation.states, nlp.interpolation.local - nlp.interpolation.states, nlp.index
    starts = np.concatenate([[True], index[0, 1:] != index[b, :-1]])  # intervals that open a horizon
    last = np.arange(index.shape[1]) + np.cumsum(starts)
    where = np.full((int(last[-1]) + 1, b), -1, dtype=np.int64)
    where[last] = index[nx:].T
    where[last[starts] - 1, b - nx :] = index[:nx, starts].T
    return Places(last=last, where=where, states=nx, size=nlp.trajectory_size)


def _positive(diagonal: Array) -> Array:
    return np.where(diagonal > 0, diagonal, 1.0)
