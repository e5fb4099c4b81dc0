"""Inertias that came out far larger than anybody guessed, since the model lacks a force.

Where a controller holds the motion, inputs answer what the model lacks, and the motion is smooth all the same: for white residual forces a
larger inertia explains that better than any force does, the larger the better. Scores beside such a model tell nothing, and fits that begin
there end there, or at nothing where numbers give out. With the inertia near its guess what is missing is seen.

Noise in the equation of a motion makes an inertia too large as noise in a regressor makes a slope too small: m a = F + r, of which m is
the inverse slope of a over F, comes out as m0 / (1 - s^2), s = rms r / rms m a. A guess that is merely poor leaves no such force: an
inertia with s^2 < 1/2 is no more than twice too large, and is what it is, if the recordings tell it at all: beside a weight that swings
slowly they may not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

import casadi as ca

from backsight.ocp import Solution

from ...problem import Free, Problem
from ...results import Smoothing
from ...smoothing.begun import in_the_middles
from ...supposed import noisy_inputs
from ...wording import listed

FAR = 2.0  # times its guess
MOST = 0.5  # s^2
NEAR = 1.01  # times a bound: one that would be beyond
INERTIAS = ("kg", "kg.m2")
NOTE = (
    "With nothing put right {said}. While what is missing was looked for each was taken to be between half its guess and twice that. "
    "Where its input only answers what the model lacks, under a stiff controller, give every input the noise of its measurement, V, and "
    "residual forces next to none, W, in [weights]."
)


def with_inertias_bounded(problem: Problem, result: Smoothing) -> tuple[Problem, str]:
    """The problem with such inertias of a result of it bounded, and a note on it; the problem itself and no note where there are none.

    Nor where an input has noise of its own: it may answer what it will then.
    """
    bounded, said, solution = dict[str, Free](), list[str](), result.solution
    if noisy_inputs(problem) or solution is None:
        return problem, ""
    for name, given in problem.parameters.items():
        p = result.parameters.get(name)
        if p is None or p.unit not in INERTIAS or not isinstance(given, Free) or given.drift is not None or not given.guess > 0:
            continue
        low, high = max(given.min, given.guess / FAR), min(given.max, given.guess * FAR)
        far, lost = not low <= p.value <= high, p.identifiable is False
        if not ((far and lost) or ((far or lost) and _left(solution, result, name) ** 2 > MOST)):
            continue
        bounded[name], times = replace(given, min=low, max=high), p.value / given.guess
        said.append(f"{name} would be {p}, {times:.2g} times its guess")
    if not said:
        return problem, ""
    return replace(problem, parameters={**problem.parameters, **bounded}), NOTE.format(said=listed(said))


def _left(solution: Solution, result: Smoothing, inertia: str) -> float:
    """s at the place where it is least: what is left over there over what an inertia makes of the motion, both rms; inf at no place."""
    t = solution.transcription
    p = t.dae.p[[q.name for q in t.dae.parameters].index(inertia)]
    left = {k: result.residual_places[name].rms for k in t.soft if (name := t.dae.places[k].name) in result.residual_places}
    F = t.dae.undisturbed(t.dae.residual[t.dae.balances_of([*left])])
    moved = in_the_middles(solution, ca.densify(ca.jacobian(F, p) * p)).std(axis=1)
    return min((r / m for r, m in zip(left.values(), moved.tolist(), strict=True) if m > 0), default=inf)


@dataclass(frozen=True)
class Bounded:
    """Inertias that were bounded, as the study has them."""

    own: Mapping[str, Free] = field(default_factory=dict)

    @classmethod
    def between(cls, study: Problem, problem: Problem) -> Bounded:
        """Those that a study has otherwise than a problem of it."""
        told = ((name, given) for name, given in study.parameters.items() if isinstance(given, Free))
        return cls({name: given for name, given in told if problem.parameters.get(name) != given})

    def pressing(self, problem: Problem, result: Smoothing) -> list[str]:
        """Those that would be beyond bounds that they have only so."""
        names = list[str]()
        for name, own in self.own.items():
            now, p = problem.parameters.get(name), result.parameters.get(name)
            if p is None or not isinstance(now, Free):
                continue
            if (own.max > now.max < p.value * NEAR) or (own.min < now.min > p.value / NEAR):
                names.append(name)
        return names

    def freed(self, problem: Problem, names: Sequence[str]) -> Problem:
        """The problem with what the study has of these."""
        return replace(problem, parameters={**problem.parameters, **{name: self.own[name] for name in names}})

    def sound(self, problem: Problem, result: Smoothing) -> bool:
        """Whether a result of a problem has none that would be bounded."""
        asked = self.freed(problem, list(self.own))
        return with_inertias_bounded(asked, result)[0] is asked
