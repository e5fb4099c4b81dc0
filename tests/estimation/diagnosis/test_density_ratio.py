"""Evidence without some parameters, from the fit that has them: against fits that do without."""

from __future__ import annotations

from dataclasses import replace
from math import log

import pytest
from concealed_axis import posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.candidates import Candidate
from backsight.estimation.diagnosis.choice import idle
from backsight.estimation.diagnosis.density_ratio import more_probable_at

FREE = {"carriage.m": Free(95), "friction.d": Free(200), "offset.f": Free(0)}


@pytest.fixture(scope="module")
def axis() -> tuple:
    problem = posed(run(1.0, 2e-3), W={"carriage": 0.05})
    problem = replace(problem, parameters={**problem.parameters, **FREE})
    return problem, smooth(problem)


@pytest.mark.parametrize("names", [("offset.f",), ("friction.d", "offset.f")])
@pytest.mark.parametrize("away", [0.0, 3.0])
def test_it_is_what_schwarz_criterion_says_of_two_fits(axis, names, away):
    problem, result = axis
    values = {n: result.parameters[n].value + away * result.parameters[n].std for n in names}
    fixed = smooth(replace(problem, parameters={**problem.parameters, **values}))
    expected = fixed.criteria.log_likelihood - result.criteria.log_likelihood + 0.5 * len(names) * log(result.criteria.samples)
    assert more_probable_at(result, values) == pytest.approx(expected, abs=0.05)


def test_a_strength_that_is_within_its_deviation_of_nothing_is_idle_and_one_far_from_it_is_not(axis):
    _, result = axis
    d = result.parameters["friction.d"]

    def given(value: float) -> Candidate:
        start = {"friction.d": (value, 0.0, 1e4)}
        return Candidate(place="friction", family="parameter", physics="wrong_parameter", strengths=("friction.d",), start=start)

    assert idle(given(d.value + 0.5 * d.std), result)
    assert idle(given(d.value + 3.0 * d.std), result)  # 4.5 nats less what any parameter costs
    assert not idle(given(d.value + 8.0 * d.std), result)
    assert not idle(Candidate(place="screw", family="transmission", physics="compliance", dear=True), result)
