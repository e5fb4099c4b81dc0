"""Parameters that drift: as posed they are states, and are known and treated as what they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from friction_axis import FrictionAxis

from backsight.estimation import Free, Weights
from backsight.estimation.tracking import Estimator, Outcome


@pytest.fixture(scope="module")
def tracked():
    axis = FrictionAxis()
    problem = axis.posed({"friction.f_c": Free(8.0, min=0.0, drift=0.05), "offset.f": Free(-3.0)})
    estimator = Estimator(replace(problem, weights=Weights(W={"carriage": axis.FORCE_STD})), samples=20)
    return axis, estimator, [estimator.update(axis.sample(k)) for k in range(400)]


def test_one_of_which_only_a_guess_is_given_starts_there(tracked):
    *_, estimates = tracked
    assert estimates[0]["friction.f_c"] == pytest.approx(8.0)
    assert estimates[0].std("friction.f_c") == pytest.approx(16.0)


def test_a_friction_law_has_room_near_rest_also_where_its_strength_drifts(tracked):
    axis, estimator, estimates = tracked
    assert [law.velocity for law in estimator.tuning.laws] == ["friction.v_rel"]
    z = np.array([(e["carriage.v"] - axis.states[k, 1]) / e.std("carriage.v") for k, e in enumerate(estimates)])[50:]
    assert np.mean(z**2) < 2.0
    assert abs(estimates[-1]["friction.f_c"] - 20.0) < 4 * estimates[-1].std("friction.f_c")


def test_after_a_gap_it_is_known_as_before_and_for_the_walk_in_between(tracked):
    axis, estimator, estimates = tracked
    before, late = estimates[-1], axis.sample(400)
    after = estimator.update(replace(late, time=before.time + 9.0))
    assert after.outcome is Outcome.RESTARTED
    assert after["friction.f_c"] == pytest.approx(before["friction.f_c"])
    assert after.std("friction.f_c") == pytest.approx(np.hypot(before.std("friction.f_c"), 0.05 * 3.0), rel=1e-6)
