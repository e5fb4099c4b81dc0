"""Of weights that the data do not tell: what is given stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from shaken import LINEAR, PLANT, TRUE, driven

from backsight.estimation import Free, Problem, Recording, weigh
from backsight.estimation.weighing.estimated import estimated


def followed(std: float) -> Problem:
    """A force of broad band, sampled slowly by a fine sensor: whatever the noise, forces explain every sample. std: what is given."""
    time, u = driven(240)
    rng = np.random.default_rng(5)
    y = truths.disturbed(LINEAR, time, u, np.zeros(2), 30.0, rng)[:, 0] + 1e-8 * rng.standard_normal(240)
    record = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": std})
    return Problem(
        model=PLANT, recordings=[record, replace(record, name="again", role="held_out")], parameters=TRUE | {"damper.d": Free(1.0)}
    )


@pytest.mark.slow
def test_a_sensor_whose_every_sample_a_force_can_follow_keeps_the_noise_that_was_given():
    study = weigh(followed(3e-6))
    assert np.isnan(study.components["V of x"].log_std)
    assert study.components["V of x"].std == pytest.approx(3e-6)
    assert any("follow every sample" in note for note in study.notes)


def test_noise_that_was_given_and_is_more_than_the_samples_have_is_not_kept():
    """It would take every motion for noise: the force that moves the mass would be none."""
    problem = followed(100.0)
    assert np.std(problem.recordings[0].outputs["x"]) < 10.0
    found = estimated(problem, lambda _: None)
    stds = found.knobs.stds(found.best.theta)
    assert found.best.arrived
    assert stds["V of x"] < 0.1 * np.std(problem.recordings[0].outputs["x"])
    assert stds["W of mass"] == pytest.approx(30.0, rel=0.2)
