"""What was supposed beyond the model, in words, and which bounds were met."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from backsight.ocp import Solution

from ..problem import Problem
from ..recordings.noise import robust_std
from ..results import DETERMINED
from ..supposed import noisy_inputs
from .agreement import MISLEAD
from .on_bounds import OnBounds
from .undetermined import PULLED

KINDS = {"ou": "Ornstein-Uhlenbeck", "matern": "Matern 3/2"}
MOSTLY = 0.5, 2.0  # of the variance of an input's steps from row to row: between these its noise is what they are
FELT = 0.1  # of that noise's variance, that the machine's motion tells of: less does not move the parameters


def noise_notes(problem: Problem, estimates: Mapping[str, pd.DataFrame]) -> list[str]:
    """A sentence for every measured input that is hardly more than noise from row to row, where the machine would feel that.

    V supposes that an input acts as recorded but for an error of its own at every row, independent of what is recorded. One that moves less
    from row to row than its sensor's noise does not, and the likelihood of these errors then takes the inertia for what the machine did not
    feel of them, by any number of deviations (errors in variables: Soderstrom, Automatica 43, 2007).
    """
    found = []
    for name, std in noisy_inputs(problem).items():
        steps = np.concatenate([np.diff(r.inputs[name]) for r in problem.fitted])
        size = robust_std(steps[steps != 0]) if np.any(steps) else np.inf
        left = np.concatenate([table[f"{name}.std"].dropna().to_numpy() for table in estimates.values()])
        if MOSTLY[0] < 2.0 * (std / size) ** 2 < MOSTLY[1] and np.mean(left**2) < (1.0 - FELT) * std**2:
            unit = next(q.unit for q in problem.dae.inputs if q.name == name)
            found.append(
                f"{name}: what it differs by from row to row, {size:.3g} {unit}, is mostly noise of the std given, {std:.3g}, and the "
                f"machine would have felt that. {MISLEAD} Inertias and all that goes with them may be far off. Take what was commanded, or "
                "a quieter sensor."
            )
    return found


def supposed_notes(problem: Problem) -> list[str]:
    """A sentence for every input that is measured and every parameter that is no single number."""
    units = {q.name: q.unit for q in problem.dae.inputs} | {p.name: p.unit for p in problem.dae.parameters}
    found = [
        f"{name} was estimated as it acted: its recorded values have a std of {std:.3g} {units[name]} as given."
        for name, std in noisy_inputs(problem).items()
    ]
    for name, free in problem.varying.items():
        if free.drift is not None:
            found.append(
                f"{name} drifts by {free.drift:.3g} {units[name]} in a second and sqrt(T) times that in T seconds, as given; its value is "
                "the mean over time and its std the mean of the stds, which that of the mean does not exceed."
            )
            if any(piece.part for piece in problem.fitted):
                found.append(f"{name} begins anew after a gap: what was known of it before does not count there.")
    return found


def colour(problem: Problem, place: str) -> str:
    """What the residual force of a place is like where it is not white."""
    if place not in problem.weights.tau:
        return ""
    kind = KINDS[problem.weights.kind.get(place, "ou")]
    return f", the rms of a coloured force ({kind}, {problem.weights.tau[place]:.3g} s)"


def pulled_notes(problem: Problem, solution: Solution, bounds: OnBounds | None) -> list[str]:
    """For every bound on which all else depends a sentence: of parameters that the data pull beyond it, of states that lie on it.

    problem: the posed one.
    """
    pulled = [k for k in solution.parameters_on_bounds.tolist() if _pull(bounds, k) > PULLED]
    return [_on_its_bound(problem, solution, k, bounds) for k in pulled] + _states_on_bounds(problem, solution)


def unpulled_notes(problem: Problem, solution: Solution, bounds: OnBounds | None) -> list[str]:
    """The same of the other parameters on bounds, which may as well lie inside of them or are not told."""
    others = [k for k in solution.parameters_on_bounds.tolist() if not _pull(bounds, k) > PULLED]
    return [_on_its_bound(problem, solution, k, bounds) for k in others]


def _pull(bounds: OnBounds | None, number: int) -> float:
    """Deviations by which the data pull a parameter beyond its bound; inf where nobody could look."""
    return np.inf if bounds is None else float(bounds.beyond[bounds.places.tolist().index(number)])


def _on_its_bound(problem: Problem, solution: Solution, number: int, bounds: OnBounds | None) -> str:
    """What a parameter on a bound means for the others; number: among the free ones."""
    t = solution.transcription
    info, value = t.dae.parameters[t.nlp.free[number]], solution.solved.decisions[t.nlp.trajectory_size + number]
    value = problem.nearest_bound(t.nlp.free[number], float(value))
    start = f"{info.name} ended on its bound, {value:.6g} {info.unit}"
    if bounds is None:
        return f"{start}: all other values and deviations suppose that it is right."
    k = bounds.places.tolist().index(number)
    if bounds.beyond[k] > PULLED:
        pull = f"the data pull it {bounds.beyond[k]:.2g} deviations beyond"
        return f"{start}: {pull}, and all other values and deviations suppose that it is right."
    if not np.isfinite(bounds.reach[k]):
        return f"{start}, but the recordings do not tell it."
    if not np.isfinite(bounds.beyond[k]):
        return f"{start}: the recordings tell it together with others that are on their bounds, and all else supposes that these are right."
    include = "deviations of the other parameters include that, those of trajectories and of what drifts do not"
    free = [(t.dae.parameters[i], float(solution.parameters[i])) for i in t.nlp.free]
    size = np.array([max(abs(value), abs(q.nominal)) or 1.0 for q, value in free])
    if np.max(np.abs(bounds.follow[:, k]) * bounds.reach[k] / size) > DETERMINED:  # farther than what is linear
        return f"{start}, but the recordings hardly tell it: {include}."
    return f"{start}, and may as well be {bounds.reach[k]:.2g} {info.unit} inside of it (one chance in twenty): {include}."


def _states_on_bounds(problem: Problem, solution: Solution) -> list[str]:
    """For every state that ended on a bound a sentence."""
    t = solution.transcription
    nx, met = t.nlp.interpolation.states, np.zeros(t.nlp.size, dtype=bool)
    met[list(solution.solved.on_bound)] = True
    found = []
    for i, q in enumerate(t.dae.states):
        if q.name not in problem.bounds:
            continue
        knots = np.unique(t.nlp.index[[i, i - nx]])
        share = np.count_nonzero(met[knots]) / len(knots)
        if share > 0:
            low, high = problem.bounds[q.name]
            found.append(
                f"{q.name} lies on one of its bounds, {low:g} and {high:g} {q.unit}, in {100 * share:.2g} % of the knots: the data pull "
                "beyond it there, and all values and deviations suppose that it is right."
            )
    return found
