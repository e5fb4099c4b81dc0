"""Noise of outputs as their samples show it, where a model would have far more, and where a study says far less.

What a model does not explain becomes noise in the one case, and noise becomes what the model lacks in the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import comb

from backsight.models.augmentation.parameters import case_name

from ...problem import Problem
from ...recordings.noise import noise, robust_std
from ...recordings.outliers import screened
from ...recordings.recording import Recording
from ...results import Smoothing
from ...smoothing.agreement import SHARPER
from ...smoothing.begun import Begun
from ...smoothing.horizons import output_stds, rough, shown_noise
from ...wording import listed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ORDER = 4  # of differences
LAGS = 5  # rows of the inputs that an output may follow at once
FEWEST = 5  # differences for each of their numbers
FAR = 5.0  # times the white noise that differences of its samples show: with less a sensor may have noise of its own that is not white
NOTE = (
    "The model as it is explains so little that with V from the data {said}. Whatever is missing would pass for noise there: V is held at "
    "what differences of the samples show. Give V where the sensor has as much noise."
)
LOUDER = (
    "{said}, by how these alternate. What is more than the study allows would pass for what the model lacks: the noise of the samples was "
    "taken. Give it, or leave the std out."
)


def with_noise_at_least(problem: Problem) -> tuple[Problem, str]:
    """The problem with the white noise that samples show where the std of their output is less than half of that, and a note on it.

    Beside what the last few rows of the inputs do to it: a current follows a rough voltage within a row. In recordings that are held out,
    too; not of outputs that read forces at once, nor where [weights] tell V.
    """
    skipped, said, recordings = rough(problem), dict[str, str](), list[Recording]()
    units = {q.name: q.unit for q in problem.dae.outputs}
    for r in problem.recordings:
        whole, stds = screened(r), dict(r.output_std)
        for name, std in r.output_std.items():
            if std is None or name in skipped or r.drive is not None or {name, case_name(name, r.name)} & {*problem.weights.V}:
                continue
            shown = noise(whole.time, whole.outputs[name]).white
            shown = min(shown, _beside(whole.outputs[name], whole.inputs)) if shown > SHARPER * std else 0.0
            if shown > SHARPER * std:
                stds[name] = shown
                said.setdefault(name, f"{name} has std {std:.3g} {units[name]} in the study and {shown:.2g} {units[name]} in its samples")
        recordings.append(replace(r, output_std=stds))
    return (replace(problem, recordings=recordings), LOUDER.format(said=listed([*said.values()]))) if said else (problem, "")


def _beside(y: Array, inputs: Mapping[str, Array]) -> float:
    """White noise in samples (n,) by their differences of order ORDER, less what those of the inputs at the last LAGS rows explain.

    inf where there are too few.
    """
    d = np.diff(y, ORDER) / np.sqrt(comb(2 * ORDER, ORDER))
    moves = [np.concatenate([np.full(lag, np.nan), np.diff(u, ORDER)[: len(d) - lag]]) for u in inputs.values() for lag in range(LAGS)]
    X = np.array(moves).reshape(-1, len(d)).T
    told = np.isfinite(d) & np.isfinite(X).all(axis=1)
    if np.count_nonzero(told) < FEWEST * (X.shape[1] + 1):
        return np.inf
    return robust_std(d[told] - X[told] @ np.linalg.lstsq(X[told], d[told], rcond=None)[0])


def with_noise_as_shown(problem: Problem, result: Smoothing) -> tuple[Problem, str]:
    """The problem with such outputs' V held in every recording, and a note on it; the problem itself and no note where there are none."""
    if result.solution is None:
        return problem, ""
    (_, white), found, (_, choosable) = shown_noise(problem), Begun.at(result.solution).noise, output_stds(problem)
    V, said = dict[str, float](), list[str]()
    for i, q in enumerate(problem.dae.outputs):
        there = [h for h, table in enumerate(found) if q.name in table]
        if not there or not all(q.name in choosable[h] and white[h, i] > 0 for h in there):
            continue
        times, least = min((found[h][q.name] / white[h, i], float(white[h, i])) for h in there)
        if times > FAR:
            V |= {case_name(q.name, problem.fitted[h].name): float(white[h, i]) for h in there}
            said.append(f"{q.name} has {times:.2g} times the noise of {least:.2g} {q.unit}")
    if not said:
        return problem, ""
    return replace(problem, weights=replace(problem.weights, V={**problem.weights.V, **V})), NOTE.format(said=listed(said))
