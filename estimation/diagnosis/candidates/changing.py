"""Parameters of the machine, free or fixed, that may be others from some time on, for a while, or little by little."""

from __future__ import annotations

from collections.abc import Collection

from backsight.models import Model, ParameterInfo
from backsight.models.mechanics.rotational import Gear, Rack
from backsight.ocp import Solution

from ...problem import Free, Problem
from .candidate import Candidate
from .places import free_name, of_machine, sensors

LENGTHS = ("m", "rad", "m/rad", "rad/m")  # units of what says where things are


def changing(problem: Problem, model: Model, solution: Solution, brought: Collection[str] = ()) -> list[Candidate]:
    """Candidates for every one of them, whether it changed before or not.

    They are looked at from times on, and little by little, alone (`Candidate.since`, `Candidate.slowly`): all along, one that is free gains
    nothing. Lengths and ratios are none: with another one a machine would stand elsewhere at once. solution, brought: as of `library`.
    """
    return [
        Candidate(
            place=info.name.partition(".")[0],
            family="parameter",
            physics="wrong_parameter",
            strengths=(info.name,),
            start={info.name: (value, info.minimum, info.maximum)},
            change=free_name(model, f"{info.name.replace('.', '_')}_change"),
        )
        for info, value in zip(solution.transcription.dae.parameters, solution.parameters.tolist(), strict=True)
        if value != 0 and _may(problem, model, info, brought)
    ]


def _may(problem: Problem, model: Model, info: ParameterInfo, brought: Collection[str]) -> bool:
    """Whether a parameter may change: a number of components of the machine."""
    given = problem.parameters.get(info.name)
    ends = [path for path, by in model.bindings.items() if by == info.name] or [info.name]
    owners = {path.partition(".")[0] for path in ends}
    if not all(_declared(model, path) for path in ends) or owners & {*sensors(model), *brought}:
        return False
    if info.name in model.onsets or info.smoothing or info.unit in LENGTHS:
        return False
    if isinstance(given, Free) and (given.drift is not None or given.per_recording):
        return False
    if given is None and not (of_machine(info.name, model) and all(path.rpartition(".")[2] != "g" for path in ends)):
        return False
    return not any(isinstance(model.components[owner], Gear | Rack) for owner in owners)


def _declared(model: Model, path: str) -> bool:
    owner, _, word = path.partition(".")
    return owner in model.components and word in model.components[owner].declared_parameters
