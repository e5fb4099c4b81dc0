"""Where a smoothing starts from the samples: the way there is gone once for a problem, whatever weights are chosen then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Settings, Weights
from backsight.estimation.smoothing.smoother import smoothing

HELD = Settings(check_mesh=False, weigh=False)


def told(problem, settings: Settings) -> tuple[object, int]:
    """The result, and how often samples were followed on the way to it."""
    said = list[str]()
    result = smoothing(problem, settings=settings, progress=said.append)
    return result, sum(line == "following the samples" for line in said)


def test_the_way_from_the_samples_is_gone_once_for_a_problem() -> None:
    problem = replace(posed(run(0.3, f_c=20.0), friction__f_c=15.0), weights=Weights())
    (held, first), (weighed, second) = told(problem, HELD), told(problem, Settings(check_mesh=False))
    assert (first, second) == (1, 0)
    anew, third = told(replace(problem), Settings(check_mesh=False))
    assert third == 1
    for name, one in anew.parameters.items():
        assert weighed.parameters[name].value == one.value
    assert held.parameters["carriage.m"].value != weighed.parameters["carriage.m"].value


@pytest.mark.parametrize("step", [2e-3, 4e-3])
def test_another_mesh_is_another_way(step: float) -> None:
    problem = posed(run(0.1))
    told(problem, HELD)
    result, times = told(problem, replace(HELD, step=step))
    assert times == 1
    assert np.diff(result.solution.transcription.horizons[0].mesh.knots).min() > 0.4 * step
