"""What the recordings leave open, in words: parameters and start values that can move together without any effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from backsight.ocp import Solution

from ..problem import Problem
from ..results import DETERMINED, OutputFit
from ..wording import listed
from .on_bounds import OnBounds

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Unknown = tuple[str, str, float]  # name, unit, size

NAMED = 6  # unknowns of a direction, and directions, that are told one by one, the largest first
PULLED = 3.0  # deviations beyond its bound from which on a parameter is sure to be pulled there
LESS = 0.5  # of a deviation: what is left of it where it is another unknown's doing
SLIGHT = 0.01  # of its size: an unknown that hardly moves with others is not named beside them
REMEDY = "Fix one, give it a std, or use a richer recording"
LEFT = "; this takes nothing from the deviations of all others"
FOLLOWED = 90.0  # percent of an output's variation
NOTHING = 1e-4  # of the largest entry of a direction, each in its own size: less is rounding
ROUNDING = 1e-10  # of a variance: less of a covariance is rounding


def open_where_it_stopped(
    problem: Problem, solution: Solution, bounds: OnBounds | None, fit: Mapping[str, Mapping[str, OutputFit]]
) -> list[str]:
    """The same as `open_combinations` and `hardly_told` of the last iterate of a solve that did not arrive.

    Nothing where that does not follow the samples: what these tell is a question of the forces and motions that they show.
    """
    followed = all(f.fit_percent is not None and f.fit_percent > FOLLOWED for outputs in fit.values() for f in outputs.values())
    if not followed:
        return []
    found = [*open_combinations(problem, solution, bounds), *hardly_told(problem, solution, bounds)]
    return [f"At the last iterate, which is no estimate, {said[0].lower()}{said[1:].replace(LEFT, '')}" for said in found]


def open_combinations(problem: Problem, solution: Solution, bounds: OnBounds | None) -> list[str]:
    """A sentence for every direction in which the unknowns can move unseen, those inward that are on a bound."""
    null = bounds.null if bounds is not None else np.empty((0, 0)) if solution.curvature is None else solution.curvature.null
    if not len(null):
        return []
    dae = problem.dae
    starts = [(f"{q.name} at the start of {r.title}", q.unit, q.nominal) for r in problem.fitted for q in dae.states]
    if len(problem.fitted) == 1:
        starts = [(f"{q.name} at the start", q.unit, q.nominal) for q in dae.states]
    unknowns = starts + _parameters(problem, solution)
    size = np.array([abs(s) or 1.0 for _, _, s in unknowns])
    said = []
    for direction in _few_at_a_time(null / size) * size:
        scaled = np.abs(direction / size)
        moving = [int(k) for k in np.argsort(-scaled) if scaled[k] > NOTHING * scaled.max()]
        if len(moving) > NAMED + 1:
            moving.sort(key=lambda k: k < len(starts))  # of many, parameters are named before starts
        if len(moving) == 1:
            said.append(f"The recordings do not determine {unknowns[moving[0]][0]}.")
            continue
        step = direction / abs(direction[moving[0]])
        names, steps = _steps(unknowns, step * _way(step[len(starts) :], bounds, step[moving[0]]), moving)
        said.append(f"The recordings do not tell {names} apart: moving {steps} changes nothing that was measured.")
    if len(said) > NAMED + 1:
        said = [*said[:NAMED], f"The recordings leave {len(said) - NAMED} more combinations open."]
    if np.any(np.abs(null[:, len(starts) :] / size[len(starts) :]) > NOTHING * np.abs(null / size).max()):
        said[-1] += f" {REMEDY}{LEFT}."
    return said


def hardly_told(problem: Problem, solution: Solution, bounds: OnBounds | None) -> list[str]:
    """A sentence for every combination of parameters of which each is known no better than to a half of its size for the others' sake.

    Of one whose deviation with the others held is less than a half of its own: with as few others as halve it, and leave it when
    all the rest is held. They move along the least cost.
    """
    curvature = solution.curvature if bounds is None else bounds.without
    if curvature is None:
        return []
    told = np.isfinite(curvature.parameter_variance) & (curvature.parameter_variance > 0)
    if bounds is not None:  # those that are pulled beyond their bounds stay there
        told[bounds.places[~(bounds.beyond <= PULLED)]] = False
    here = np.flatnonzero(told)
    if len(here) < 2:
        return []
    everything = _parameters(problem, solution)
    unknowns = [everything[k] for k in here]
    size = np.array([abs(s) or 1.0 for _, _, s in unknowns])
    covariance = np.asarray(curvature.parameter_covariance[np.ix_(here, here)] / np.outer(size, size), dtype=np.float64)
    known = covariance + ROUNDING * np.diag(np.diag(covariance))  # what is told exactly has an inverse too
    information, share = np.linalg.inv(known), np.sqrt(np.diag(covariance))
    said, named = list[str](), set[int]()
    for j in np.argsort(-share).tolist():
        if share[j] <= DETERMINED or j in named or (group := _together(np.asarray(information), j)) is None:
            continue
        named |= set(group)
        along = np.linalg.inv(information[np.ix_(group, group)])[:, 0]
        step = np.zeros(len(everything))
        step[here[group]] = along / np.abs(along).max() * DETERMINED * size[group]
        far = np.abs(step[here[group]] / size[group])
        order = [here[group[k]] for k in np.argsort(-far, kind="stable") if far[k] > SLIGHT]
        names, steps = _steps(everything, step * _way(step, bounds, step[here[j]]), order, 2 * NAMED)
        if slight := len(group) - len(order):
            steps += f", and {slight} more by less than {SLIGHT:.0%} of {'its' if slight == 1 else 'their'} size,".replace("%", " %")
        said.append(f"The recordings hardly tell {names} apart: moving {steps} changes next to nothing that was measured.")
    if len(said) > NAMED + 1:
        said = [*said[:NAMED], f"So it is with {len(said) - NAMED} more combinations."]
    return [*said[:-1], f"{said[-1]} {REMEDY}."] if said else []


def _together(information: Array, j: int) -> list[int] | None:
    """An unknown, and the fewest others that it is poorly told for, one after the other; None where it is so by itself."""
    count, group = len(information), [j]
    alone = float(np.linalg.inv(information)[j, j])
    while len(group) < count:
        rest = [k for k in range(count) if k not in group]
        held = [_variance(information, j, [k for k in range(count) if k == j or k not in (*group, other)]) for other in rest]
        group.append(rest[int(np.argmin(held))])
        if min(held) < LESS**2 * alone and _variance(information, j, group) > alone / 2:
            return group
    return group if count > 1 and _variance(information, j, [j]) < LESS**2 * alone else None


def _variance(information: Array, j: int, free: list[int]) -> float:
    """Of unknown j where only these are free."""
    return float(np.linalg.inv(information[np.ix_(free, free)])[free.index(j), free.index(j)])


def _way(step: Array, bounds: OnBounds | None, first: float) -> float:
    """Forth or back: those on bounds inward, else the first one upward; step (np,)."""
    inward = 0.0 if bounds is None else float(np.sum(np.sign(step) * bounds.inward))
    return float(np.sign(inward or first))


def _parameters(problem: Problem, solution: Solution) -> list[Unknown]:
    """The free ones: name, unit, size, which is that of the estimate or of the guess; of what is guessed at zero its nominal one."""
    found = []
    for i, value in zip(problem.free, solution.solved.decisions[solution.transcription.nlp.trajectory_size :].tolist(), strict=True):
        info = problem.dae.parameters[i]
        guess = abs(getattr(problem.parameters[info.name], "guess", 0.0)) or abs(info.nominal)
        found.append((info.name, info.unit, max(abs(value), guess)))
    return found


def _steps(unknowns: Sequence[Unknown], direction: Array, moving: Sequence[int], named: int = NAMED) -> tuple[str, str]:
    """Which ones move, and each by how much; named: so many of more."""
    names = [unknowns[k][0] for k in moving]
    steps = [f"{unknowns[k][0]} by {_quantity(direction[k], unknowns[k][1])}" for k in moving]
    more = len(moving) - named
    if more > 1:
        names, steps = ([*few[:named], f"{more} more"] for few in (names, steps))
    return listed(names), listed(steps)


def _few_at_a_time(directions: Array) -> Array:
    """The same span with as few entries in each row as elimination finds, parameters (last) first; rows (r, m)."""
    rows = directions / np.abs(directions).max(axis=1, keepdims=True)
    for k in range(len(rows)):
        left = np.abs(rows[k:])
        i, j = np.unravel_index(int(np.argmax(left[:, ::-1])), left.shape)
        j = rows.shape[1] - 1 - j
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, j], rows[k])
    return np.asarray(np.where(np.abs(rows) > NOTHING * np.abs(rows).max(axis=1, keepdims=True), rows, 0.0))


def _quantity(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip() if unit != "1" else f"{value:.3g}"
