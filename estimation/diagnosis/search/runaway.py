"""Inertias that come out far from what anybody guessed, since the model lacks a force.

Where a controller holds the motion, inputs answer what the model lacks, and the motion is smooth all the same: for white residual forces a
larger inertia explains that better than any force does, the larger the better. Scores beside such a model tell nothing, and fits that begin
there end there, or at nothing where numbers give out. So it is looked at with these inertias near their guesses: scores are those beside
that model, and fits begin there. What is likely is fitted with the inertias as free as the study has them, and held against the model that
is as free. So it is where a model comes to no rest at all since one grows without end: a joint without its friction, which hardly moves.
Where every one of these fits has one that runs away, for more than that is missing, models are compared with them near their
guesses, until something is found beside which they stay where they are when they are free.

Noise in the equation of a motion makes an inertia too large as noise in a regressor makes a slope too small: M a = F + r, of which the
inertia M of all that moves there is the inverse slope of a over F, comes out as M0 / (1 - s^2), s = rms r / rms M a. A part of it that is
free beside known ones, J, has all of the excess, s^2 M. A guess that is merely poor leaves no such force: with s^2 M < J / 2 an inertia is
no more than twice too large, and is what it is, if the recordings tell it at all: beside a weight that swings slowly they may not. One
that is not told since residual forces do what it should may be anywhere, wherever it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf

import casadi as ca
import numpy as np

from backsight.ocp import Solution

from ...problem import Free, Problem
from ...results import Smoothing
from ...smoothing.begun import in_the_middles
from ...supposed import noisy_inputs
from ...wording import listed
from ..scores.shares import left_over

FAR = 2.0  # times its guess, or a part of it
WILD = 100.0  # times its guess: no machine that somebody guessed has so much
MOST, ALL = 0.5, 0.5  # of an inertia: its excess; of the forces: left over
INERTIAS = ("kg", "kg.m2")
NOTE = (
    "With nothing put right {said}. What is missing was looked for with no less than half and no more than twice {of}, and fitted with "
    "what the study has. A better guess makes that surer."
)


@dataclass(frozen=True)
class Near(Free):
    """An inertia near its guess. given: what the study has of it."""

    given: Free | None = None


def with_inertias_near(problem: Problem, result: Smoothing, guesses: Mapping[str, Free | float] | None = None) -> tuple[Problem, str]:
    """The problem with such inertias of a result of it near their guesses, and a note; the problem itself and none where there are none.

    Nor where an input has noise of its own: it may answer what it will then. guesses: of the study, where the problem has moved on.
    """
    near, said, solution = dict[str, Near](), list[str](), result.solution
    if noisy_inputs(problem) or solution is None:
        return problem, ""
    told = {name: p for name in _inertias(problem) if (p := result.parameters.get(name)) is not None}
    left = left_over(problem, result) if any(p.identifiable is False for p in told.values()) else {}
    for name, p in told.items():
        given, free = (problem.parameters if guesses is None else guesses).get(name), _inertias(problem)[name]
        if not isinstance(given, Free) or (there := _near(given, free)) is None:
            continue
        lost, far = p.identifiable is False, p.value > there.max
        beyond = far and (lost or _excess(solution, result, name) > MOST)
        if beyond or (lost and _astray(left, solution, result, name, p.value < there.min)):
            near[name] = there
            said.append(f"{name} would be {p}, {p.value / given.guess:.2g} times its guess")
    if not said:
        return problem, ""
    return replace(problem, parameters={**problem.parameters, **near}), NOTE.format(said=listed(said), of="the guess")


def wild(problem: Problem, result: Smoothing) -> bool:
    """Whether an inertia has left all bounds of reason in a smoothing that did not come to rest, or does not tell it.

    As the solver left it: of a machine that never moved none at all says as much.
    """
    if noisy_inputs(problem) or (solution := result.solution) is None:
        return False
    ended = {p.name: float(value) for p, value in zip(solution.transcription.dae.parameters, solution.parameters, strict=True)}
    for name, free in _inertias(problem).items():
        p = result.parameters.get(name)
        lost = not result.solver.converged or (p is not None and p.identifiable is False)
        if p is not None and lost and ended.get(name, 0.0) > WILD * free.guess > 0:
            return True
    return False


def with_all_near(problem: Problem) -> tuple[Problem, str]:
    """The problem with all its inertias near their guesses, and a note; the problem itself and none where they are so already."""
    near = {name: there for name, given in _inertias(problem).items() if (there := _near(given, given))}
    said = NOTE.format(said="inertias grow without end", of=f"the guess of {listed(sorted(near))}") if near else ""
    return replace(problem, parameters={**problem.parameters, **near}), said


def _inertias(problem: Problem) -> dict[str, Free]:
    """Those of the machine that are free."""
    units = {p.name: p.unit for p in problem.dae.parameters}
    return {name: free for name, free in problem.parameters.items() if isinstance(free, Free) and units.get(name) in INERTIAS}


def _near(given: Free, free: Free) -> Near | None:
    """As free as it is in a problem, but near its guess in the study; None where it is so already, or drifts."""
    low, high = max(free.min, given.guess / FAR), min(free.max, given.guess * FAR)
    if free.drift is not None or not low < high or (low, high) == (free.min, free.max):
        return None
    own = free.given if isinstance(free, Near) and free.given else free
    return Near(float(np.clip(free.guess, low, high)), low, high, free.std, None, free.per_recording, given=own)


def free_again(problem: Problem) -> Problem:
    """A problem with such inertias as free as the study has them; the same where there are none."""
    own = {n: replace(near.given, std=near.std) for n, near in problem.parameters.items() if isinstance(near, Near) and near.given}
    return replace(problem, parameters={**problem.parameters, **own}) if own else problem


def unheld(problem: Problem, solution: Solution) -> Solution:
    """A solution in which no bound holds such inertias; the same where none does."""
    t, first = solution.transcription, solution.transcription.nlp.trajectory_size
    near = {name for name, free in problem.parameters.items() if isinstance(free, Near)}
    loose = {first + k for k in solution.parameters_on_bounds.tolist() if t.dae.parameters[t.nlp.free[k]].name in near}
    if not loose:
        return solution
    return replace(solution, solved=replace(solution.solved, on_bound=tuple(k for k in solution.solved.on_bound if k not in loose)))


def _excess(solution: Solution, result: Smoothing, inertia: str) -> float:
    """By what share of itself an inertia is too large at the place where that is least; inf where it moves nothing.

    0 where no residual force is in any of its balances: then none can have made it so.
    """
    t = solution.transcription
    p, names, places = t.dae.p, [q.name for q in t.dae.parameters], _places(solution, result, inertia)
    if not places:
        return 0.0
    every = [k for k, q in enumerate(t.dae.parameters) if q.unit in INERTIAS]
    F = t.dae.undisturbed(t.dae.residual[t.dae.balances_of([*places.values()])])
    slopes = ca.densify(ca.jacobian(F, p))
    own = slopes[:, names.index(inertia)] * p[names.index(inertia)]
    J, M = np.split(in_the_middles(solution, ca.vertcat(own, slopes[:, every] @ p[every])).std(axis=1), 2)
    rows = zip((result.residual_places[name].rms for name in places), J.tolist(), M.tolist(), strict=True)
    return min((r**2 / (j * m) for r, j, m in rows if j > 0 and m > 0), default=inf)


def _astray(left: Mapping[str, float], solution: Solution, result: Smoothing, inertia: str, small: bool) -> bool:
    """Whether residual forces do most of what is done wherever an inertia is; or, of one that is next to nothing, anywhere.

    left: place -> share of the forces there that is left over. A part of a machine without the stop that it runs into is as light as can
    be, and all else is what makes up for that.
    """
    shares = [left[place] for place in (left if small else _places(solution, result, inertia))]
    return (max if small else min)(shares, default=0.0) > ALL


def _places(solution: Solution, result: Smoothing, inertia: str) -> dict[str, int]:
    """Places whose balances an inertia is in, with residual forces, by their numbers."""
    dae = solution.transcription.dae
    p = dae.p[[q.name for q in dae.parameters].index(inertia)]
    soft = {name: k for k in solution.transcription.soft if (name := dae.places[k].name) in result.residual_places}
    return {name: k for name, k in soft.items() if ca.depends_on(dae.residual[dae.balances_of([k])], p)}
