"""Effects that were found before others and are nothing beside these: a spring that hardens, which was play.

One that the fit itself says is idle (`choice.idle`) is taken out of the model: all others are put anew into the model that there was at
first, and its parameters are free again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backsight.models import Model
from backsight.models.errors import ModelError

from ...problem import Free, Problem
from ...results import Smoothing
from ..candidates.candidate import Candidate
from ..evidence.offsets import PREFIX
from .choice import shapes_without_effect, without_effect
from .refit import posed

TWINS = 0.95  # correlation of strengths of two effects from which on one of them may be all that there is


@dataclass(frozen=True, kw_only=True)
class Bare:
    """The problem and its model before anything was found."""

    problem: Problem
    model: Model

    def having(self, candidates: Sequence[Candidate], now: Problem, result: Smoothing) -> tuple[Problem, Model] | None:
        """With these, their parameters as in a result; recordings and offsets of the problem `now`.

        None where one needs what is not there. What one of them brings stays where the result has it; no others' parameters are in the
        problem. One that stands on another one comes after it.
        """
        values = {p.name: p.value for p in result.parameters.values()}
        kept = {name: given for name, given in now.parameters.items() if name.startswith(PREFIX)}
        problem, model = replace(self.problem, recordings=now.recordings, parameters={**self.problem.parameters, **kept}), self.model
        waiting = list(candidates)
        while waiting:
            later = list[Candidate]()
            for c in waiting:
                try:
                    problem, model = posed(problem, model, c, _own(c, values))
                except (ModelError, KeyError):  # a parameter of what is not there
                    later.append(c)
                    continue
                own = {name: now.parameters[name] for name in (*c.later, *c.rounded) if name in now.parameters}
                problem = replace(problem, parameters={**problem.parameters, **own})
            if len(later) == len(waiting):
                return None
            waiting = later
        return problem, model


def alone(c: Candidate, others: Sequence[Candidate], problem: Problem, result: Smoothing) -> tuple[int, dict[str, Free]] | None:
    """Which of others a candidate goes with so closely that it may be all there is, and where their strengths begin without that one.

    There they are most probable with its strengths at nothing, of a normal distribution. None where there is no such other one.
    """
    told = {name: free for name in result.correlation.index if isinstance(free := problem.parameters.get(name), Free)}
    nothing = shapes_without_effect(c) if c.all_shape else without_effect(c)
    ends = {name: end for name, end in nothing.items() if name in told and np.isfinite(end)}
    of = {name: k for k, other in enumerate(others) for name in other.strengths or other.named.values() if name in told}
    if not ends or not of:
        return None
    R = result.correlation.loc[[*ends, *of], [*ends, *of]].to_numpy(float)
    n, together = len(ends), np.nan_to_num(np.abs(R[: len(ends), len(ends) :]).max(axis=0))
    if not together.max() > TWINS:
        return None
    away = np.array([(end - result.parameters[name].value) / (result.parameters[name].std or np.inf) for name, end in ends.items()])
    step = R[n:, :n] @ np.linalg.pinv(R[:n, :n]) @ away
    begin = {}
    for name, deviations in zip(of, step.tolist(), strict=True):
        p, free = result.parameters[name], told[name]
        begin[name] = replace(free, guess=float(np.clip(p.value + deviations * (p.std or 0.0), free.min, free.max)))
    return list(of.values())[int(together.argmax())], begin


def _own(c: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    return {name: values[name] for name in (*c.strengths, *c.start) if name in values}
