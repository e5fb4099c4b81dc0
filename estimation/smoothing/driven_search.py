"""Parameters of an unseen part that comes to rest, such as a bit that sticks and slips, from far-off guesses.

When such a body breaks away is decided by a hair, and what was a step of Gauss and Newton to its parameters leads anywhere. They are
searched for by differential evolution (R. Storn, K. Price, J. Global Optimization 11, 1997) within a factor of their guesses, for the least

    sum over the seen balances k of log rms F_k

with the unseen driven along the followed samples (`driven.py`): at first through the beginning of every recording, where few events are to
be met, then through more of it by the better half of what was tried and others that are new. What only the seen balances know is fitted to
them at every try.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import Array

from ..problem import Problem
from .driven import Driven
from .driven_fit import EXACT, Seen, known_std, rms

FACTOR = 4.0  # within which parameters are searched for, up or down
SURE = 3.0  # standard deviations of what is known of a parameter within which it is
TRIES, CROSSED = 8, 0.9  # of a generation, for each parameter; the probability that a parameter is changed
STAGES = ((0.15, 15), (0.4, 15), (1.0, 20))  # shares of the recordings that are driven, and generations there: few events first
AGREED = 0.01  # spread of the costs of a generation at which the search ends
INSTANTS = 3000  # along which a try goes, at most
STEPS, STILL, LEAP = 6, 0.02, 1.0  # of Gauss and Newton in a try, at most; their relative size at the end; the largest, a logarithm
HOPELESS = 1e3  # cost of a try that ends nowhere

Way = tuple[Array, tuple[Array, ...]]  # instants, and what drives the unseen between them


def searched(problem: Problem, driven: Driven, followed: Followed, start: Array, say: Callable[[str], None]) -> Array:
    """Parameters (np_all,) with which the unseen balances what is seen best, of those within a factor of their guesses.

    Those of the unseen are searched for along the first INSTANTS of the followed mesh, the others fitted. The same every time.
    """
    dae = problem.dae
    inside = ca.jacobian_sparsity(dae.residual[list(driven.rows.values())], dae.p).get_col()
    own, others = [i for i in problem.free if i in inside], [i for i in problem.free if i not in inside]
    seen = Seen(problem, Driven(dae, driven.rows, tuple(others), driven.velocities), followed, start)
    scale, least = _Scale.about(problem, own, start), EXACT * seen.forces(start)

    def tried(coordinates: Array, ways: list[Way]) -> tuple[float, Array]:
        now = start.copy()
        now[own] = scale.values(coordinates)
        runs = [seen.driven.go(*way, now, seen.begun(*way, now)) for way in ways]
        for _ in range(STEPS if others else 1):
            parts = [seen.left(run, along, now) for run, (_, along) in zip(runs, ways, strict=True)]
            r, J = np.concatenate([r for r, _ in parts], axis=1), np.concatenate([J for _, J in parts], axis=1)
            size = np.maximum(rms(r), least)
            if not (np.isfinite(size).all() and np.isfinite(J).all()):
                return HOPELESS, now
            before, now = now, now.copy()
            now[others] = _stepped(
                problem, others, before, r / np.maximum(size, least)[:, None], J / np.maximum(size, least)[:, None, None]
            )
            if np.allclose(now, before, rtol=STILL, atol=0.0):
                break
        return float(np.sum(np.log(size))), before

    def cost(coordinates: Array, ways: list[Way]) -> float:
        return tried(coordinates, ways)[0]

    if not own:
        return tried(np.empty(0), _ways(seen, 1.0))[1]
    best, kept, rng = scale.coordinates(start[own]), np.empty((0, len(own))), np.random.default_rng(0)
    fresh = qmc.LatinHypercube(len(own), rng=rng)
    low, high = scale.bounds
    for share, generations in STAGES:
        ways = _ways(seen, share)
        done = differential_evolution(
            cost,
            Bounds(*scale.bounds),
            args=(ways,),
            x0=best,
            init=np.vstack([kept, low + (high - low) * fresh.random(TRIES * len(own) - len(kept))]),
            maxiter=generations,
            recombination=CROSSED,
            tol=0.0,
            atol=AGREED,
            polish=False,
            rng=rng,
        )
        best = np.asarray(done.x)
        kept = done.population[np.argsort(done.population_energies)[: len(done.population) // 2]]
        say(f"driving what no output shows through {100 * share:.0f} %: {done.fun:.4g} left over after {done.nfev} tries")
    return tried(best, ways)[1]


@dataclass(frozen=True, kw_only=True)
class _Scale:
    """Coordinates of parameters about their starts: logarithms of the ratio, or for a zero start the value over its nominal."""

    start: Array
    nominal: Array
    bounds: tuple[Array, Array]

    @classmethod
    def about(cls, problem: Problem, own: list[int], start: Array) -> _Scale:
        nominal = np.array([problem.dae.parameters[i].nominal for i in own])
        bare = cls(start=start[own], nominal=nominal, bounds=(nominal, nominal))
        wide = np.full(len(own), np.log(FACTOR))
        wide[bare.start == 0] = 1.0
        low, high = np.array([problem.parameter_range(i) for i in own], dtype=np.float64).reshape(-1, 2).T
        low, high = (
            np.maximum(low, bare.start - SURE * known_std(problem, own)),
            np.minimum(high, bare.start + SURE * known_std(problem, own)),
        )
        ends = np.sort([bare.values(-wide), bare.values(wide)], axis=0)
        least, most = np.sort([bare.coordinates(np.clip(e, low, high)) for e in ends], axis=0)
        return cls(start=bare.start, nominal=nominal, bounds=(least, most))

    def values(self, coordinates: Array) -> Array:
        return np.where(self.start == 0, coordinates * self.nominal, self.start * np.exp(coordinates))

    def coordinates(self, values: Array) -> Array:
        none = self.start == 0
        ratio = np.where(none, 1.0, values / np.where(none, 1.0, self.start))
        return np.where(none, values / self.nominal, np.log(np.maximum(ratio, 1.0 / FACTOR**2)))


def _ways(seen: Seen, share: float) -> list[Way]:
    """The first share of the recordings, one after the other while there is room."""
    ways, room = [], INSTANTS
    for number, coarse in enumerate(seen.followed.transcription.horizons):
        instants = coarse.mesh.knots[: min(round(share * coarse.mesh.count), room) + 1]
        if len(instants) < 2:
            break
        ways.append((instants, seen.driven.along(seen.followed, number, (instants[1:] + instants[:-1]) / 2)))
        room -= len(instants) - 1
    return ways


def _stepped(problem: Problem, others: list[int], now: Array, r: Array, J: Array) -> Array:
    """Parameters that only the seen balances know after a step of Gauss and Newton from `now` (np_all,), inside their bounds.

    The balances have their inverse, as inertias that accelerations are divided by: one that is too large would step below zero. Where it
    is not to change its sign, the step is one of its logarithm.
    """
    if not others:
        return np.empty(0)
    std, here = known_std(problem, others), now[others]
    A = np.vstack([J.reshape(-1, len(others)), np.diag(1.0 / std)])
    b = np.concatenate([r.ravel(), (here - problem.values[others]) / std])
    step = -np.linalg.lstsq(A, b, rcond=None)[0]
    low, high = np.array([problem.parameter_range(i) for i in others]).T
    signed = (here > 0) & (low >= 0)
    ratio = np.exp(np.clip(step / np.where(signed, here, 1.0), -LEAP, LEAP))
    return np.asarray(np.clip(np.where(signed, here * ratio, here + step), low, high))
