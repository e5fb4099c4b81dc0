"""Evidence without some parameters, from the fit that has them: against fits that do without."""

from __future__ import annotations

from dataclasses import replace
from math import log

import pandas as pd
import pytest
from concealed_axis import posed, run

from backsight.estimation import Free, Problem, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.edits import Rebuild
from backsight.estimation.diagnosis.evidence.density_ratio import more_probable_alike, more_probable_at
from backsight.estimation.diagnosis.search.choice import idle
from backsight.models.language import Parameter
from backsight.models.mechanics.translational import AsymmetricFriction
from backsight.models.plants import actuator

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


def test_two_that_are_one_number_to_the_last_digit_are_as_probable_as_one(axis):
    """Their difference has no variance; where they differ all the same they are not one."""
    _, result = axis
    one = next(iter(result.parameters.values()))
    same = pd.DataFrame(1.0, index=["a", "b"], columns=["a", "b"])

    def alike(other: float) -> float:
        twins = {"a": replace(one, name="a", std=1.0, value=5.0), "b": replace(one, name="b", std=1.0, value=other)}
        return more_probable_alike(replace(result, parameters=twins, correlation=same), "a", "b")

    assert alike(5.0) == pytest.approx(0.5 * log(result.criteria.samples))
    assert alike(4.0) < -1e9


def of_two_directions(apart: float) -> tuple[Problem, dict[str, Free]]:
    """The axis with a friction of each direction, whose drag is larger by `apart` [N s/m] in one of them."""
    problem = posed(run(1.0, 2e-3, d=200.0), W={"carriage": 0.05})
    model = actuator()
    model = replace(model, components={**model.components, "friction": AsymmetricFriction(d_plus=150.0 + apart, d_minus=150.0)})
    known = {name: value for name, value in problem.parameters.items() if not name.startswith("friction")}
    return replace(problem, model=model, parameters=known), {"friction.d_plus": Free(200.0), "friction.d_minus": Free(200.0)}


def test_two_directions_that_are_one_are_as_probable_as_one_by_schwarz_criterion_too():
    problem, both = of_two_directions(0.0)
    two = smooth(replace(problem, parameters={**problem.parameters, **both}))
    lent = {"friction.d_plus": "d", "friction.d_minus": "d"}
    once = replace(problem.model, parameters={"d": Parameter("N.s/m", 200.0, min=0.0)}, bindings=lent)
    one = smooth(replace(problem, model=once, parameters={**problem.parameters, "d": Free(200.0)}))
    expected = one.criteria.log_likelihood - two.criteria.log_likelihood + 0.5 * log(two.criteria.samples)
    assert more_probable_alike(two, *both) == pytest.approx(expected, abs=0.05)

    def taking(*names: str) -> Candidate:
        law = {"place": "carriage", "family": "friction", "physics": "asymmetric_friction", "strengths": tuple(both)}
        law["edits"] = (Rebuild(edit=lambda model: model, said="a friction of each direction"),)
        return Candidate(**law, start=dict.fromkeys(both, (200.0, 0.0, 10000.0)), absorbs={name: " ".join(both) for name in names})

    assert idle(taking("friction.d"), two)
    assert not idle(taking(), two)  # a model without any friction has to have one
