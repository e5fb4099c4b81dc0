"""Parameters with which unseen lags (`lags.py`) balance what is seen: where a descent over trajectories can start from far-off guesses.

    min  1/2 sum over the other balances k and all instants of (F_k/s_k)^2  +  1/2 sum ((p - guess)/std)^2,        s_k = rms F_k

along the followed samples, the lags simulated at every p, the s_k from the round before. F as `Pieces.balances` has it, as accelerations:
without inertia and forces the balances themselves are all zero. Trajectories may not bend yet: while they may, and every balance has room
for its own forces, rotors of any gain explain any motion.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from backsight.models import Dae
from backsight.ocp.follow import Followed
from backsight.ocp.pieces import Pieces
from backsight.ocp.polynomials import Array

from ..problem import Free, Problem
from .along import forces
from .lags import Lags, Run, simulated

ROUNDS, SAME = 6, 0.02  # of the s_k, at most, and their relative change at which they are as good as settled
EXACT = 1e-6  # of the forces at a balance: it need not hold better
STEPS = 20  # of Gauss and Newton in a round, at most
PAID = 1e-3  # the share of the cost that a step must save for another one to be worth its while


def fitted(problem: Problem, rows: dict[int, int], followed: Followed, start: Array) -> tuple[Array, float]:
    """Parameters (np_all,) with which the lags balance what is seen, and the largest share of its forces that a balance then leaves over.

    Free parameters are held near their guesses by their std. Where the lags have no finite answer: start itself, and 1.
    """
    lags, free = Lags(problem.dae, rows, problem.free), list(problem.free)
    seen = [row for row, e in enumerate(problem.dae.equations) if e.place is not None and row not in rows.values()]
    balances = _balances(lags, followed, seen)

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

    @lru_cache(maxsize=1)  # rows and slope are asked for one after the other
    def at(p: tuple[float, ...]) -> tuple[Array, Array]:
        now = start.copy()
        now[free] = p
        r, J = left(now, start)
        return (r if np.isfinite(J).all() else np.full(r.shape, np.nan)), J

    def scaled(p: Array, size: Array) -> Array:
        return np.concatenate([(at(tuple(p))[0] / size[:, None]).ravel(), (p - guess) / std])

    def slope(p: Array, size: Array) -> Array:
        return np.vstack([(at(tuple(p))[1] / size[:, None, None]).reshape(-1, len(free)), np.diag(1.0 / std)])

    known = [problem.parameters[problem.dae.parameters[i].name] for i in free]
    std = np.array([f.std if isinstance(f, Free) and f.std is not None else np.inf for f in known])
    found, guess, size = start.copy(), problem.values[free], _rms(at(tuple(start[free]))[0])
    if not np.isfinite(size).all():
        return found, 1.0
    low, high = zip(*(problem.parameter_range(i) for i in free), strict=True)
    least = EXACT * sized(start)
    for _ in range(ROUNDS):
        before = np.maximum(size, least)
        done = least_squares(scaled, found[free], slope, (low, high), x_scale="jac", ftol=PAID, max_nfev=STEPS, args=(before,))
        found[free] = done.x
        size = _rms(at(tuple(done.x))[0])
        if np.max(np.abs(np.log(np.maximum(size, least) / before)), initial=0.0) < SAME:
            break
    return found, float(np.max(_rms(left(found, found)[0]) / sized(found), initial=0.0))


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
    by_rate, by_lag, by_p = (a.reshape(seen, count, a.shape[1] // count) for a in parts)
    return r, by_p + np.einsum("rkn,nkp->rkp", by_rate, run.rate_slope) + np.einsum("rkn,nkp->rkp", by_lag, run.lag_slope)
