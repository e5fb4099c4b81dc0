"""What blocks with memory hold at first: of the size of their signal, in whatever the fit begins from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.channels import of_alike, of_input, of_sensor
from backsight.estimation.diagnosis.candidates.memory import remembered
from backsight.estimation.diagnosis.search.refit import posed
from backsight.estimation.problem import Known
from backsight.estimation.smoothing.begun import Begun
from backsight.estimation.smoothing.smoother import Settings
from backsight.models.plants import PLANTS, actuator

T = 0.01 * np.arange(400)
FORCE = 3.0 + 5.0 * np.sign(np.sin(4.0 * T))
MODEL = actuator()


def recorded(role: str = "fit", *, force: np.ndarray = FORCE) -> Recording:
    x = 0.5 + 0.1 * np.sin(4.0 * T)
    return Recording(name=role, time=T, inputs={"F": force}, outputs={"x": np.where(T < 1, np.nan, x)}, output_std={"x": 1e-3}, role=role)


def machine(*recordings: Recording) -> Problem:
    known = {"friction.f_c": 0.0, "offset.f": 0.0}
    return Problem(model=MODEL, recordings=recordings, parameters={**known, "carriage.m": Free(90.0), "friction.d": Free(200.0)})


def one(physics: str) -> list[Candidate]:
    return [c for c in (*of_input(MODEL, "F", [FORCE], 0.01, 4.0), *of_sensor(MODEL, "x", [], 0.01, 4.0)) if c.physics == physics]


def test_a_delay_holds_anything_of_the_size_of_its_signal():
    problem = machine(recorded(), recorded("held_out"))
    (delay,), (lag,), (late,) = one("input_delay"), one("input_lag"), one("sensor_delay")
    assert remembered(problem, delay) == {f"input_delay_F.x_{k + 1}": Known((3.0, 0, 0)[k], 5.0 * 3.0**k, always=True) for k in range(3)}
    assert remembered(problem, lag) == {"input_lag_F.y": Known(3.0, 5.0, always=True)}
    first = remembered(problem, late)["sensor_delay_x.x_1"]  # samples that are missing tell nothing
    assert (first.value, first.std) == (pytest.approx(0.5, abs=1e-3), pytest.approx(0.1, abs=1e-3))


def test_of_a_signal_that_has_one_value_it_holds_as_much_and_of_none_nothing():
    (lag,) = one("input_lag")
    assert remembered(machine(recorded(force=np.full(400, -2.0))), lag) == {"input_lag_F.y": Known(-2.0, 2.0, always=True)}
    assert remembered(machine(recorded(force=np.zeros(400))), lag) == {}
    assert remembered(machine(recorded()), one("input_gain")[0]) == {}


def test_delays_alike_remember_each_their_own_signal():
    t, names = 0.01 * np.arange(50), ["u_1", "u_2", "u_3", "u_4"]
    inputs = {name: k + np.sin(9 * t) for k, name in enumerate(names)}
    run = Recording(name="flight", time=t, inputs=inputs, outputs={"p": 0 * t}, output_std={"p": 1e-3})
    model = PLANTS["quadrotor"]()
    delay = next(c for c in of_alike(model, names, 0.01, 0.5) if c.physics == "input_delay")
    found = remembered(Problem(model=model, recordings=[run]), delay)
    assert [found[f"input_delay_{name}.x_1"].value for name in names] == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=0.03)
    assert len(found) == 12


def test_a_fit_that_begins_at_a_solution_without_the_delay_knows_it_too():
    v, x = np.zeros(len(T)), np.zeros(len(T))
    for k, h in enumerate(np.diff(T)):
        end = FORCE[k] / 200.0
        v[k + 1] = end + (v[k] - end) * np.exp(-h * 200.0 / 90.0)
        x[k + 1] = x[k] + end * h + (v[k] - v[k + 1]) * 90.0 / 200.0
    run = recorded()
    problem = machine(replace(run, outputs={"x": x + 1e-5 * np.random.default_rng(0).normal(size=len(T))}, output_std={"x": 1e-5}))
    base = smooth(problem, settings=Settings(check_mesh=False)).solution
    now, _ = posed(problem, MODEL, one("input_delay")[0], {})
    begun = Begun.of(base, now)
    (horizon,), states = begun.followed.horizons, [q.name for q in now.plain.dae.states]
    known = dict(zip(states, zip(horizon.initial.tolist(), horizon.initial_std.tolist(), strict=True), strict=True))
    assert known["input_delay_F.x_1"] == (pytest.approx(3.0), pytest.approx(5.0))
    assert known["carriage.v"] == (0.0, np.inf)
