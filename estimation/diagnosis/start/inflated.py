"""Inertias that came out far larger than anybody guessed, since the model lacks a force.

Where a controller holds the motion, inputs answer what the model lacks, and the motion is smooth all the same: for white residual forces a
larger inertia explains that better than any force does, the larger the better. Scores beside such a model tell nothing, and fits that begin
there end there. With the inertia near its guess what is missing is seen.
"""

from __future__ import annotations

from dataclasses import replace

from ...problem import Free, Problem
from ...results import Smoothing
from ...wording import listed

FAR = 3.0  # times its guess
INERTIAS = ("kg", "kg.m2")
NOTE = (
    "With nothing put right {said}. While what is missing was looked for, and since, each was taken to be three times its guess at most. "
    "Where its input only answers what the model lacks, under a stiff controller, give every input the noise of its measurement, V, and "
    "residual forces next to none, W, in [weights]."
)


def with_inertias_bounded(problem: Problem, result: Smoothing) -> tuple[Problem, str]:
    """The problem with such inertias of a result of it bounded, and a note on it; the problem itself and no note where there are none.

    Nor where an input has noise of its own: it may answer what it will then.
    """
    parameters, said = dict(problem.parameters), list[str]()
    if any(u.name in problem.weights.V for u in problem.dae.inputs):
        return problem, ""
    for name, given in problem.parameters.items():
        p = result.parameters.get(name)
        if p is None or p.unit not in INERTIAS or not isinstance(given, Free) or not p.value > FAR * given.guess > 0:
            continue
        parameters[name] = replace(given, max=min(given.max, FAR * given.guess))
        said.append(f"{name} would be {p.value:.3g} {p.unit}, {p.value / given.guess:.2g} times its guess")
    if not said:
        return problem, ""
    return replace(problem, parameters=parameters), NOTE.format(said=listed(said))
