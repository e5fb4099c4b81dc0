"""What a model does not explain is no noise of its sensors where their samples show that they have none."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from two_inertias import NOISE, drive, posed

from backsight.estimation import Free, Problem, Weights, diagnose, smooth
from backsight.estimation.diagnosis.start.noise_shown import FAR, _beside, with_noise_as_shown, with_noise_at_least
from backsight.estimation.recordings.noise import noise
from backsight.models import Model
from backsight.models.mechanics.rotational import RotationalRigid


def rigid() -> Model:
    """As somebody declares the drive who takes its shaft for rigid: two sensors of one speed then, of which one is off."""
    soft = drive()
    return replace(soft, components={**soft.components, "shaft": RotationalRigid()})


def contradicting() -> Problem:
    whole = posed()
    return replace(whole, model=rigid(), parameters={"load.J": Free(0.05), "bearing.d": Free(0.06)})


def test_noise_that_a_model_would_need_is_held_at_what_the_samples_show():
    problem = replace(contradicting(), recordings=contradicting().recordings[:1])
    held, said = with_noise_as_shown(problem, smooth(problem))
    assert held.weights.V
    assert all(std == pytest.approx(NOISE, rel=0.15) for std in held.weights.V.values())
    assert all(f"{name.partition(' [')[0]} has" in said for name in held.weights.V)


def test_every_recording_has_its_own():
    """A second one is ten times as noisy, and the sentence tells of the one whose noise grew least."""
    (first, second), rng = contradicting().recordings, np.random.default_rng(5)
    loud = {name: y + 10 * NOISE * rng.standard_normal(len(y)) for name, y in second.outputs.items()}
    problem = replace(contradicting(), recordings=[first, replace(second, role="fit", outputs=loud)])
    result = smooth(problem)
    held, said = with_noise_as_shown(problem, result)
    assert held.weights.V
    for name, std in held.weights.V.items():
        assert std == pytest.approx(NOISE * (1.0 if first.name in name else np.hypot(1.0, 10.0)), rel=0.15)
        assert name.partition(" [")[2].rstrip("]") in (first.name, second.name)
    times, least = (float(word) for word in re.findall(r"n_1 has (\S+) times the noise of (\S+) ", said)[0])
    assert times * least == pytest.approx(result.weights.V[f"n_1 [{first.name}]"], rel=0.05)
    assert with_noise_as_shown(held, smooth(held)) == (held, "")


def test_noise_that_is_given_or_as_the_samples_show_it_stays():
    problem = replace(contradicting(), recordings=contradicting().recordings[:1])
    given = replace(problem, weights=Weights(V={"n_1": 50 * FAR * NOISE, "n_2": 50 * FAR * NOISE}))
    assert with_noise_as_shown(given, smooth(given)) == (given, "")
    whole = replace(posed(), recordings=posed().recordings[:1])
    assert with_noise_as_shown(whole, smooth(whole)) == (whole, "")


@pytest.mark.slow
@pytest.mark.long
def test_a_shaft_that_was_taken_for_rigid_is_found_though_nobody_gave_the_sensors_noise():
    d = diagnose(contradicting(), jobs=1)
    (finding,) = d.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("motor", "compliance")
    assert finding.explanation.parameters["k"].value == pytest.approx(30.0, rel=0.02)


def test_a_std_that_is_far_less_than_the_noise_of_the_samples_is_theirs():
    whole = posed()
    said_less = [replace(r, output_std={"n_1": NOISE / 3, "n_2": NOISE}) for r in whole.recordings]
    problem, said = with_noise_at_least(replace(whole, recordings=said_less))
    for r in problem.recordings:
        assert r.output_std == {"n_1": pytest.approx(NOISE, rel=0.15), "n_2": NOISE}
    assert "n_1 has std" in said
    assert "n_2" not in said
    right = replace(whole, recordings=[replace(r, output_std={"n_1": NOISE, "n_2": NOISE}) for r in whole.recordings])
    assert with_noise_at_least(right) == (right, "")
    given = replace(whole, recordings=said_less, weights=Weights(V={"n_1": NOISE / 3}))
    assert with_noise_at_least(given) == (given, "")


def test_what_an_output_does_at_once_with_a_rough_input_is_no_noise():
    """A current behind a voltage that is another one at every row: a first-order lag of three quarters of a row, by its exact solution."""
    rng, n, std = np.random.default_rng(0), 2000, 1e-3
    v, a, i = rng.standard_normal(n), np.exp(-1.0 / 0.75), np.zeros(n)
    for k in range(n - 1):
        i[k + 1] = a * i[k] + (1 - a) * v[k]
    y = i + std * rng.standard_normal(n)
    assert noise(np.arange(float(n)), y).white > 100 * std
    assert _beside(y, {"v": v}) == pytest.approx(std, rel=0.3)
    assert _beside(y, {"other": rng.standard_normal(n)}) > 100 * std
    assert _beside(y[:20], {"v": v[:20]}) == np.inf
