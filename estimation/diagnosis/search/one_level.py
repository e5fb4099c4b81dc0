"""Friction of one level where a constant force was found after friction of two, one for each way.

While a body slides a constant force on it is the half difference of such levels, and only at rest, where a rounded sign creeps, are the two
anything else. What took both levels for itself first keeps a part of a constant that is found later.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from backsight.models import Model

from ...problem import Free, Problem
from ...results import Smoothing
from ..answer.verdict import EVERYWHERE
from ..candidates.candidate import Candidate
from ..candidates.library import library
from ..scores.shares import Sizes
from .elimination import Bare
from .findings import explained, renewed
from .refit import settled
from .standing import Standing

LEVELS = (("f_plus", "f_minus"), ("tau_plus", "tau_minus"))
CONSTANT = ("input_offset", "constant_force")
PLAIN = "coulomb_friction"


@dataclass(frozen=True, kw_only=True)
class OneLevel:
    """The same model with friction of one level: its problem, at the mean of the two. number: of what was accepted, instead of which."""

    number: int
    candidate: Candidate
    problem: Problem
    model: Model

    @classmethod
    def of(cls, standing: Standing, bare: Bare, first: Smoothing) -> OneLevel | None:
        """None where a constant was not what was found last, or no friction of two levels before. first: of the bare model."""
        if not standing.accepted or standing.accepted[-1].physics not in CONSTANT or first.solution is None:
            return None
        *before, last = standing.accepted
        for number, old in enumerate(before):
            names = next(([old.named[word] for word in pair] for pair in LEVELS if {*pair} <= old.named.keys()), None)
            if names is None:
                continue
            there = library(bare.problem, bare.model, first.solution)
            plain = next((c for c in there if c.key == (old.place, PLAIN)), None)
            if plain is None:
                continue
            posed = bare.having((*before[:number], plain, *before[number + 1 :], last), standing.problem, standing.result)
            if posed is None:
                continue
            problem, (strength,) = settled(posed[0], standing.result), plain.strengths
            free, level = problem.parameters[strength], sum(standing.result.parameters[name].value for name in names) / len(names)
            if isinstance(free, Free):
                problem = replace(problem, parameters={**problem.parameters, strength: replace(free, guess=max(level, free.min))})
            return cls(number=number, candidate=plain, problem=problem, model=posed[1])
        return None

    def instead(self, standing: Standing, result: Smoothing, sizes: Sizes) -> Standing:
        """What was found, with it."""
        k, c, named = self.number, self.candidate, standing.named
        new = renewed(replace(named[k], explanation=explained(c, result), regime=EVERYWHERE), c, result, sizes)
        return replace(
            standing.at(self.problem, result, self.model),
            findings=tuple(new if finding is named[k] else finding for finding in standing.findings),
            accepted=(*standing.accepted[:k], c, *standing.accepted[k + 1 :]),
        )
