"""What was supposed beyond the model, in words, and which bounds of states were met."""

from __future__ import annotations

import numpy as np

from backsight.ocp import Solution

from ..problem import Problem
from ..supposed import noisy_inputs

KINDS = {"ou": "Ornstein-Uhlenbeck", "matern": "Matern 3/2"}


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


def bound_notes(problem: Problem, solution: Solution) -> list[str]:
    """For every state that ended on a bound a sentence; problem: the posed one."""
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
