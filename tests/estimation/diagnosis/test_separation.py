"""What would tell two explanations apart, against recordings that have the sensor, and longer ones."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Problem, smooth
from backsight.estimation.diagnosis.library import library
from backsight.estimation.diagnosis.score import Linearised
from backsight.estimation.diagnosis.screen import Screened, screen
from backsight.estimation.diagnosis.separation import ENOUGH, NOTHING, Told, sensors, separating
from backsight.estimation.diagnosis.supermodel import looked_at

WANTED = ("constant_force", "input_offset", "cubic_spring", "spring")
NOISE, V_NOISE = 1e-3, 1e-3  # m, m/s


@cache
def looked(faster: bool = False, times: int = 1) -> tuple[Problem, Linearised, dict[str, Screened]]:
    """The model linearised, and candidates scored there, by their physics. faster: the velocity is measured too; times: it was recorded."""
    made = run(1.0, step=2e-3, seed=3)
    problem = posed(made)
    (recording,) = problem.recordings
    outputs, noise, model = dict(recording.outputs), {"x": NOISE}, problem.model
    if faster:
        outputs["v"] = made.truth["carriage.v"] + V_NOISE * np.random.default_rng(7).standard_normal(len(made.time))
        noise["v"], model = V_NOISE, replace(model, outputs={**model.outputs, "v": "carriage.v"})
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
    (sensor,) = sensors(base.solution, [q.name for q in problem.dae.states])
    assert sensor.of == "carriage.v"  # of the position there is one
    sensor = replace(sensor, rows=sensor.rows * (sensor.noise / V_NOISE))
    without, had = (Told(b, of_strength(f["spring"], 200.0), [f["cubic_spring"]]) for b, f in ((base, found), (there, again)))
    (alone,), (more,), (true,) = without.nats, without.with_sensor(sensor), had.nats
    assert more > 1.3 * alone
    assert more == pytest.approx(true, rel=0.02)


def test_twice_as_much_of_the_same_brings_twice_as_much():
    (_, base, found), (_, there, again) = looked(), looked(times=2)
    once, twice = (Told(b, of_strength(f["spring"], 200.0), [f["cubic_spring"]]).nats[0] for b, f in ((base, found), (there, again)))
    assert twice == pytest.approx(2.0 * once, rel=0.02)


def test_an_offset_of_an_input_and_a_force_are_told_apart_by_a_sensor_of_the_input_alone():
    problem, base, found = looked()
    offset, force = of_strength(found["input_offset"], 20.0), of_strength(found["constant_force"], 20.0)
    for best, rival in ((offset, force), (force, offset)):
        told = separating(base, best, [rival], [q.name for q in problem.dae.states])
        (nats,) = re.fullmatch(r"a sensor of what F really does \((.*) nats\)", told).groups()
        alone = Told(base, best, [found["cubic_spring"]])
        assert float(nats) > alone.nats[0]  # what is left where nothing stands for it is the most there is
        assert float(nats) > ENOUGH


def test_it_says_where_neither_a_sensor_nor_more_of_the_same_would_do_and_nothing_where_nobody_asks():
    problem, base, found = looked()
    states = [q.name for q in problem.dae.states]
    weak, strong = (of_strength(found["spring"], k) for k in (1e-3, 1e4))
    assert separating(base, weak, [found["cubic_spring"]], states) == NOTHING
    assert separating(base, strong, [found["cubic_spring"]], states) == ""
    assert separating(base, strong, [], states) == ""


def test_the_sensor_that_brings_most_comes_first_and_longer_recordings_last():
    problem, base, found = looked()
    rival = found["cubic_spring"]
    unit = Told(base, of_strength(found["spring"], 1.0), [rival])
    k = float(np.sqrt(0.7 * ENOUGH / unit.nats[0]))  # of which these recordings tell seven tenths of enough
    told = separating(base, of_strength(found["spring"], k), [rival], [q.name for q in problem.dae.states])
    assert told.endswith("1.4 times as much of such recordings")
