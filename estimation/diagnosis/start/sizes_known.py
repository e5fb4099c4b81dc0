"""Parameters that the recordings do not tell apart: models with them have no evidence, unless something is known of them beforehand."""

from __future__ import annotations

from dataclasses import replace

from ...problem import Free, Problem
from ...results import Smoothing
from ...wording import listed
from ..search.refit import comparable

NOTE = (
    "The recordings do not tell {names} apart. So that models can be compared each was taken to be known to within its own size: {known}. "
    "Fix one, or give it the std that it is known to."
)


def with_sizes_known(problem: Problem, result: Smoothing) -> tuple[Problem, str]:
    """The problem with the free parameters that a result of it leaves open known to be as large as their guesses, and a note on it.

    The problem itself and no note where there are none, or models can be compared as they are. A guess of 0 has the nominal size. What the
    recordings tell stays as it was: of a sum that is sharp, a std as large as its parts says nothing.
    """
    if comparable(problem, result):
        return problem, ""
    info, parameters, said = {p.name: p for p in problem.dae.parameters}, dict(problem.parameters), list[str]()
    for name, given in problem.parameters.items():
        found = result.parameters.get(name)
        if not isinstance(given, Free) or given.std is not None or given.varies or found is None or found.std is not None or found.on_bound:
            continue
        size = abs(given.guess) or abs(info[name].nominal) or 1.0
        parameters[name] = replace(given, std=size)
        said.append(f"{name} = {given.guess:g} ± {size:g} {info[name].unit}")
    if not said:
        return problem, ""
    names = [line.partition(" = ")[0] for line in said]
    return replace(problem, parameters=parameters), NOTE.format(names=listed(names), known="; ".join(said))
