"""Profile likelihood: how far a parameter may go, all others free, before the data object.

    D(theta) = min over everything else of cost(theta, ...) - cost(optimum),       95 % interval: D <= chi-square_1(0.95) / 2 = 1.92

(Venzon & Moolgavkar, Appl. Statist. 37, 1988; Raue et al., Bioinformatics 25, 2009). Unlike value +- 1.96 std it needs no linear
model: it follows the likelihood, is as lopsided as that, and stays open on a side where the data never object. Weights and mesh are those
of the result, and so is the inertia that the trajectories' density is measured with (`ocp/pieces.py`). Where the result is that of most
marginal likelihood (`marginal.py`), the cost is that likelihood's: with g the slope of its determinants, what is solved has -g'p in it, and
D gets what g changes by on the way.

The signed root z = sqrt(2 D) is a straight line for a linear model, so steps are taken and the level is sought in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backsight.models.errors import InputError, suggestion
from backsight.ocp import Solution, Solver, Status
from backsight.ocp.scaling import scaled

from ..problem import Problem
from ..results import Profile, Smoothing
from .marginal import slope_of_determinants, tilted
from .program import decision_bounds
from .smoother import smooth

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LEVEL = 1.959964  # of z: 95 % of a normal distribution
CLOSE = 2e-4  # of z to the level, at which a side ends
REFINEMENTS = 12
PASSES, SETTLED = 8, 1e-5  # solves in a row, and the change of the cost from one to the next that ends them
PATIENCE = 3  # times the points of a side, after which it counts as open
FLAT = 0.25  # of the step that was meant: less of z is a likelihood that flattens, and steps grow
GROWTH = 4.0  # of a step, at most
NO_STD = 0.1  # of the size of a parameter that has no standard deviation: its first step


def profile(
    problem: Problem, result: Smoothing | None, names: Sequence[str], *, points: int = 6, progress: Callable[[str], None] | None = None
) -> dict[str, Profile]:
    """Profiles of the free parameters `names`, on both sides out to the 95 % level.

    result: what `smooth(problem)` gave; None smooths first. points: on each side. Each is solved from its neighbour. Raises InputError for
    a parameter that was not estimated, and for a result that did not converge or that was read back from elsewhere.
    """
    say = progress or (lambda _: None)
    if points < 2:
        raise InputError(f"profile(points={points}): a side has at least 2 points; leave it out for 6.")
    result = smooth(problem, progress=progress) if result is None else result
    if result.solution is None or not result.solver.converged:
        raise InputError(f"profile: this result has no solution to go on from ({result.solver.status.rstrip('.')}); smooth the study anew.")
    check_names(problem, names)
    solution = tilted(result.solution)
    slope = None if solution is result.solution else slope_of_determinants(solution)
    t = solution.transcription
    free = [t.dae.parameters[i].name for i in t.nlp.free]
    lower, upper = decision_bounds(problem.posed, t)
    around = _Around.of(solution, lower, upper, slope)
    found = {}
    for name in names:
        place = t.nlp.trajectory_size + free.index(name)
        say(f"profile of {name}")
        std = result.parameters[name].std if name in result.parameters else None
        found[name] = _profile(around, place, name, t.dae.parameters[t.nlp.free[free.index(name)]].unit, std, points)
    return found


def check_names(problem: Problem, names: Sequence[str]) -> None:
    """Raise InputError for a parameter that is no constant to be estimated."""
    free = [problem.posed.dae.parameters[i].name for i in problem.posed.free]
    for name in names:
        if name not in free:
            raise InputError(f'profile: "{name}" is not estimated as a constant; {suggestion(name, free)}')


@dataclass(frozen=True, kw_only=True)
class _Around:
    """The program at its optimum: decisions, cost, bounds. Every solve has the optimum's parameters for the density of trajectories.

    slope (np,): of the determinants there, None where the optimum is of most probability together with a trajectory.
    """

    solution: Solution
    solver: Solver
    decisions: Array
    cost: float
    lower: Array
    upper: Array
    slope: Array | None

    @classmethod
    def of(cls, solution: Solution, lower: Array, upper: Array, slope: Array | None) -> _Around:
        # one pass: a second would measure the density with other parameters, whose costs do not compare
        solver = Solver(solution.solver.nlp, replace(solution.solver.options, drift=np.inf))
        start = solution.solved.decisions
        here = cls(solution=solution, solver=solver, decisions=start, cost=np.nan, lower=lower, upper=upper, slope=slope)
        cost, decisions = here.solved(here.decisions, lower, upper)
        return replace(here, cost=cost, decisions=decisions) if np.isfinite(cost) else replace(here, cost=solution.solved.cost)

    def solved(self, start: Array, lower: Array, upper: Array) -> tuple[float, Array]:
        """Cost and decisions within bounds, NaN where it did not converge; the trajectories start at `start`."""
        n = self.solution.transcription.nlp.trajectory_size
        reference = self.solution.solved.decisions[n:]
        begin = np.concatenate([start[:n], np.where(np.isfinite(reference), reference, start[n:])])
        cost = np.inf
        for _ in range(PASSES):
            values = scaled(self.solver, begin, self.solution.values)
            answer = self.solver.solve(begin, values, lower=lower, upper=upper, newton=False)
            before, cost = cost, answer.cost
            # where weights are stiff, rounding keeps a solve from its tolerance long after the cost has settled
            if answer.status.converged or (answer.status is Status.ITERATIONS and abs(before - cost) < SETTLED):
                return cost, answer.decisions
            if answer.status is not Status.ITERATIONS:
                break
            begin = np.concatenate([answer.decisions[:n], begin[n:]])
        return np.nan, begin

    def held(self, place: int, value: float, start: Array) -> tuple[float, Array]:
        """D with one decision at a value, and the decisions."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[place] = upper[place] = value
        cost, decisions = self.solved(start, lower, upper)
        return cost - self.cost - self._bent(decisions), decisions

    def _bent(self, decisions: Array) -> float:
        """What the slope's change adds on the way to these decisions, by the trapezoidal rule; NaN where nobody knows."""
        if self.slope is None or not np.all(np.isfinite(decisions)):
            return 0.0
        there = slope_of_determinants(replace(self.solution, solved=replace(self.solution.solved, decisions=decisions, on_bound=())))
        n = self.solution.transcription.nlp.trajectory_size
        return np.nan if there is None else float((there - self.slope) @ (decisions - self.decisions)[n:]) / 2.0


def _profile(around: _Around, place: int, name: str, unit: str, std: float | None, points: int) -> Profile:
    estimate = float(around.decisions[place])
    first = LEVEL * std if std else NO_STD * max(abs(estimate), float(around.solution.values.unit[place]))
    sides = [_side(around, place, sign, first / points, points) for sign in (-1.0, 1.0)]
    (below, low, low_limited), (above, high, high_limited) = sides
    values = [*((v, d) for v, d in reversed(below)), (estimate, 0.0), *above]
    return Profile(
        name=name,
        unit=unit,
        estimate=estimate,
        std=std,
        values=np.array([v for v, _ in values]),
        cost=np.array([d for _, d in values]),
        lower=low,
        upper=high,
        limited=tuple(side for side, limited in (("lower", low_limited), ("upper", high_limited)) if limited),
    )


def _side(around: _Around, place: int, sign: float, step: float, points: int) -> tuple[list[tuple[float, float]], float | None, bool]:
    """Values and D of one side, outwards; where it ends, and whether a bound ended it."""
    estimate = float(around.decisions[place])
    bound = float(around.upper[place] if sign > 0 else around.lower[place])
    stride = LEVEL / points
    kept, here, z, decisions = list[tuple[float, float]](), 0.0, 0.0, around.decisions
    farthest = abs(bound - estimate)
    if farthest < 1e-6 * step:
        return [], None, True
    for _ in range(PATIENCE * points):
        there = min(here + step, farthest)
        D, moved = around.held(place, estimate + sign * there, decisions)
        if not np.isfinite(D):
            step /= GROWTH
            if step < 1e-6 * (here + step):
                break
            continue
        now = float(np.sqrt(2.0 * max(D, 0.0)))
        if now >= LEVEL:
            end, inside = _level(around, place, sign, (here, z, decisions), (there, now))
            return [*kept, *inside], estimate + sign * end, False
        kept.append((estimate + sign * there, D))
        if there >= farthest:
            return kept, None, True
        gained = max(now - z, FLAT / GROWTH * stride)
        step = min(step * stride / gained, GROWTH * step)
        here, z, decisions = there, now, moved
    return kept, None, False


def _level(
    around: _Around, place: int, sign: float, inside: tuple[float, float, Array], outside: tuple[float, float]
) -> tuple[float, list[tuple[float, float]]]:
    """Where z crosses the level between a place inside and one outside (regula falsi, Illinois), with the points found on the way."""
    estimate = float(around.decisions[place])
    (a, za, decisions), (b, zb) = inside, outside
    fa, fb, found = za - LEVEL, zb - LEVEL, dict[float, float]()
    found[b] = zb
    for _ in range(REFINEMENTS):
        c = float(np.clip(a - fa * (b - a) / (fb - fa), a + 1e-3 * (b - a), b - 1e-3 * (b - a)))
        D, moved = around.held(place, estimate + sign * c, decisions)
        if not np.isfinite(D):
            break
        z = float(np.sqrt(2.0 * max(D, 0.0)))
        found[c], f = z, z - LEVEL
        if abs(f) < CLOSE:
            break
        if f < 0:
            a, fa, decisions, fb = c, f, moved, fb / 2
        else:
            b, fb, fa = c, f, fa / 2
    end = min(found, key=lambda c: abs(found[c] - LEVEL))
    return end, [(estimate + sign * c, z**2 / 2) for c, z in sorted(found.items()) if c <= end]
