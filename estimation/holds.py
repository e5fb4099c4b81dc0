"""How inputs act between their samples, where nobody knows: held or straight, as the recordings say by the evidence of two solves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from .problem import Problem
    from .recordings.recording import Recording
    from .results import Smoothing

HOLDS: tuple[Literal["zero", "linear"], ...] = ("zero", "linear")
CLEAR = 3.0  # of log evidence: odds of twenty


def with_better_hold(
    problem: Problem, settled: Callable[[Problem], tuple[Problem, Smoothing]], smooth: Callable[[Problem], Smoothing]
) -> tuple[Problem, Smoothing]:
    """The problem smoothed with the inputs of those recordings that leave it open held, then straight; the one of more evidence.

    settled: smooths a problem and returns it as it is posed in the end, with delays that are about right; smooth: as it is posed.
    A delay that was estimated costs the samples that it moves beyond the start, with either hold others: both are judged by those that
    both have. Held where the evidence of one of them is not determined.
    """
    names = [r.name for r in problem.recordings if r.open_hold]
    if not names:
        return settled(problem)
    (problem, held), (other_problem, straight) = (settled(_with_hold(problem, hold)) for hold in HOLDS)
    one, other = _judged(problem, held, other_problem, smooth), _judged(other_problem, straight, problem, smooth)
    if one is None or other is None:
        chosen = straight if straight.solver.converged and not held.solver.converged else held
        told = "its evidence could not be compared with that of the other"
    else:
        chosen = straight if other > one else held
        told = f"more by {abs(other - one):.3g} in log evidence than the other" + (
            "" if abs(other - one) > CLEAR else ", hardly a difference"
        )
    how = "straight from sample to sample" if chosen is straight else "held from sample to sample"
    notes = (*chosen.notes, f"Inputs of {', '.join(names)} were taken as {how}: {told}.")
    return other_problem if chosen is straight else problem, replace(chosen, notes=notes)


def _with_hold(problem: Problem, hold: Literal["zero", "linear"]) -> Problem:
    recordings = [replace(r, hold=hold, open_hold=False) if r.open_hold else r for r in problem.recordings]
    return replace(problem, recordings=recordings)


def _judged(problem: Problem, result: Smoothing, other: Problem, smooth: Callable[[Problem], Smoothing]) -> float | None:
    """The evidence by the samples that another problem on the same recordings has too."""
    pairs = list(zip(problem.recordings, other.recordings, strict=True))
    common = [_without_first(recording, sibling) for recording, sibling in pairs]
    if all(new is recording for new, (recording, _) in zip(common, pairs, strict=True)):
        return _evidence(result)
    return _evidence(smooth(replace(problem, recordings=common)))


def _without_first(recording: Recording, sibling: Recording) -> Recording:
    """The recording without as many first samples of every output as its sibling, the same with other delays taken out, lacks."""
    outputs = dict(recording.outputs)
    for name, y in recording.outputs.items():
        there = np.flatnonzero(np.isfinite(y))
        surplus = len(there) - int(np.isfinite(sibling.outputs[name]).sum())
        if surplus > 0:
            outputs[name] = y.copy()
            outputs[name][there[:surplus]] = np.nan
    same = all(outputs[name] is y for name, y in recording.outputs.items())
    return recording if same else replace(recording, outputs=outputs)


def _evidence(result: Smoothing) -> float | None:
    return result.criteria.log_evidence if result.solver.converged and result.criteria is not None else None
