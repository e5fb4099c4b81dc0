"""A spring that rests anywhere: of an axis whose simulator has one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, Motion, of_law
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search import refit
from backsight.estimation.diagnosis.search.choice import chosen
from backsight.estimation.diagnosis.search.refit import QUICKLY, begun, fitted, settled
from backsight.models.plants import actuator

K, REST = 800.0, 0.15  # N/m, m
MOTION = Motion(v_rms=0.2, low=-0.3, high=0.5)


@pytest.mark.parametrize("offset", [0.0, Free(0.0)])
def test_where_a_spring_rests_is_told_where_no_free_constant_could_tell_it_otherwise(offset):
    problem = posed(run(1.0, 2e-3, force=lambda _, s, __: -K * (s - REST)), offset__f=offset)
    result = smooth(problem, settings=QUICKLY)
    base = Linearised(result.solution)
    found = screen(base, looked_at(problem, problem.model, base, library(problem, problem.model, result.solution)))
    springs = [s for s in chosen(found, Sizes(problem, result, base)) if s.candidate.physics == "spring"]
    resting = [s for s in springs if s.candidate.shapes]
    if offset:
        assert [len(s.candidate.strengths) for s in springs] == [1]
        assert not resting
        (s,) = springs
    else:
        (s,) = resting
    fit = fitted(settled(problem, result), problem.model, result, s.candidate, begun(s.candidate, s, {}))
    told = {name.rpartition(".")[2]: p for name, p in fit.result.parameters.items() if name in s.candidate.named.values()}
    assert set(told) == ({"k"} if offset else {"k", "s_rel0"})
    for word, true in (("k", K), ("s_rel0", REST)):
        if word in told:
            assert abs(told[word].value - true) < 3 * told[word].std < 0.01 * true
    if offset:
        constant = fit.result.parameters["offset.f"]
        assert abs(abs(constant.value) - K * REST) < 3 * constant.std
    assert np.isfinite(fit.worth.nats)


def test_a_spring_that_would_push_is_none():
    """Stiffness is never negative: such a candidate would take the place of others and fit as nothing."""
    problem = posed(run(1.0, 2e-3, force=lambda _, s, __: 0.3 * K * (s - REST)))
    result = smooth(problem, settings=QUICKLY)
    base = Linearised(result.solution)
    found = screen(base, looked_at(problem, problem.model, base, library(problem, problem.model, result.solution)))
    (resting,) = (s for s in found.found if s.candidate.physics == "spring" and s.candidate.shapes)
    assert resting.estimate[0] < 0
    assert resting.gain > 0.9 * found.found[0].gain
    assert resting not in chosen(found, Sizes(problem, result, base))


def test_what_takes_over_a_spring_leaves_nothing_of_it_free():
    bare, (spot,) = posed(run(0.1)), bodies(actuator())
    resting, cubic = (
        next(law for law in AGAINST_GROUND if word in (law.label, law.physics)) for word in ("spring_at_rest", "cubic_spring")
    )
    found = of_law(resting, bare.model, spot, MOTION)
    k, rest = found.strengths[0], found.named["s_rel0"]
    problem, model = refit.posed(bare, bare.model, found, {k: 5.0, rest: 0.3})
    later = of_law(cubic, model, spot, MOTION)
    later = replace(later, absorbs={k: later.strengths[0]}).with_all_of([found], problem.parameters)
    assert later.replaces(found)
    assert later.size == len(later.strengths) - 2
    now, _ = refit.posed(problem, model, later, {})
    assert (now.parameters[k], now.parameters[rest]) == (0.0, 0.3)
