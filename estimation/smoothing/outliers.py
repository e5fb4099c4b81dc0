"""What Huber's loss made of the samples, in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backsight.ocp import Solution

from ..problem import Problem
from ..wording import number
from .robust import CORNER, FAR, RobustSolution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NAMED = 3  # of the farthest samples


def outlier_notes(problem: Problem, solution: Solution) -> list[str]:
    """For every output whose loss is not the square a sentence: how many samples lie far off, and which the farthest."""
    found = []
    for i, q in enumerate(problem.dae.outputs):
        asked = {r.output_loss.get(q.name, "square") for r in problem.fitted} - {"square"}
        if not asked:
            continue
        if not (isinstance(solution, RobustSolution) and solution.huber[i].any()):
            found.append(f"Loss of {q.name}: squares, for the tails of its residuals are no heavier than Gaussian ones.")
            continue
        counted = solution.huber[i] & (solution.values.scale[solution.term("samples")][i] > 0)
        z = np.where(counted, np.abs(solution.standardised[i]), 0.0)
        far = np.flatnonzero(solution.far[i] & counted)
        worst = far[np.argsort(-z[far], kind="stable")[:NAMED]]
        rule = "as given" if "huber" in asked else "from the tails of its residuals"
        open_end = "" if solution.settled else " Their weights had not settled."
        apart = " The tests of the prediction errors leave them out."
        if not len(far):
            found.append(f"Loss of {q.name}: huber, {rule}; no sample lies beyond {FAR:g} std.{open_end}")
            continue
        found.append(
            f"Loss of {q.name}: huber, {rule}. {len(far)} of {np.count_nonzero(counted)} samples lie beyond {FAR:g} std and pull no more "
            f"than one at {CORNER:g} std would: the farthest are {_places(problem, worst, z)}.{apart}{open_end}"
        )
    return found


def _places(problem: Problem, samples: NDArray[np.int64], z: Array) -> str:
    """Times and distances of some of all samples."""
    ends = np.cumsum([len(r.time) for r in problem.fitted])
    several = len({r.name for r in problem.fitted}) > 1
    parts = []
    for k in samples.tolist():
        owner = int(np.searchsorted(ends, k, side="right"))
        recording = problem.fitted[owner]
        time = recording.time[k - (ends[owner] - len(recording.time))]
        parts.append(f"t = {time:.9g} s{' of ' + recording.name if several else ''} ({number(float(f'{z[k]:.3g}'))} std)")
    return ", ".join(parts)
