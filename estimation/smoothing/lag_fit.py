"""Parameters with which unseen lags (`lags.py`) balance what is seen: where a descent over trajectories can start from far-off guesses.

    min  1/2 sum over the other balances k and all instants of (F_k/s_k)^2  +  1/2 sum ((p - guess)/std)^2,        s_k = rms F_k

along the followed samples, the lags simulated at every p, the s_k from the round before. F as `Pieces.balances` has it, as accelerations:
without inertia and forces the balances themselves are all zero. Trajectories may not bend yet: while they may, and every balance has room
for its own forces, rotors of any gain explain any motion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.ocp.follow import Followed
from backsight.ocp.pieces import Pieces
from backsight.ocp.polynomials import Array

from ..problem import Free, Problem
from .along import forces
from .lags import Lags, Run, simulated

ROUNDS, SAME = 6, 0.02  # of the s_k, at most, and their relative change at which they are as good as settled
EXACT = 1e-6  # of the forces at a balance: it need not hold better
STEPS = 20  # of Levenberg and Marquardt in a round
DAMPING, DAMPED = 1e-3, 1e6  # on a unit diagonal: first, and where a step has become nothing
PAID = 1e-3  # the share of the cost that a step must save for another one to be worth its while
TO_BOUND = 0.9  # of the way to a bound, in one step: an inertia of zero is no body


def fitted(problem: Problem, rows: dict[int, int], followed: Followed, start: Array) -> tuple[Array, float]:
    """Parameters (np_all,) with which the lags balance what is seen, and the largest share of its forces that a balance then leaves over.

    Free parameters are held near their guesses by their std, which every one has.
    """
    lags = Lags(problem.dae, rows, problem.free)
    seen = [row for row, e in enumerate(problem.dae.equations) if e.place is not None and row not in rows.values()]
    balances, free = _balances(lags, followed, seen), list(problem.free)

    def sized(parameters: Array) -> Array:
        size = forces(problem, simulated(lags, followed, parameters), parameters)
        return np.array([size[k] for k in _places(problem.dae, seen)])

    def left(parameters: Array, reference: Array) -> tuple[Array, Array]:
        """F (balances, all M) with the inertia of reference (np_all,), and its slope (balances, all M, np)."""
        parts = []
        for number in range(len(followed.horizons)):
            run = lags.run(followed, number, parameters)
            dx, x, z, u, t = lags.along(followed, number, run.times)
            dx[list(rows)], x[list(rows)] = run.rate, run.lag
            parts.append(_with_slope(balances, run, (dx, x, z, u, t), (parameters, reference), len(seen)))
        return np.concatenate([r for r, _ in parts], axis=1), np.concatenate([J for _, J in parts], axis=1)

    known = [problem.parameters[problem.dae.parameters[i].name] for i in free]
    std = np.array([f.std if isinstance(f, Free) and f.std is not None else np.inf for f in known])
    found, guess, bounds = start.copy(), problem.values[free], np.array([problem.parameter_range(i) for i in free]).reshape(-1, 2)
    least = EXACT * sized(start)
    size = np.maximum(_rms(left(start, start)[0]), least)

    def rows_of(p: Array) -> tuple[Array, Array]:
        """Everything whose squares are least, (n,), and its slope (n, np)."""
        now = start.copy()
        now[free] = p
        r, J = left(now, start)
        J = (J / size[:, None, None]).reshape(-1, len(free))
        return np.concatenate([(r / size[:, None]).ravel(), (p - guess) / std]), np.vstack([J, np.diag(1.0 / std)])

    for _ in range(ROUNDS):
        found[free] = least_squares(rows_of, found[free], bounds)
        before, size = size, np.maximum(_rms(left(found, start)[0]), least)
        if np.max(np.abs(np.log(size / before)), initial=0.0) < SAME:
            break
    return found, float(np.max(_rms(left(found, found)[0]) / sized(found), initial=0.0))


def least_squares(rows: Callable[[Array], tuple[Array, Array]], p: Array, bounds: Array) -> Array:
    """p of the least 1/2 |r(p)|^2 inside bounds (np, 2), by the steps of Levenberg and Marquardt to where they hardly pay.

    rows(p) -> r (n,), dr/dp (n, np). A step goes TO_BOUND of the way to a bound at most.
    """
    damping, (r, J) = DAMPING, rows(p)
    for _ in range(STEPS):
        unit = 1.0 / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        H, g = (J * unit).T @ (J * unit), unit * (J.T @ r)
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            return p
        limits = TO_BOUND * (bounds - p[:, None]) / unit[:, None]
        while damping <= DAMPED:
            trial = p + unit * _step(H + damping * np.eye(len(p)), g, limits)
            then = rows(trial)
            if then[0] @ then[0] < r @ r:
                break
            damping *= 10
        else:
            return p
        paid = 1.0 - (then[0] @ then[0]) / (r @ r)
        p, (r, J), damping = trial, then, damping / 10
        if paid < PAID:
            break
    return p


def _step(H: Array, g: Array, limits: Array) -> Array:
    """s with H s = -g, but for those that would go beyond their limits (np, 2): they go there, and the others as it suits them."""
    s, held = np.zeros(len(g)), np.zeros(len(g), dtype=bool)
    while not held.all():
        s[~held] = np.linalg.solve(H[np.ix_(~held, ~held)], -(g + H[:, held] @ s[held])[~held])
        beyond = (s < limits[:, 0]) | (s > limits[:, 1])
        if not beyond.any():
            break
        s, held = np.clip(s, *limits.T), held | beyond
    return s


def _rms(r: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(r**2, axis=1)), dtype=np.float64)


def _places(dae: Dae, rows: list[int]) -> list[int]:
    return [int(place) for row in rows if (place := dae.equations[row].place) is not None]


def _balances(lags: Lags, followed: Followed, seen: list[int]) -> Any:
    """(x', x, z, u, t, p, p_ref) -> F of the seen balances and its Jacobians in l', l and the free parameters."""
    dae, t = lags.dae, followed.transcription
    places = tuple(_places(dae, [*seen, *lags.rows.values()]))  # a signal's lag has none
    pieces = Pieces(dae, t.nlp.interpolation, t.horizons, t.offsets, places)
    F = pieces.balances()[: len(seen)]
    answers = [F, *(ca.jacobian(F, s) for s in lags.symbols)]
    return ca.Function("balances", [dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p, pieces.p_ref], [ca.densify(a) for a in answers])


def _with_slope(balances: Any, run: Run, along: tuple[Array, ...], both: tuple[Array, Array], seen: int) -> tuple[Array, Array]:
    """F (balances, M) and its slope in the free parameters (balances, M, np), directly and by way of the lags."""
    count = len(run.times)
    p, p_ref = (np.repeat(a[:, None], count, axis=1) for a in both)
    r, *parts = (np.asarray(a, dtype=np.float64) for a in balances.map(count)(*along, p, p_ref))
    by_rate, by_lag, by_p = (a.reshape(seen, count, -1) for a in parts)
    return r, by_p + np.einsum("rkn,nkp->rkp", by_rate, run.rate_slope) + np.einsum("rkn,nkp->rkp", by_lag, run.lag_slope)
