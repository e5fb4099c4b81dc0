"""Delays that are to be estimated: a search for what is left out has them among what it looks for, and begins without them.

Beside a model that lacks something they come out wrong, and hide a part of it. One that is given stays: its samples are moved back.
"""

from __future__ import annotations

from dataclasses import replace

from backsight.models import Model
from backsight.models.augmentation.delay import INPUTS, delay_name

from ...problem import Free, Problem
from ...recordings.delay import moved
from ...smoothing.delays import delays_of
from ...wording import listed


def without_delays(problem: Problem) -> tuple[Problem, str | None]:
    """The problem of the model as it was declared, and a note where it had delays to be estimated; itself where it has none."""
    if not isinstance(problem.declared, Model):
        return problem, None
    delays = delays_of(problem)
    given = {name: float(d) for name, d in delays.items() if not isinstance(d, Free)}
    sought = ["the inputs" if name == INPUTS else name for name in delays if name not in given]
    recordings = [moved(r, {o: given.get(o, 0.0) + given.get(INPUTS, 0.0) for o in r.outputs}) for r in problem.recordings]
    parameters = {name: value for name, value in problem.parameters.items() if name not in {delay_name(of) for of in delays}}
    said = f"The delay of {listed(sought)} was not estimated beforehand: delays are among what was looked for." if sought else None
    return replace(problem, model=problem.declared, recordings=recordings, parameters=parameters), said
