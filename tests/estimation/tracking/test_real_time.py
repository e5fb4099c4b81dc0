"""What one Gauss-Newton step a sample loses."""

from __future__ import annotations

import numpy as np
import pytest
from friction_axis import FrictionAxis

from backsight.estimation.tracking import Estimator

SETTLED = 200  # rows after which the parameters are known


@pytest.fixture(scope="module")
def axis():
    return FrictionAxis()


@pytest.mark.slow
def test_one_step_a_sample_follows_the_converged_estimates_within_their_deviations(axis):
    """Where friction reverses, a step is off by a part of a deviation, and the next ones make up for it (M. Diehl et al., 2005)."""
    whole = Estimator(axis.problem, samples=50)
    quick = Estimator(axis.problem, samples=50, iterations=1, tuning=whole.tuning)
    away = []
    for k in range(len(axis.time)):
        converged, once = whole.update(axis.sample(k)), quick.update(axis.sample(k))
        assert once.iterations == 1
        states = np.abs(once.states - converged.states) / converged.states_std
        parameters = np.abs(once.parameters - converged.parameters) / converged.parameters_std
        away.append(max(states.max(), parameters.max()))
    late = np.array(away[SETTLED:])
    assert late.max() < 0.5
    assert np.quantile(late, 0.9) < 0.02
    assert late[-1] < 0.02
