"""What was supposed beyond the model, in words, and which bounds of states were met."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from backsight.ocp import Solution

from ..problem import Problem
from ..supposed import noisy_inputs
from .agreement import MISLEAD

KINDS = {"ou": "Ornstein-Uhlenbeck", "matern": "Matern 3/2"}
MOSTLY = 0.5, 2.0  # of the variance of an input's steps from row to row: between these its noise is what they are
FELT = 0.1  # of that noise's variance, that the machine's motion tells of: less does not move the parameters
NORMAL = 0.6745  # median of the absolute values of a standard normal


def noise_notes(problem: Problem, estimates: Mapping[str, pd.DataFrame]) -> list[str]:
    """A sentence for every measured input that is hardly more than noise from row to row, where the machine would feel that.

    V supposes that an input acts as recorded but for an error of its own at every row, independent of what is recorded. One that moves less
    from row to row than its sensor's noise does not, and the likelihood of these errors then takes the inertia for what the machine did not
    feel of them, by any number of deviations (errors in variables: Soderstrom, Automatica 43, 2007).
    """
    found = []
    for name, std in noisy_inputs(problem).items():
        steps = np.concatenate([np.diff(r.inputs[name]) for r in problem.fitted])
        size = float(np.median(np.abs(steps[steps != 0]))) / NORMAL if np.any(steps) else np.inf
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
