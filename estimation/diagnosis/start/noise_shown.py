"""Noise of outputs as their samples show it, where a model would have far more: what it does not explain has become noise there."""

from __future__ import annotations

from dataclasses import replace

from backsight.models.augmentation.parameters import case_name

from ...problem import Problem
from ...results import Smoothing
from ...smoothing.begun import Begun
from ...smoothing.horizons import output_stds, shown_noise
from ...wording import listed

FAR = 5.0  # times the white noise that differences of its samples show: with less a sensor may have noise of its own that is not white
NOTE = (
    "The model as it is explains so little that with V from the data {said}. Whatever is missing would pass for noise there: V is held at "
    "what differences of the samples show. Give V where the sensor has as much noise."
)


def with_noise_as_shown(problem: Problem, result: Smoothing) -> tuple[Problem, str]:
    """The problem with such outputs' V held in every recording, and a note on it; the problem itself and no note where there are none."""
    if result.solution is None:
        return problem, ""
    (_, white), noise, (_, choosable) = shown_noise(problem), Begun.at(result.solution).noise, output_stds(problem)
    V, said = dict[str, float](), list[str]()
    for i, q in enumerate(problem.dae.outputs):
        there = [h for h, table in enumerate(noise) if q.name in table]
        if not there or not all(q.name in choosable[h] and white[h, i] > 0 for h in there):
            continue
        times, least = min((noise[h][q.name] / white[h, i], float(white[h, i])) for h in there)
        if times > FAR:
            V |= {case_name(q.name, problem.fitted[h].name): float(white[h, i]) for h in there}
            said.append(f"{q.name} has {times:.2g} times the noise of {least:.2g} {q.unit}")
    if not said:
        return problem, ""
    return replace(problem, weights=replace(problem.weights, V={**problem.weights.V, **V})), NOTE.format(said=listed(said))
