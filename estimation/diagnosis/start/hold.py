"""Inputs that run straight from row to row where a study takes them for held: half a row early, in effect, at every frequency.

A recorder that reads a smooth input leaves rows of which nobody can say what was between them; held is what a study says by leaving it out.
One score asks what the difference would gain, and where that is clear both are smoothed: the evidence decides, before anything is looked
for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from backsight.models import Model

from ...problem import Problem
from ...results import Smoothing
from ..candidates.candidate import Candidate, Signal
from ..scores.score import Linearised
from ..scores.supermodel import looked_at
from ..search.choice import CLEAR
from ..search.refit import worth_of
from .as_it_is import AsItIs

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def straight(_: Array, values: Array) -> Array:
    """Means over the rows of what runs straight from one to the next; (n,)."""
    return np.asarray((values + np.append(values[1:], values[-1])) / 2)


def promised(problem: Problem, model: Model, first: Smoothing) -> float:
    """Nats that a smoothing with straight inputs would gain, by the score of one with held inputs; 0 where they are not held."""
    if first.solution is None or not model.inputs or any(r.hold != "zero" or r.open_hold for r in problem.recordings):
        return 0.0
    places = tuple(f"input:{name}" for name in model.inputs)
    candidate = Candidate(place=places[0], family="actuator", physics="hold", signals=(Signal(of=places, changed=straight),))
    base = Linearised(first.solution)
    (look,) = looked_at(problem, model, base, [candidate])
    scores = base.scores(look.columns)
    return float(-scores.b[0] - scores.G[0, 0] / 2)


def with_better_hold(problem: Problem, model: Model, first: AsItIs, smoothed: Callable[[Problem], AsItIs]) -> tuple[AsItIs, str]:
    """The model as it is with its inputs held or straight, and what there is to say. problem: as `smoothed` had it for the first."""
    if promised(first.problem, model, first.result) < CLEAR:
        return first, ""
    second = smoothed(replace(problem, recordings=[replace(r, hold="linear") for r in problem.recordings]))
    at_rest = [one.result.solver.converged for one in (first, second)]
    if at_rest == [True, True]:
        if first.settings.weigh is not second.settings.weigh:
            return first, ""  # of one the weights are held: their evidences are of different things
        now, then = (worth_of(one.problem, one.result, weighed=one.settings.weigh) for one in (first, second))
        if not (more := then.over(now)) > CLEAR:
            return first, ""
        gained = f"{more:.3g} nats more"
    elif at_rest == [False, True]:
        gained = "held ones do not come to rest"
    else:
        return first, ""
    return second, f"Inputs were taken to run straight from row to row, not to be held: {gained}. Say hold = 'linear' if that is so."
