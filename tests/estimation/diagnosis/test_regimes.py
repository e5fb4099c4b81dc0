"""Effects that set in at a known time, and such as act all along."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import smooth
from backsight.estimation.diagnosis.library import library
from backsight.estimation.diagnosis.regimes import regime
from backsight.estimation.diagnosis.score import Linearised
from backsight.estimation.diagnosis.supermodel import looked_at

DURATION = 1.5


def judged(physics: str, force, **carriage):
    problem = posed(run(DURATION, 2e-3, force=force, **carriage))
    result = smooth(problem)
    base = Linearised(result.solution)
    found = [c for c in library(problem, problem.model, result.solution) if c.key == ("carriage", physics)]
    (look,) = looked_at(problem, problem.model, base, found)
    return regime(base, look)


@pytest.mark.parametrize("at", [0.5, 1.0])
def test_a_force_that_sets_in_is_dated_to_a_step_of_the_grid(at):
    found = judged("constant_force", lambda t, *_: np.array([-8.0 if t > at else 0.0]))
    assert found.onset == pytest.approx(at, abs=DURATION / 40)
    assert found.words == f"from {found.onset:.4g} s on"


def test_friction_that_sets_in_is_dated_too():
    found = judged("coulomb_friction", lambda t, _, v: -8.0 * np.tanh(v / 1e-3) * (t > 0.8))
    assert found.onset == pytest.approx(0.8, abs=DURATION / 20)


@pytest.mark.parametrize(("physics", "carriage"), [("constant_force", {"f_0": 8.0}), ("coulomb_friction", {"f_c": 8.0})])
def test_what_acts_all_along_has_no_date(physics, carriage):
    found = judged(physics, None, **carriage)
    assert found.onset is None
    assert found.words == "whole record"
