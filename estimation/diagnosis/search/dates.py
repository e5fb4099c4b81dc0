"""When what was found sets in, and ends: sought anew beside a fit that has it, where a score that lacks it misses that."""

from __future__ import annotations

from backsight.models import Model

from ...problem import Problem
from ...results import Smoothing
from ..candidates.candidate import Candidate
from ..candidates.changing import changing
from ..candidates.library import library
from ..scores.onsets import moved
from ..scores.score import Linearised
from ..scores.supermodel import looked_at
from .choice import CLEAR
from .findings import fitted_strengths


def redated(problem: Problem, model: Model, result: Smoothing, c: Candidate) -> Candidate | None:
    """A candidate that the model has, from and until when it would be plainly better; None where that is when it is."""
    if c.onset is None or result.solution is None:
        return None
    if c.changes:
        again = [d for d in changing(problem, model, result.solution) if d.strengths == c.subject]
    else:
        again = [d for d in library(problem, model, result.solution, brought=set(c.brought)) if d.key == c.key]
    there = Linearised(result.solution)
    strengths = fitted_strengths(c, result)
    looks = [look for look in looked_at(problem, model, there, again) if len(look.columns) == len(strengths)]
    if not looks:
        return None
    span, gained = moved(there, looks[0], strengths, (c.onset, c.until))
    return c.dated(*span) if gained >= CLEAR else None
