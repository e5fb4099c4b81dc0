"""Parameters of an unseen part that comes to rest, such as a bit that sticks and slips, from far-off guesses.

When such a body breaks away is decided by a hair, and what was a step of Gauss and Newton to its parameters leads anywhere. They are
searched for by differential evolution (R. Storn, K. Price, J. Global Optimization 11, 1997) within a factor of their guesses, for the least

    sum over the seen balances k of log rms F_k

with the unseen driven along the followed samples (`driven.py`): at first through the beginning of every recording, where few events are to
be met, then through more of it by the better half of what was tried and others that are new. What only the seen balances know is fitted to
them at every try by a few steps from where the last stage had it: from a far-off guess they end short of it, and costs of neighbours
jump. What is known of a parameter beforehand bounds the search to three of its deviations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.optimize import Bounds, OptimizeResult, differential_evolution
from scipy.stats import qmc

from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import Array

from ..problem import Problem
from .along import rms
from .driven import Driven
from .driven_fit import EXACT, Seen, known_start, known_std

FACTOR = 4.0  # within which parameters are searched for, up or down
SURE = 3.0  # standard deviations of what is known of a parameter within which it is
TRIES, CROSSED = 8, 0.9  # of a generation, for each parameter; the probability that a parameter is changed
STAGES = ((0.15, 15), (0.4, 15), (1.0, 20))  # shares of the recordings that are driven, and generations there: few events first
AGREED = 0.002  # spread of the costs of a generation at which the search ends; at 0.01 three of ten searches ended too early
INSTANTS, RECORDINGS = 3000, 10  # along which a try goes, and the longest in which they are, at most
TOLD = 5  # generations from message to message
STEPS, STILL, LEAP = 6, 0.02, 1.0  # of Gauss and Newton in a try, at most; their relative size at the end; the largest, a logarithm
HOPELESS = 1e3  # cost of a try that ends nowhere


@dataclass(frozen=True, kw_only=True)
class Way:
    """Instants (M + 1,) of a recording, what drives the unseen between them (.., M), and what is known of the start (n,), else NaN."""

    instants: Array
    along: tuple[Array, ...]
    known: Array


def searched(problem: Problem, driven: Driven, followed: Followed, start: Array, say: Callable[[str], None]) -> Array | None:
    """Parameters (np_all,) with which the unseen balances what is seen best, of those within a factor of their guesses.

    Those of the unseen are searched for, the others fitted. None where no try ends anywhere. The same every time.
    """
    dae = problem.dae
    inside = ca.jacobian_sparsity(dae.residual[list(driven.rows.values())], dae.p).get_col()
    own, others = [i for i in problem.free if i in inside], [i for i in problem.free if i not in inside]
    seen = Seen(problem, Driven(dae, driven.rows, tuple(others), driven.velocities), followed, start)
    scale, least, around = _Scale.about(problem, own, start), EXACT * seen.forces(start), start.copy()

    def tried(coordinates: Array, ways: list[Way]) -> tuple[float, Array]:
        now = around.copy()
        now[own] = scale.values(coordinates)
        runs = [seen.driven.go(w.instants, w.along, now, seen.begun(w.instants, w.along, now, w.known)) for w in ways]
        for _ in range(STEPS if others else 1):
            parts = [seen.left(run, way.along, now) for run, way in zip(runs, ways, strict=True)]
            r, J = np.concatenate([r for r, _ in parts], axis=1), np.concatenate([J for _, J in parts], axis=1)
            size = np.maximum(rms(r), least)
            if not (np.isfinite(size).all() and np.isfinite(J).all()):
                return HOPELESS, now
            before, now = now, now.copy()
            now[others] = _stepped(problem, others, before, r / size[:, None], J / size[:, None, None])
            if np.allclose(now, before, rtol=STILL, atol=0.0):
                break
        return float(np.sum(np.log(size))), before

    def cost(coordinates: Array, ways: list[Way]) -> float:
        return tried(coordinates, ways)[0]

    def ended(coordinates: Array, ways: list[Way]) -> Array | None:
        size, parameters = tried(coordinates, ways)
        return parameters if size < HOPELESS else None

    if not own:
        return ended(np.empty(0), _ways(seen, 1.0))
    nearer: Array | None = None
    best, kept, rng = scale.coordinates(start[own]), np.empty((0, len(own))), np.random.default_rng(0)
    fresh = qmc.LatinHypercube(len(own), rng=rng)
    low, high = scale.bounds
    for share, generations in STAGES:
        ways, doing = _ways(seen, share), f"driving what no output shows through {100 * share:.0f} %"
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
            callback=_teller(say, doing),
            rng=rng,
        )
        best = np.asarray(done.x)
        if (nearer := ended(best, ways)) is not None:
            around[others] = nearer[others]
        kept = done.population[np.argsort(done.population_energies)[: len(done.population) // 2]]
        say(f"{doing}: {done.fun:.4g} left over after {done.nfev} tries")
    return nearer


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
        return np.where(none, values / self.nominal, np.log(ratio))


def _teller(say: Callable[[str], None], doing: str) -> Callable[[OptimizeResult], None]:
    """What tells of a search every TOLD generations."""

    def told(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.nit % TOLD == 0:
            say(f"{doing}: {intermediate_result.fun:.4g} left over in generation {intermediate_result.nit}")

    return told


def _ways(seen: Seen, share: float) -> list[Way]:
    """The beginnings of the longest recordings: this share of as much of each as there is room for."""
    own, ways = list(seen.driven.rows), []
    counts = [coarse.mesh.count for coarse in seen.followed.transcription.horizons]
    chosen = sorted(np.argsort(counts)[::-1][:RECORDINGS])
    for number in chosen:
        coarse, horizon = (h[number] for h in (seen.followed.transcription.horizons, seen.followed.horizons))
        count = min(counts[number], max(INSTANTS // len(chosen), 1))
        instants = coarse.mesh.knots[: max(round(share * count), 1) + 1]
        along = seen.driven.along(seen.followed, number, (instants[1:] + instants[:-1]) / 2)
        ways.append(Way(instants=instants, along=along, known=known_start(horizon)[own]))
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
