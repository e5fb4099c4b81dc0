"""What would tell two explanations apart, against recordings that have the sensor, and longer ones."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Problem, smooth
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import Screened, screen
from backsight.estimation.diagnosis.scores.separation import ENOUGH, NOTHING, Told, measurable, sensors, separating
from backsight.estimation.diagnosis.scores.supermodel import looked_at

WANTED = ("constant_force", "input_offset", "input_dead_zone", "cubic_spring", "spring")
NOISE, V_NOISE = 1e-3, 1e-3  # m, m/s


@cache
def looked(faster: bool = False, times: int = 1, mute: bool = False, every: int = 1) -> tuple[Problem, Linearised, dict[str, Screened]]:
    """The model linearised, and candidates scored there, by their physics.

    faster: the velocity is measured too; mute: or might be; times: it was recorded; every: of how many rows one has a position.
    """
    made = run(1.0, step=2e-3, seed=3)
    problem = posed(made)
    (recording,) = problem.recordings
    outputs, noise, model = dict(recording.outputs), {"x": NOISE}, problem.model
    if faster:
        outputs["v"] = made.truth["carriage.v"] + V_NOISE * np.random.default_rng(7).standard_normal(len(made.time))
        noise["v"], model = V_NOISE, replace(model, outputs={**model.outputs, "v": "carriage.v"})
    elif mute:
        model = replace(model, outputs={**model.outputs, "v": "carriage.v"})
    outputs["x"] = np.where(np.arange(len(made.time)) % every == 0, outputs["x"], np.nan)
    read = [replace(recording, name=f"axis {n}", outputs=outputs, output_std=noise) for n in range(times)]
    problem = replace(problem, model=model, recordings=read)
    base = Linearised(smooth(problem).solution)
    some = [c for c in library(problem, problem.model, base.solution) if c.physics in WANTED and not c.dear]
    found = screen(base, looked_at(problem, problem.model, base, some))
    return problem, base, {s.candidate.physics: s for s in found.found}


def of_strength(s: Screened, strength: float) -> Screened:
    return replace(s, estimate=np.full(len(s.estimate), strength))


def test_nats_with_a_sensor_are_those_of_a_recording_that_has_it():
    problem, base, found = looked()
    _, there, again = looked(faster=True)
    (sensor,) = sensors(base.solution, measurable(problem.dae))
    assert sensor.of == "carriage.v"  # of the position there is one
    sensor = replace(sensor, rows=sensor.rows * (sensor.noise / V_NOISE))
    without, had = (Told(b, of_strength(f["spring"], 200.0), [f["cubic_spring"]]) for b, f in ((base, found), (there, again)))
    (alone,), (more,), (true,) = without.nats, without.with_sensor(sensor), had.nats
    assert more > 1.3 * alone
    assert more == pytest.approx(true, rel=0.02)


def test_of_what_nobody_recorded_there_may_be_a_sensor_though_the_model_has_the_output():
    _, base, _ = looked()
    problem, mute, _ = looked(mute=True)
    (alone,), (more,) = (sensors(b.solution, measurable(problem.dae)) for b in (base, mute))
    assert (more.of, more.noise) == ("carriage.v", pytest.approx(alone.noise, rel=1e-3))
    assert sensors(mute.solution, ["carriage.v"], ["x"])[1].noise == pytest.approx(NOISE)


def test_one_more_sensor_has_as_many_samples_as_there_are():
    _, base, _ = looked(every=20)
    velocity, again = sensors(base.solution, ["carriage.v"], ["x"])
    assert velocity.rows.shape[0] == again.rows.shape[0] == 25


def test_twice_as_much_of_the_same_brings_twice_as_much():
    (_, base, found), (_, there, again) = looked(), looked(times=2)
    once, twice = (Told(b, of_strength(f["spring"], 200.0), [f["cubic_spring"]]).nats[0] for b, f in ((base, found), (there, again)))
    assert twice == pytest.approx(2.0 * once, rel=0.02)


def test_an_offset_of_an_input_and_a_force_are_told_apart_by_a_sensor_of_the_input_alone():
    problem, base, found = looked()
    offset, force = of_strength(found["input_offset"], 20.0), of_strength(found["constant_force"], 20.0)
    nothing = Told(base, force, [found["cubic_spring"]])
    told = separating(base, force, [offset], measurable(problem.dae))
    (nats,) = re.fullmatch(r"a sensor of F as it acts \((.*) nats\)", told).groups()
    assert float(nats) > nothing.nats[0]  # what is left where nothing stands for it is the most there is
    assert float(nats) == pytest.approx(nothing.alone, rel=0.01)
    assert separating(base, offset, [force], measurable(problem.dae)) == "a sensor of F as it acts"  # and how well hangs on it
    zone = found["input_dead_zone"]
    weaker = of_strength(offset, float(np.sqrt(0.5 * ENOUGH / Told(base, of_strength(offset, 1.0), [zone]).nats[0])))
    assert separating(base, weaker, [zone], measurable(problem.dae)).startswith("a sensor of F as it acts or ")


def test_it_says_where_neither_a_sensor_nor_more_of_the_same_would_do_and_nothing_where_there_is_nothing_to_tell():
    problem, base, found = looked()
    force, other = of_strength(found["constant_force"], 20.0), replace(found["constant_force"], estimate=np.ones(1))
    assert separating(base, force, [other], measurable(problem.dae)) == NOTHING
    weak, strong = (of_strength(found["spring"], k) for k in (1e-3, 1e4))
    assert separating(base, weak, [found["cubic_spring"]], measurable(problem.dae)) == ""
    assert separating(base, strong, [found["cubic_spring"]], measurable(problem.dae)) == ""
    assert separating(base, strong, [], measurable(problem.dae)) == ""


def test_longer_recordings_are_those_that_would_be_enough_for_what_was_fitted():
    problem, base, found = looked()
    spring, rival, states = found["spring"], found["cubic_spring"], measurable(problem.dae)
    k = float(np.sqrt(0.7 * ENOUGH / Told(base, of_strength(spring, 1.0), [rival]).nats[0]))  # of which they tell seven tenths of enough
    assert separating(base, of_strength(spring, k), [rival], states).endswith("recordings 1.5 times as long in all")
    assert separating(base, spring, [rival], states, np.array([k])) == separating(base, of_strength(spring, k), [rival], states)
    coloured = replace(of_strength(spring, k), inflation=2.0)
    assert separating(base, coloured, [rival], states).endswith("recordings 2.9 times as long in all")
