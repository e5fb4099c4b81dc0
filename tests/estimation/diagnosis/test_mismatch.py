"""The residual forces of the page are those of the estimates, against what was recorded."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import smooth
from backsight.estimation.diagnosis.answer.mismatch import mismatches


def test_a_force_that_lacks_is_seen_against_the_velocity_that_it_follows():
    made = run(1.0, 2e-3, f_c=20.0)
    problem = posed(made, W={"carriage": 0.5})
    result = smooth(problem)
    (found,) = mismatches(result)
    assert (found.place, found.unit, found.recording) == ("carriage", "N", "axis")
    assert found.time == pytest.approx(made.time)
    assert set(found.against) == {"position", "velocity", "F"}
    v, unit = found.against["velocity"]
    assert unit == "m/s"
    assert v == pytest.approx(made.truth["carriage.v"], abs=5e-3)
    assert found.against["position"][0] == pytest.approx(made.truth["carriage.s"], abs=1e-5)
    pushed, unit = found.against["F"]
    assert unit == "N"
    assert pushed[:-1] == pytest.approx(made.inputs["F"][:-1])
    # what balances the axis' own forces under the parameters that were found
    m, d = (result.parameters[name].value for name in ("carriage.m", "friction.d"))
    speed, rate = made.truth["carriage.v"], np.gradient(made.truth["carriage.v"], made.time)
    lacking = (m - 95.109) * rate + (d - 203.5) * speed - 20.0 * np.sign(speed)
    moving = np.abs(speed) > 0.03
    moving[:20] = moving[-20:] = False
    assert np.sqrt(np.mean(lacking[moving] ** 2)) > 3.0
    assert np.corrcoef(found.force[moving], lacking[moving])[0, 1] > 0.9
    assert np.all(found.std > 0)
