"""Of weights that the data do not tell: what is given stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from shaken import LINEAR, PLANT, TRUE, driven

from backsight.estimation import Free, Problem, Recording, weigh


@pytest.mark.slow
def test_a_sensor_whose_every_sample_a_force_can_follow_keeps_the_noise_that_was_given():
    """A force of broad band, sampled slowly by a fine sensor: whatever the noise, forces explain every sample."""
    time, u = driven(240)
    rng = np.random.default_rng(5)
    y = truths.disturbed(LINEAR, time, u, np.zeros(2), 30.0, rng)[:, 0] + 1e-8 * rng.standard_normal(240)
    record = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": 3e-6})
    problem = Problem(
        model=PLANT, recordings=[record, replace(record, name="again", role="held_out")], parameters=TRUE | {"damper.d": Free(1.0)}
    )
    study = weigh(problem)
    assert np.isnan(study.components["V of x"].log_std)
    assert study.components["V of x"].std == pytest.approx(3e-6)
    assert any("follow every sample" in note for note in study.notes)
