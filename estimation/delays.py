"""Delays of sensors, or of all inputs, that are estimated with everything else.

An output whose delay is asked for has it as a parameter of the model (`models/augmentation/delay.py`), expanded about a time d_0 by which
the samples were moved back (`recordings/delay.py`). After a solve d_0 is moved to the estimate, by whole intervals of the recording sampled
most quickly, so that rows stay rows where time stamps are even; what is left is less than an interval, and its derivatives make the
estimate exact enough, with a deviation. Inputs that act late are outputs that all lag: everything is then told on the inputs' clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from backsight.models import Dae
from backsight.models.augmentation.delay import INPUTS, delay_name, delayed, late_inputs, with_samples_moved

from .recordings.delay import moved
from .recordings.gaps import usual_interval
from .recordings.recording import Recording

if TYPE_CHECKING:
    from .problem import Problem
    from .results import Smoothing

PASSES = 8
FARTHEST = 0.5  # of the shortest recording: a longer delay would cost more samples than it leaves
BEYOND = 0.6  # of that interval: an estimate further from d_0 moves it; more than a half, so that none goes to and fro


def asked_for(recordings: Sequence[Recording]) -> list[str]:
    """The outputs whose delay is to be estimated, or INPUTS, in the order of the recordings."""
    return list(dict.fromkeys(name for r in recordings for name in r.open_delays))


def with_delays(dae: Dae, recordings: Sequence[Recording]) -> tuple[Dae, list[Recording]]:
    """The model with the delays that the recordings ask for, and the recordings without the question."""
    for name in asked_for(recordings):
        dae = late_inputs(dae) if name == INPUTS else delayed(dae, name)
    return dae, [replace(r, open_delays=()) for r in recordings]


def settled(problem: Problem, smooth: Callable[[Problem], Smoothing]) -> tuple[Problem, Smoothing]:
    """The problem as posed in the end, the samples of delayed outputs moved to about where their delays are expanded, and smoothed."""
    asked, moves = problem, dict[str, float]()
    result = smooth(problem)
    for _ in range(PASSES):
        steps = _steps(problem, result, moves) if _arrived(result) else {}
        if not steps:
            break
        moves = {name: moves.get(name, 0.0) + steps.get(name, 0.0) for name in {**moves, **steps}}
        problem = _moved(asked, result, moves)
        result = smooth(problem)
    notes = [
        f"The samples of {'all outputs' if name == INPUTS else name} were moved back by {by:.6g} s, near the delay that was estimated."
        for name, by in moves.items()
        if by != 0.0
    ]
    return problem, replace(result, notes=(*result.notes, *notes)) if notes else result


def _arrived(result: Smoothing) -> bool:
    """Whether the solver did: that it is no minimum may be for a delay that is expanded too far from where it is."""
    return result.solver.converged or (result.solution is not None and result.solution.solved.status.converged)


def _steps(problem: Problem, result: Smoothing, moves: Mapping[str, float]) -> dict[str, float]:
    """Delayed output, or INPUTS -> seconds in whole sampling intervals by which its samples should be moved further."""
    interval, found = min(usual_interval(r) for r in problem.fitted), {}
    farthest = FARTHEST * min(float(r.time[-1] - r.time[0]) for r in problem.recordings)
    for name in (INPUTS, *(q.name for q in problem.dae.outputs)):
        p = result.parameters.get(delay_name(name))
        rest = p.value - moves.get(name, 0.0) if p is not None and not p.fixed else 0.0
        if abs(rest) > BEYOND * interval and p is not None and abs(p.value) < farthest:
            found[name] = float(np.round(rest / interval) * interval)
    return found


def _moved(asked: Problem, result: Smoothing, moves: Mapping[str, float]) -> Problem:
    """The problem as asked, with the samples of these outputs, or of all for the INPUTS, moved back."""
    from .problem import Free

    dae, parameters = asked.dae, dict(asked.parameters)
    for name, by in moves.items():
        dae = with_samples_moved(dae, name, by)
        free = parameters[delay_name(name)]
        if isinstance(free, Free) and free.std is None:  # where a prior says what the guess means, it stays
            parameters[delay_name(name)] = replace(free, guess=result.parameters[delay_name(name)].value)
    recordings = [
        replace(moved(r, {name: moves.get(name, 0.0) + moves.get(INPUTS, 0.0) for name in r.outputs}), advanced=dict(moves))
        for r in asked.recordings
    ]
    return replace(asked, model=dae, parameters=parameters, recordings=recordings)
