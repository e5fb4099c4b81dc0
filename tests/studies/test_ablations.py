"""The study of what every stage of a diagnosis is worth: what is left out is out, where the diagnosis looks for it."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))  # scripts import each other by name; at the end, for one of them is called coverage
import ablations

from backsight.data import path
from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis.scores import chance
from backsight.estimation.diagnosis.search import round as of_search
from backsight.models.plants import actuator

HELD = {"carriage.m"}


@pytest.fixture(scope="module")
def smoothed():
    log = Recording.read(path("axis_fit.csv.gz"), time="t_s", inputs={"F": "F_N"}, outputs={"x": "x_m"}, std={"x": 1e-6}, range=(0.0, 0.2))
    known = {"carriage.m": 95.0, "friction.d": Free(190.0), "friction.f_c": 0.0}
    problem = Problem(model=actuator(), recordings=[log], parameters=known)
    return problem, smooth(problem)


def families(smoothed, stage: str) -> set[str]:
    """Of the candidates that a round has, and whether any is a parameter that is held."""
    problem, result = smoothed
    with ablations.without(stage, HELD):
        found = of_search.library(problem, problem.model, result.solution)
    return {c.family for c in found} | {name for c in found if c.family == "parameter" for name in {*c.strengths, *c.start} & HELD}


def anew(smoothed, stage: str, **parameters: float):
    problem, _ = smoothed
    with ablations.without(stage, set()):
        return smooth(replace(problem, parameters={**problem.parameters, **parameters}))


def test_without_a_mesh_that_is_looked_after_it_is_coarse(smoothed) -> None:
    step = float(np.median(np.diff(smoothed[0].recordings[0].time)))
    coarse, usual = (anew(smoothed, stage).solution.transcription.horizons[0].mesh.steps for stage in ("mesh", "nothing"))
    assert float(np.median(coarse)) == pytest.approx(ablations.COARSE * step, rel=0.2)
    assert float(np.median(usual)) < 0.5 * ablations.COARSE * step


def test_without_care_near_rest_no_force_has_room_there(smoothed) -> None:
    shares = [anew(smoothed, stage, **{"friction.f_c": 20.0}).residual_places["carriage"].rest_share for stage in ("rest", "nothing")]
    assert not shares[0]
    assert shares[1] > 0


def test_without_rivals_there_is_physics_alone(smoothed) -> None:
    found = families(smoothed, "rivals")
    assert "friction" in found
    assert not found & set(ablations.SUSPECTS)


def test_nobody_doubts_a_parameter_that_is_held(smoothed) -> None:
    assert HELD & families(smoothed, "nothing")
    assert not HELD & families(smoothed, "own")


def test_without_draws_looks_count_as_if_they_had_nothing_in_common() -> None:
    def alike() -> chance.Chance:
        return chance.Chance(looks=Counter({1: 100}), most=np.full(chance.DRAWS, 0.5))

    bound = float(alike().bound(np.array([10.0]))[0])
    assert alike().of(10.0) < 0.5 * bound
    with ablations.without("draws", set()):
        assert alike().of(10.0) == pytest.approx(bound, rel=1e-3)
