"""The held-out proof, on machines from simulators that share nothing with this project."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from one_dimensional import body_with

from backsight.data.generators import actuator as machine
from backsight.data.generators.run import Conditions
from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis import HeldOut
from backsight.estimation.diagnosis.proof.predictor import Predictor
from backsight.estimation.diagnosis.proof.proof import GROWN, horizons, prove
from backsight.models import law
from backsight.models.mechanics.translational import Spring
from backsight.models.plants import actuator

NOISE, PROCESS = 2e-6, 0.02
KNOWN = {"carriage.m": Free(90.0), "friction.d": Free(250.0), "offset.f": Free(0.0)}


def record(seed: int, role: str, f_c: float, duration: float) -> Recording:
    conditions = Conditions(duration=duration, step=2e-3, noise={"x": NOISE}, process={"carriage": PROCESS})
    run = machine.record(machine.Carriage(f_c=f_c), seed=seed, conditions=conditions)
    return Recording(name=role, time=run.time, inputs=run.inputs, outputs=run.outputs, output_std={"x": NOISE}, role=role)


def proven(f_c: float, duration: float) -> HeldOut:
    """A base model without Coulomb friction against one with it."""
    fit, held = record(1, "fit", f_c, duration), record(2, "held_out", f_c, duration)
    base = Problem(model=actuator(), recordings=[fit], parameters={**KNOWN, "friction.f_c": 0.0})
    repaired = replace(base, parameters={**KNOWN, "friction.f_c": Free(5.0, min=0.0)})
    return prove((base, smooth(base)), (repaired, smooth(repaired)), [held])


@pytest.fixture(scope="module")
def friction() -> HeldOut:
    return proven(20.0, 2.0)


def test_the_right_repair_gains_much_and_surely(friction):
    assert friction.improvement_percent > 50
    assert friction.p_value < 0.01
    assert not friction.doubtful
    assert not friction.untold
    assert friction.recordings == ("held_out",)
    before, after, unit = friction.force["carriage"]
    assert unit == "N"
    assert before > 10
    assert after < 1
    assert list(friction.before["x"].windows) == list(friction.after["x"].windows) == [0.05, 0.2, 0.25]


def test_the_right_repair_closes_the_gap_to_what_free_forces_would_gain(friction):
    """Errors of the repaired model over those of one whose forces are known: by the windows' own numbers, with the noise as the least."""
    before, after = (np.array(list(side["x"].windows.values())) for side in (friction.before, friction.after))
    expected = 100 * np.mean(1 - after / before) / np.mean(1 - NOISE / before)
    assert friction.attainable_percent == pytest.approx(expected, abs=1.0)
    assert friction.attainable_percent > 90


def test_errors_of_the_right_model_are_what_noise_and_process_make_them(friction):
    """Var = r^2 + q^2 T^3 / 3 / m^2 for a mass under white force, T up to the horizon; more, by the start, and less, by the damping."""
    for span, rms in friction.after["x"].windows.items():
        T = np.linspace(0, span, 200)
        expected = np.sqrt(np.mean(NOISE**2 + PROCESS**2 * T**3 / 3 / 95.1**2))
        assert 0.8 * expected < rms < 2.0 * expected


def test_a_repair_of_what_is_not_missing_gains_nothing():
    found = proven(0.0, 6.0)
    assert abs(found.improvement_percent) < 2
    assert abs(found.attainable_percent) < 5
    assert found.p_value > 0.05
    assert found.doubtful
    assert found.untold


@pytest.mark.slow
def test_gaps_and_what_every_recording_has_of_its_own_are_no_obstacle():
    """The held-out recording has an offset that the fitted one has not, and half a second of it is lost."""
    fit, held = record(1, "fit", 20.0, 1.5), record(2, "held_out", 20.0, 2.0)
    keep = (held.time < 0.8) | (held.time > 1.3)
    inputs, outputs = {"F": held.inputs["F"] + 4.0}, held.outputs
    held = replace(held, time=held.time[keep], inputs={"F": inputs["F"][keep]}, outputs={"x": outputs["x"][keep]}, gap=0.1)
    known = {"carriage.m": 95.109, "friction.d": 203.5, "offset.f": Free(0.0, per_recording=True)}
    base = Problem(model=actuator(), recordings=[fit], parameters={**known, "friction.f_c": 10.0})
    repaired = replace(base, parameters={**known, "friction.f_c": Free(15.0, min=0.0)})
    found = prove((base, smooth(base)), (repaired, smooth(repaired)), [held])
    assert found.improvement_percent > 50
    assert found.p_value < 0.05
    assert found.after["x"].windows[0.05] < 2 * NOISE


class Repelling(Spring):
    """A force that grows with the way, and pushes on."""

    def equations(self, c):
        return {**super().equations(c), "spring law": law(c.f, -c.k * (c.s_rel - c.s_rel0))}


@pytest.mark.parametrize(("rate", "spans"), [(5.0, {0.05, 0.25}), (30.0, {0.05})])
def test_of_an_unstable_machine_no_window_is_longer_than_its_errors_need_to_grow_a_hundredfold(rate, spans):
    """s = s_0 cosh(rate t) without a force: from 0.92 s on in the one, 0.15 s in the other."""
    model = replace(body_with(Repelling(k=2.0 * rate**2), mass=2.0), outputs={"s": "body.s"})
    time = 2e-3 * np.arange(int(9.0 / rate / 2e-3) + (600 if rate < 10.0 else 300))
    way = 1e-6 * np.cosh(rate * time) + 1e-6 * np.random.default_rng(1).standard_normal(len(time))
    run = Recording(name="run", time=time, inputs={"F": np.zeros(len(time))}, outputs={"s": way}, output_std={"s": 1e-6})
    problem = Problem(model=model, recordings=[run], parameters={"body.m": Free(1.5)})
    side = Predictor.of(problem, smooth(problem), [run], None, inf)
    assert side.growth() == pytest.approx(rate, rel=0.05)
    assert spans <= {*horizons(side, [run])}
    assert max(horizons(side, [run])) < np.log(GROWN) / rate
