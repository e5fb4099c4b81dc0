"""Evidences at other deviations of the residual forces, against smoothings with these."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_axis import LEFT, posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.evidence.held import FACTOR, rescaled
from backsight.estimation.diagnosis.search.refit import evidence
from backsight.estimation.validation.innovations import innovations, log_likelihood


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_the_likelihood_at_another_deviation_is_that_of_a_smoothing_with_it(factor):
    made = run(0.6, 2e-3)
    one, other = (smooth(posed(made, W={"carriage": std})) for std in (LEFT, factor * LEFT))
    truth = other.criteria.log_evidence - one.criteria.log_evidence
    found = log_likelihood(innovations(one.solution, np.array([factor]))) - log_likelihood(innovations(one.solution))
    assert abs(truth) > 5
    assert found == pytest.approx(truth, abs=0.02 * abs(truth))


@pytest.mark.parametrize("held", [LEFT, LEFT / FACTOR**4, LEFT * FACTOR**3])
def test_what_is_held_too_loosely_or_too_tightly_gains_about_what_the_best_factor_brings(held):
    made = run(0.6, 2e-3)
    known = posed(made, W={"carriage": held})
    result, stds = smooth(known), LEFT * FACTOR ** np.arange(-4.0, 5.0)
    at_best = max(evidence(known, smooth(posed(made, W={"carriage": std}))) for std in stds)
    assert rescaled(result.solution)[0] == pytest.approx(at_best - evidence(known, result), rel=0.25, abs=1.0)


def test_a_machine_with_a_wrong_mass_is_less_probable_than_itself_however_loosely_forces_are_held():
    made = run(0.6, 2e-3)
    heavy = smooth(wrong := posed(made, W={"carriage": 3000 * LEFT}, carriage__m=10 * 95.109, friction__d=Free(2000.0)))
    right = smooth(known := posed(made, W={"carriage": 3000 * LEFT}, carriage__m=95.109))
    assert evidence(known, right) < evidence(wrong, heavy)
    assert evidence(known, right) + rescaled(right.solution)[0] > evidence(wrong, heavy) + rescaled(heavy.solution)[0] + 100
