"""Parameters with which the driven unseen (`driven.py`) balances what is seen: where a descent over trajectories can start from far off.

    min  1/2 sum over the other balances k and all instants of (F_k/s_k)^2  +  1/2 sum ((p - guess)/std)^2,        s_k = rms F_k

along the followed samples, the unseen simulated at every p, the s_k from the round before. F as `Pieces.balances` has it, as
accelerations: without inertia and forces the balances themselves are all zero. Trajectories may not bend yet: while they may, and every
balance has room for its own forces, rotors of any gain explain any motion, and a bit that sticks and slips goes any way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from backsight.ocp import Horizon
from backsight.ocp.columnwise import Columnwise
from backsight.ocp.follow import Followed
from backsight.ocp.pieces import Pieces
from backsight.ocp.polynomials import Array

from ..problem import Free, Problem
from .along import forces, rms
from .common_factor import KnownForces
from .driven import Driven, Run, simulated
from .softened import bare_rows

ROUNDS, SAME = 6, 0.02  # of the s_k, at most, and their relative change at which they are as good as settled
EXACT = 1e-6  # of the forces at a balance: it need not hold better
STEPS = 20  # of Gauss and Newton in a round, at most
TRUST = 2.0  # width of the prior about a parameter's first guess, over that guess
GOOD = 0.3  # share of the known forces that balances may leave over where the fit has met what moves there
SPREAD = 4.0  # factor on a parameter, up or down, from start to start
PAID = 1e-3  # the share of the cost that a step must save for another one to be worth its while

BEGINNING = 10  # share of a recording by which it is told how the unseen begin, inverse
SHOT = 200  # instants by which that is told, at least, where parameters are known
UNTOLD = 1.0  # of the cost: what other starts may save of it and nobody can tell
HOPELESS = 1e3  # of its usual size: what a balance leaves over that has no finite answer


@dataclass(frozen=True)
class Seen:
    """Balances of what is seen, with the unseen driven along the followed trajectories and the inertia of reference (np_all,)."""

    problem: Problem
    driven: Driven
    followed: Followed
    reference: Array

    @cached_property
    def rows(self) -> list[int]:
        own = set(self.driven.rows.values())
        return [row for row, e in enumerate(self.problem.dae.equations) if e.place is not None and row not in own]

    def left(self, run: Run, along: tuple[Array, ...], parameters: Array) -> tuple[Array, Array]:
        """F (balances, M) in the middles of a run, and its slope (balances, M, np) in the free parameters."""
        r, by_rate, by_state, by_p = self._at(run.state, run.rate, along, parameters)
        S = np.einsum("rkn,nkp->rkp", by_rate, run.rate_slope) + np.einsum("rkn,nkp->rkp", by_state, run.state_slope)
        return r, by_p + S

    def _at(self, state: Array, rate: Array, along: tuple[Array, ...], parameters: Array) -> tuple[Array, ...]:
        """F (balances, M) and its slopes (balances, M, ..) in l', l and the free parameters, at l and l' (n, M)."""
        count = state.shape[1]
        r, *parts = self._balances(*self.driven.filled(along, state, rate), parameters, self.reference)
        return r, *(a.reshape(-1, len(self.rows), count).transpose(1, 2, 0) for a in parts)

    def begun(self, instants: Array, along: tuple[Array, ...], parameters: Array, known: Array | None = None) -> Array:
        """Where the unseen start (n,): at rest, at zero, or where the seen balances have them; what these say afterwards counts.

        A body that nothing shows may rest with a twist before it that is not the one of its motion to come. Not offered is a start in
        motion, though the rate of that twist would tell the speed: with it a search ends as often as not where it fits the first instants
        best. known (n,): of the start, NaN where nothing is.
        """
        instants, along = _beginning(instants, along, 2)
        firsts = self._firsts(along, parameters, known)
        left = [rms(self._left_from(first, instants, along, parameters)) for first in firsts]
        size = [float(np.sum(np.log(np.maximum(x, 1e-300)))) if np.isfinite(x).all() else np.inf for x in left]
        return firsts[int(np.argmin(size))]

    def shot(self, instants: Array, along: tuple[Array, ...], parameters: Array, known: Array) -> Array:
        """The same (n,) at parameters that are right: in motion, too, as what follows tells it, in SHOT instants or more.

        By least squares from each of those, an instant that fits badly counting less than by its square. What moves none of the instants by
        more than they are off stays where it is.
        """
        instants, along = _beginning(instants, along, SHOT)
        asked, firsts = ~np.isfinite(known), self._firsts(along, parameters, known)
        nominal = np.array([self.driven.dae.states[i].nominal for i in self.driven.rows])[asked]
        sizes = [rms(self._left_from(first, instants, along, parameters)) for first in firsts]
        good = [k for k, size in enumerate(sizes) if np.isfinite(size).all()]
        if not asked.any() or not good:
            return firsts[0]
        firsts, size = [firsts[k] for k in good], np.min([sizes[k] for k in good], axis=0)

        def filled(there: Array) -> Array:
            first: Array = known.copy()
            first[asked] = there
            return first

        def left(there: Array) -> Array:
            r = self._left_from(filled(there), instants, along, parameters) / np.maximum(size, 1e-300)[:, None]
            return np.asarray(np.nan_to_num(r.ravel(), nan=HOPELESS, posinf=HOPELESS, neginf=-HOPELESS), dtype=np.float64)

        ends = [least_squares(left, first[asked], x_scale=nominal, loss="soft_l1", max_nfev=STEPS) for first in firsts]
        best = min(ends, key=lambda end: float(end.cost))
        still = [float(np.sum(np.sqrt(1.0 + left(first[asked]) ** 2) - 1.0)) for first in firsts]
        return firsts[int(np.argmin(still))] if min(still) < best.cost + UNTOLD else filled(np.asarray(best.x))

    def _firsts(self, along: tuple[Array, ...], parameters: Array, known: Array | None) -> list[Array]:
        """Starts (n,): at rest, at zero, where the seen balances have the unseen; but for what is known (n,), NaN where nothing is."""
        told = self._told(tuple(a[:, : max(along[0].shape[1] // BEGINNING, 1)] for a in along), parameters)
        firsts = [self.driven.resting(along, parameters), np.zeros(len(self.driven.rows)), told]
        return firsts if known is None else [np.where(np.isfinite(known), known, first) for first in firsts]

    def _left_from(self, first: Array, instants: Array, along: tuple[Array, ...], parameters: Array) -> Array:
        """F (balances, M) with the unseen driven from `first` (n,)."""
        return self.left(self.driven.go(instants, along, parameters, first), along, parameters)[0]

    def _told(self, along: tuple[Array, ...], parameters: Array) -> Array:
        """Where the seen balances have the unseen, in the mean (n,); zero where they do not say."""
        zero = np.zeros(len(self.driven.rows))
        still = np.zeros((len(zero), along[0].shape[1]))
        r, _, by_state, _ = self._at(still, still, along, parameters)
        if not (np.isfinite(by_state).all() and np.isfinite(r).all()):
            return zero
        return np.asarray(-np.linalg.lstsq(by_state.mean(axis=1), r.mean(axis=1), rcond=1e-9)[0], dtype=np.float64)

    def left_throughout(self, parameters: Array) -> tuple[Array, Array]:
        """The same between all samples of all recordings."""
        parts = []
        for number in range(len(self.followed.horizons)):
            run = self.driven.run(self.followed, number, parameters)
            parts.append(self.left(run, self.driven.along(self.followed, number, run.times), parameters))
        return np.concatenate([r for r, _ in parts], axis=1), np.concatenate([J for _, J in parts], axis=1)

    def forces(self, parameters: Array) -> Array:
        """Size of the forces in the balances (balances,); where an attitude turns unseen, without what only carries a weight."""
        turning = bool(bare_rows(self.problem.dae))
        size = forces(self.problem, simulated(self.driven, self.followed, parameters), parameters, varying=turning, taut=True)
        return np.array([size[k] for k in self._places(self.rows)])

    def share(self, parameters: Array) -> float:
        """The largest share of its forces that a balance leaves over."""
        there = Seen(self.problem, self.driven, self.followed, parameters)
        return float(np.max(rms(there.left_throughout(parameters)[0]) / there.forces(parameters), initial=0.0))

    def _places(self, rows: list[int]) -> list[int]:
        return [int(place) for row in rows if (place := self.problem.dae.equations[row].place) is not None]

    @cached_property
    def _balances(self) -> Columnwise:
        """(x', x, z, u, t, p, p_ref) -> F of the seen balances and its Jacobians in l', l and the free parameters."""
        dae, t = self.driven.dae, self.followed.transcription
        places = tuple(self._places([*self.rows, *self.driven.rows.values()]))  # a signal's lag has none
        pieces = Pieces(dae, t.nlp.interpolation, t.horizons, t.offsets, places)
        F = pieces.balances()[: len(self.rows)]
        answers = [F, *(ca.vec(ca.jacobian(F, s)) for s in self.driven.symbols)]
        arguments = [dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p, pieces.p_ref]
        return Columnwise(ca.Function("balances", arguments, [ca.densify(a) for a in ca.cse(answers)]), (5, 6))


def _beginning(instants: Array, along: tuple[Array, ...], least: int) -> tuple[Array, tuple[Array, ...]]:
    """The first instants, a share of all and `least` at least where there are as many, and what drives the unseen between them."""
    count = max(len(instants) // BEGINNING, least)
    return instants[: count + 1], tuple(a[:, :count] for a in along)


def fitted(problem: Problem, rows: dict[int, int], followed: Followed, start: Array, starts: int = 1) -> tuple[Array, float]:
    """Parameters (np_all,) with which the unseen balances what is seen, and the largest share of its forces a balance then leaves over.

    Free parameters are held near their guesses by their std. Where the unseen has no finite answer, or nothing seen has a balance: start
    itself, and 1. starts: at most, within a factor of `start`, until what is left of the known forces is GOOD; the least counts.
    """
    seen, rng = Seen(problem, Driven(problem.dae, rows, problem.free), followed, start), np.random.default_rng(0)
    if not seen.rows:
        return start, 1.0
    first = _fitted_from(seen, start)
    if starts == 1:
        return first
    known = KnownForces(problem, rows, followed, tuple(problem.free))
    best = known.left(first[0])
    for _ in range(starts - 1):
        if not best > np.log(GOOD):
            break
        other = _fitted_from(seen, elsewhere(problem, start, rng))
        if (left := known.left(other[0])) < best:
            first, best = other, left
    return first


def supposed_near(problem: Problem) -> Problem:
    """The problem with every free parameter supposed to be near its first guess, unless the user says how near."""
    given = dict(problem.parameters)
    for i in problem.free:
        info = problem.dae.parameters[i]
        free = given[info.name]
        if isinstance(free, Free) and free.std is None:
            given[info.name] = replace(free, std=TRUST * (abs(free.guess) or info.nominal))
    return replace(problem, model=problem.dae, parameters=given)


def elsewhere(problem: Problem, parameters: Array, rng: np.random.Generator) -> Array:
    """Parameters (np_all,) with the free ones within a factor of these, and within their bounds."""
    other = parameters.copy()
    for i in problem.free:
        other[i] = np.clip(parameters[i] * SPREAD ** rng.uniform(-1.0, 1.0), *problem.parameter_range(i))
    return other


def _fitted_from(seen: Seen, start: Array) -> tuple[Array, float]:
    problem = seen.problem
    free = list(problem.free)

    @lru_cache(maxsize=1)  # rows and slope are asked for one after the other
    def at(p: tuple[float, ...]) -> tuple[Array, Array]:
        now = start.copy()
        now[free] = p
        r, J = seen.left_throughout(now)
        return (r if np.isfinite(J).all() else np.full(r.shape, np.nan)), J

    def scaled(p: Array, size: Array) -> Array:
        return np.concatenate([(at(tuple(p))[0] / size[:, None]).ravel(), (p - guess) / std])

    def slope(p: Array, size: Array) -> Array:
        return np.vstack([(at(tuple(p))[1] / size[:, None, None]).reshape(-1, len(free)), np.diag(1.0 / std)])

    std = known_std(problem, free)
    found, guess, size = start.copy(), problem.values[free], rms(at(tuple(start[free]))[0])
    if not np.isfinite(size).all():
        return found, 1.0
    low, high = zip(*(problem.parameter_range(i) for i in free), strict=True)
    least = EXACT * seen.forces(start)
    for _ in range(ROUNDS):
        before = np.maximum(size, least)
        done = least_squares(scaled, found[free], slope, (low, high), x_scale="jac", ftol=PAID, max_nfev=STEPS, args=(before,))
        found[free] = done.x
        size = rms(at(tuple(done.x))[0])
        if np.max(np.abs(np.log(np.maximum(size, least) / before)), initial=0.0) < SAME:
            break
    return found, seen.share(found)


def known_std(problem: Problem, free: list[int]) -> Array:
    """Standard deviations of what is known of free parameters, inf where nothing is."""
    known = [problem.parameters[problem.dae.parameters[i].name] for i in free]
    return np.array([f.std if isinstance(f, Free) and f.std is not None else np.inf for f in known])


def known_start(horizon: Horizon) -> Array:
    """What is known of the states at the start of a recording, (nx,); NaN where nothing is."""
    return np.where(np.isfinite(horizon.initial_std), horizon.initial, np.nan)
