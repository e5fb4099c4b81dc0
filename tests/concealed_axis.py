"""An axis with one effect that its model lacks, from a simulator that shares nothing with this project's, for the tests of diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from types import MappingProxyType

import numpy as np

from backsight.data.generators import actuator as machine
from backsight.data.generators.run import Run
from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.models.plants import actuator

NOISE = 2e-6  # m
LEFT = 0.02  # N sqrt(s), white, in every run

Force = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def run(duration: float, step: float = 1e-3, seed: int = 1, force: Force | None = None, **carriage: float) -> Run:
    """Smooth random motions; carriage: its parameters, no friction but a viscous one by itself."""
    conditions = replace(machine.CONDITIONS, duration=duration, step=step)
    return machine.record(machine.Carriage(**{"f_c": 0.0, "f_0": 0.0, **carriage}), seed=seed, conditions=conditions, force=force)


def posed(made: Run, *, W: Mapping[str, float] = MappingProxyType({"carriage": LEFT}), **parameters: Free | float) -> Problem:
    """Mass and viscous friction are free; no Coulomb friction, no offset. parameters: with __ for the dot."""
    recording = Recording(name="axis", time=made.time, inputs=made.inputs, outputs=made.outputs, output_std={"x": NOISE})
    known = {"carriage.m": Free(90.0), "friction.d": Free(190.0), "friction.f_c": 0.0, "offset.f": 0.0}
    return Problem(
        model=actuator(),
        recordings=[recording],
        parameters={**known, **{name.replace("__", "."): value for name, value in parameters.items()}},
        weights=Weights(W=W),
    )


@cache
def smoothed(duration: float = 1.0, step: float = 1e-3, seed: int = 1) -> tuple[Problem, Smoothing, Linearised]:
    """A model that lacks nothing, with its weights given."""
    problem = posed(run(duration, step, seed))
    result = smooth(problem)
    assert result.solution is not None
    return problem, result, Linearised(result.solution)
