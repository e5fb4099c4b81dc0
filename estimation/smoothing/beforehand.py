"""What was known beforehand, and what the data say of it: priors of parameters and starts that they contradict.

A prior N(m, s^2) and data that would leave sigma0 alone give p^ with 1/sigma^2 = 1/s^2 + 1/sigma0^2. Where both are right, p^ - m is
N(0, s^2 - sigma^2). That difference is lost in rounding where s is much less than sigma0: then the prior is as good as a value that is
held, and it pulls at the cost with (p^ - m)/s^2; without it p would move by C times that, with its covariance C then. So does a start that
is held exactly: it pulls with g, and would move by -C g were it free.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from backsight.ocp import Solution
from backsight.ocp.curvature import Curvature, curvature
from backsight.ocp.evaluated import Linearised

from ..problem import Free, Problem
from ..results import Smoothing
from ..wording import measured

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SURE = 5.0  # deviations of a start, which there are many of
CONTRARY = 3.5  # deviations of a prior: one in 2000
TOLD = 0.01  # of the prior's variance: where the data say less of it, it is looked at as if held


def contradicted(problem: Problem, solution: Solution) -> list[str]:
    """A sentence for every prior and every start that was given and that the data contradict."""
    if solution.curvature is None:
        return []
    given = set(problem.initial)
    found = [*_priors(problem.posed, solution, solution.curvature), *_uncertain_starts(solution, given), *_exact_starts(solution, given)]
    return [f"{said}: that contradicts the data, or the model lacks something. Values and deviations mislead." for said in found]


def freed(problem: Problem) -> Problem | None:
    """The problem without what it gives of starts, and of parameters beside their guesses; None where it gives nothing."""
    priors = {name: replace(p, std=None) for name, p in problem.parameters.items() if isinstance(p, Free) and p.std is not None}
    if not (priors or problem.initial):
        return None
    return replace(problem, parameters={**problem.parameters, **priors}, initial={})


def blamed(problem: Problem, without: Smoothing) -> str:
    """What a problem without an answer was given that one without it contradicts; a sentence or two."""
    found = []
    for name, given in problem.parameters.items():
        there = without.parameters.get(name)
        if not isinstance(given, Free) or given.std is None or there is None or there.std is None:
            continue
        if abs(there.value - given.guess) > SURE * np.hypot(given.std, there.std):
            found.append(f"{name} would be {_measured(there.value, there.std)} {there.unit} instead of {given.guess:.6g} ± {given.std:.2g}")
    for recording, table in without.estimates.items():
        for name in [name for name in problem.initial if name in table]:
            start, value, std = problem.start[name], float(table[name].iloc[0]), float(table[f"{name}.std"].iloc[0])
            if abs(value - start.value) > SURE * np.hypot(start.std, std):
                which = f"{name} of {recording}" if len(without.estimates) > 1 else name
                found.append(f"{which} would begin at {_measured(value, std)} instead of {start.value:.6g}")
    said = f": {'; '.join(found)}" if found else ""
    return f"The same problem without what was given of the start or of parameters is solved{said}. Correct it, or leave it out."


def _measured(value: float, std: float) -> str:
    return " ± ".join(measured(value, std)) if std > 0 and np.isfinite([value, std]).all() else f"{value:.6g}"


def _priors(problem: Problem, solution: Solution, known: Curvature) -> Iterable[str]:
    row = 0  # of the term of priors
    for number, index in enumerate(problem.free):
        info = problem.dae.parameters[index]
        given = problem.parameters[info.name]
        if not isinstance(given, Free) or given.std is None:
            continue
        value, variance = float(solution.parameters[index]), float(known.parameter_variance[number])
        said = f"{info.name} = {given.guess:.6g} ± {given.std:.2g} {info.unit} was known beforehand, and"
        room = given.std**2 - variance
        if room > TOLD * given.std**2:
            off = abs(value - given.guess) / float(np.sqrt(room))
            if off > CONTRARY:
                alone = value + (value - given.guess) * variance / room
                yield (
                    f"{said} the estimate {value:.6g} is {off:.2g} times as far from it as data that agree would lead; without it that "
                    f"would be near {alone:.4g}"
                )
        else:
            free = _without_prior(solution, number, row, (value - given.guess) / given.std**2)
            if free is not None and abs(free[0]) > CONTRARY * np.hypot(free[1], given.std):
                yield f"{said} without that it would be near {_measured(value + free[0], free[1])}"
        row += 1


def _without_prior(solution: Solution, number: int, row: int, pull: float) -> tuple[float, float] | None:
    """How far the number-th free parameter would move without its prior, the row-th, and its deviation then; None where it is not told."""
    term = solution.term("parameter prior")
    scale = solution.values.scale[term].copy()
    scale[row] = 0.0
    values = replace(solution.values, scale=(*solution.values.scale[:term], scale, *solution.values.scale[term + 1 :]))
    nlp = solution.transcription.nlp
    try:
        free = curvature(nlp, *solution.solver.kkt(solution.solved.decisions, values), values.unit, solution.held)
    except np.linalg.LinAlgError:
        return None
    variance = float(free.parameter_variance[number])
    return (variance * pull, float(np.sqrt(variance))) if 0 < variance < np.inf else None


def _uncertain_starts(solution: Solution, given: set[str]) -> Iterable[str]:
    t = solution.transcription
    for number, horizon in enumerate(t.horizons):
        variance = np.diagonal(solution.interval_covariance[t.offsets[number]])
        for i, std in enumerate(horizon.initial_std):
            value = solution.solved.decisions[t.starts[number][i]]
            if (
                t.dae.states[i].name in given
                and 0 < std < np.inf
                and (off := _deviations(value - horizon.initial[i], float(std), float(variance[i]))) > SURE
            ):
                state = t.dae.states[i]
                yield (
                    f"{state.name} = {horizon.initial[i]:.6g} ± {std:.2g} {state.unit} was known of the start, and the estimate "
                    f"{value:.6g} is {off:.2g} times as far from it as data that agree would lead"
                )


def _deviations(distance: float, std: float, variance: float) -> float:
    """How many of its deviations an estimate is from what was known; 0 where the data say next to nothing."""
    room = std**2 - variance
    return abs(distance) / float(np.sqrt(room)) if room > TOLD * std**2 else 0.0


def _exact_starts(solution: Solution, given: set[str]) -> Iterable[str]:
    t = solution.transcription
    exact = np.array([h.initial_std == 0 for h in t.horizons]) & [q.name in given for q in t.dae.states]
    if not exact.any():
        return
    held = np.setdiff1d(solution.held, t.starts[exact])
    try:
        free = curvature(t.nlp, *solution.solver.kkt(solution.solved.decisions, solution.values), solution.values.unit, held)
    except np.linalg.LinAlgError:
        return
    slope = _slope(solution) / solution.values.unit
    for number, horizon in enumerate(t.horizons):
        known = np.flatnonzero(exact[number])
        here = t.offsets[number]
        C, null = free.interval_covariance[here][np.ix_(known, known)], free.interval_null[here][known]
        moves = -C @ slope[t.starts[number][known]]
        for i, move, variance, lost in zip(known, moves, np.diag(C), np.sum(null**2, axis=1), strict=True):
            state = t.dae.states[i]
            if variance > lost and abs(move) > SURE * np.sqrt(variance):
                yield (
                    f"{state.name} = {horizon.initial[i]:.6g} {state.unit} was given for the start, and without that it would be "
                    f"{_measured(horizon.initial[i] + move, float(np.sqrt(variance)))}"
                )


def _slope(solution: Solution) -> Array:
    """Gradient of the Lagrangian in the program's units, (n + np,): zero but for what is held."""
    evaluated, values = solution.transcription.nlp.evaluated, solution.values
    X, parts, offset = values.scaled(solution.solved.decisions), list[Linearised](), 0
    for number, term in enumerate(solution.transcription.nlp.terms):
        part = evaluated.linearised(number, X, values)
        if term.equality:
            count = part.r.size
            part = replace(part, r=solution.solved.multipliers[offset : offset + count].reshape(part.r.shape, order="F"))
            offset += count
        parts.append(part)
    return evaluated.gradient(parts)
