"""A spring that rests anywhere: of an axis whose simulator has one."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.choice import chosen
from backsight.estimation.diagnosis.search.refit import QUICKLY, begun, fitted, settled

K, REST = 800.0, 0.15  # N/m, m


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
