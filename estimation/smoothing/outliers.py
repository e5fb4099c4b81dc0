"""What the losses made of outlying samples, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backsight.ocp import Solution

from ..problem import Problem
from ..recordings.outliers import Mask, outlying
from ..recordings.recording import Recording
from ..wording import number
from .agreement import MISLEAD
from .robust import CORNER, FAR, RobustSolution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NAMED = 3  # of the farthest samples
FOLLOWED = 1.0  # deviations: where outliers are met as well as any sample is
UNEXPECTED = 8.0  # deviations of a prediction error that no motion of the model leads to
FEW, TOGETHER = 3, 2.5  # so many samples, half of which are so many deviations off, that chance is one in 10^4


def outlier_notes(problem: Problem, solution: Solution, errors: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """For every output whose loss is not the square a sentence: how many samples lie far off, and which the farthest.

    For others where gross outliers are squared. errors: recording -> output -> standardised prediction errors (n,).
    """
    found = []
    for i, q in enumerate(problem.dae.outputs):
        asked = {r.output_loss.get(q.name, "square") for r in problem.fitted} - {"square"}
        if not asked:
            found += _taken_as_they_are(problem, q.name, errors)
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
        if float(np.median(z[far])) < FOLLOWED:
            found.append(
                f"Loss of {q.name}: huber, {rule}. {len(far)} of {np.count_nonzero(counted)} samples stand off "
                f"({_times(problem, worst)}), and residual forces bend the trajectory to them: W leaves it the room. {MISLEAD} "
                f"Give a smaller W of what moves {q.name}, or leave these samples empty.{open_end}"
            )
            continue
        found.append(
            f"Loss of {q.name}: huber, {rule}. {len(far)} of {np.count_nonzero(counted)} samples lie beyond {FAR:g} std and pull no more "
            f"than one at {CORNER:g} std would: the farthest are {_places(problem, worst, z)}.{apart}{open_end}"
        )
    return found


def _taken_as_they_are(problem: Problem, output: str, errors: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """A note where samples of an output stand far off their neighbours, the model does not expect them, and they are squared."""
    done, parts = dict[str, int](), list[Mask]()
    for r in problem.fitted:
        first = done.get(r.name, 0)
        done[r.name] = first + len(r.time)
        told = errors.get(r.name, {}).get(output, np.empty(0))[first : first + len(r.time)]
        parts.append(_unexpected(_outlying(r, output), told))
    off = np.concatenate(parts)
    if not off.any():
        return []
    count, where = int(off.sum()), _times(problem, np.flatnonzero(off)[:NAMED])
    who = (
        f"{count} samples stand far off their neighbours ({where})" if count > 1 else f"one sample stands far off its neighbours ({where})"
    )
    return [f'{output}: {who}: residual forces and parameters follow what the square makes of that. Give the output loss = "auto".']


def _unexpected(off: Mask, told: Array) -> Mask:
    """Of samples that stand off their neighbours those that the model does not expect, by its prediction errors if there are any.

    One by one where they are far off; all, where most of a few are off: forces that follow them make every single one look likelier.
    """
    if len(told) != len(off):
        return off
    size = np.abs(told)
    few = size[off & np.isfinite(size)]
    together = len(few) >= FEW and float(np.median(few)) > TOGETHER
    return off if together else off & (size > UNEXPECTED)


def _outlying(recording: Recording, output: str) -> Mask:
    y = recording.outputs.get(output)
    return np.zeros(len(recording.time), dtype=bool) if y is None else outlying(recording.time, y)


def _places(problem: Problem, samples: NDArray[np.int64], z: Array) -> str:
    """Times and distances of some of all samples."""
    return _times(problem, samples, [f" ({number(float(f'{z[k]:.3g}'))} std)" for k in samples.tolist()])


def _times(problem: Problem, samples: NDArray[np.int64], more: Sequence[str] = ()) -> str:
    """Times of some of all samples, as they were recorded, with more to say of each."""
    ends = np.cumsum([len(r.time) for r in problem.fitted])
    several = len({r.name for r in problem.fitted}) > 1
    parts = []
    for k, said in zip(samples.tolist(), more or [""] * len(samples), strict=True):
        owner = int(np.searchsorted(ends, k, side="right"))
        recording = problem.fitted[owner]
        time = recording.time[k - (ends[owner] - len(recording.time))]
        parts.append(f"t = {time:.9g} s{' of ' + recording.name if several else ''}{said}")
    return ", ".join(parts)
