"""Evidences at other deviations of the residual forces, against smoothings with these, and of machines in other units of force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import LEFT, posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.held import gained, shares
from backsight.estimation.diagnosis.refit import evidence
from backsight.estimation.validation.innovations import innovations, log_likelihood


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_the_likelihood_at_another_deviation_is_that_of_a_smoothing_with_it(factor):
    made = run(0.6, 2e-3)
    one, other = (smooth(posed(made, W={"carriage": std})) for std in (LEFT, factor * LEFT))
    truth = other.criteria.log_evidence - one.criteria.log_evidence
    found = log_likelihood(innovations(one.solution, np.array([factor]))) - log_likelihood(innovations(one.solution))
    assert abs(truth) > 5
    assert found == pytest.approx(truth, abs=0.02 * abs(truth))


def test_a_machine_whose_mass_was_held_too_large_does_not_gain_by_that():
    made = run(0.6, 2e-3)
    heavy = smooth(wrong := posed(made, W={"carriage": 50 * LEFT}, carriage__m=10 * 95.109, friction__d=Free(2000.0)))
    right = smooth(known := posed(made, W={"carriage": 50 * LEFT}, carriage__m=95.109))
    held = shares(wrong, heavy.solution)
    assert held["carriage"] == pytest.approx(0.1 * shares(known, right.solution)["carriage"], rel=0.2)
    more = gained(known, right.solution, held)
    tenth = smooth(replace(known, weights=replace(known.weights, W={"carriage": 5 * LEFT})))
    assert more == pytest.approx(evidence(known, tenth) - evidence(known, right), rel=0.2)
    assert more > 20
