"""Windows predicted in one batch, against the simulator that locates every event and against formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from one_dimensional import body_with

from backsight.data.generators import actuator as machine
from backsight.data.generators import xy_table as table
from backsight.data.generators.run import Conditions
from backsight.estimation import Recording
from backsight.estimation.diagnosis.proof import steps as steps_of
from backsight.estimation.diagnosis.proof.steps import Step
from backsight.estimation.diagnosis.proof.windows import Starts, ahead
from backsight.models import compile_model, simulate
from backsight.models.mechanics.translational import Drag, Spring
from backsight.models.plants import actuator, xy_table

ROWS = 250


@pytest.fixture(scope="module")
def axis() -> tuple:
    """An axis that sticks, with its true states, from a simulator that shares nothing with this project's."""
    conditions = Conditions(duration=2.0, step=1e-3, noise={"x": 1e-9})
    run = machine.record(machine.Carriage(f_c=150.0, f_0=0.0), seed=5, conditions=conditions, along="strokes")
    piece = Recording(name="axis", time=run.time, inputs=run.inputs, outputs=run.outputs, output_std={"x": 1e-9})
    return run, piece


def started(dae, run, rows, values: dict, width: float = 1e-6) -> Starts:
    rounded = {p.name: width for p in dae.parameters if p.smoothing}
    p = np.array(dae.parameter_values({**values, **rounded}))
    x = np.array([run.truth[q.name][rows] for q in dae.states])
    nothing = np.zeros((len(dae.algebraics), len(rows)))
    return Starts(rows=rows, x=x, rates=np.zeros_like(x), z=nothing, parameters=np.repeat(p[:, None], len(rows), axis=1))


def test_an_axis_that_sticks_is_predicted_like_the_machine_itself_and_like_the_simulator_that_locates_events(axis):
    run, piece = axis
    dae, rows = compile_model(actuator()), np.arange(50, 1700, 37)
    values = {"carriage.m": 95.109, "friction.d": 203.5, "friction.f_c": 150.0, "offset.f": 0.0}
    v = run.truth["carriage.v"]
    assert np.mean(v == 0) > 0.02  # it rests, truly
    assert np.sum(np.diff(np.sign(v)) != 0) > 3
    predicted = ahead(dae, piece, started(dae, run, rows, values), ROWS, np.array([0.05, 0.2]))[0]
    truth = run.truth["clean.x"]
    at = rows[:, None] + np.arange(ROWS + 1)
    there = at < len(truth)
    assert np.array_equal(np.isfinite(predicted), there)
    error = np.where(there, predicted - truth[np.minimum(at, len(truth) - 1)], 0.0)
    travelled = np.sqrt(np.mean((truth - truth.mean()) ** 2))
    assert np.abs(error).max() < 2e-4 * travelled
    assert np.sqrt(np.mean(error**2)) < 3e-5 * travelled
    for j in (0, 20):
        k = slice(rows[j], rows[j] + ROWS + 1)
        start = {q.name: float(run.truth[q.name][rows[j]]) for q in dae.states}
        exact = simulate(dae, run.time[k], {"F": run.inputs["F"][k]}, parameters=values, initial=start)
        assert predicted[j, : ROWS + 1] == pytest.approx(exact.outputs["x"], abs=1e-4 * travelled)


def test_a_window_that_ends_in_a_singularity_is_given_up_there_and_the_others_go_on(monkeypatch):
    """Drag with the wrong sign, v' = c v^2/m: v = v_0/(1 - c v_0 t/m) ends at t = m/(c v_0)."""
    m, c, steps, dt = 2.0, 1.0, 200, 0.01
    dae = compile_model(replace(body_with(Drag(), mass=m), outputs={"s": "body.s"}))
    piece = Recording(name="run", time=dt * np.arange(steps + 1), inputs={"F": np.zeros(steps + 1)}, outputs={"s": np.zeros(steps + 1)})
    speeds = np.array([0.5, 1.6])  # the one ends at 4 s, the other at 1.25 s
    names = [q.name for q in dae.states]
    x = np.zeros((2, 2))
    x[names.index("body.v")] = speeds
    p = np.repeat(np.array(dae.parameter_values({"element.c": -c}))[:, None], 2, axis=1)
    nothing = np.zeros((len(dae.algebraics), 2))
    starts = Starts(rows=np.zeros(2, dtype=np.int64), x=x, rates=np.zeros_like(x), z=nothing, parameters=p)
    called, stages = [], Step._stages
    monkeypatch.setattr(Step, "_stages", lambda *args: called.append(1) or stages(*args))
    predicted = ahead(dae, piece, starts, steps, np.ones(2))[0]
    slow = m / c * -np.log(1.0 - c * speeds[0] * piece.time / m)
    assert predicted[0] == pytest.approx(slow, rel=1e-4, abs=1e-6)
    fast = m / c * -np.log(np.maximum(1.0 - c * speeds[1] * piece.time / m, 1e-9))
    assert predicted[1, :120] == pytest.approx(fast[:120], rel=1e-3, abs=1e-6)
    assert np.isnan(predicted[1, 130:]).all()
    assert len(called) < 20 * steps  # halves of what has no start, or goes on behind the end, are thousands in every row


@pytest.mark.slow
def test_a_table_with_algebraic_forces_and_accelerometers_is_predicted_to_a_share_of_its_noise():
    conditions = replace(table.CONDITIONS, duration=1.5, process={})
    run = table.record(table.Table(), seed=2, conditions=conditions)
    piece = Recording(name="table", time=run.time, inputs=run.inputs, outputs=run.outputs)
    dae, rows = compile_model(xy_table()), np.arange(20, 600, 29)
    starts = started(dae, run, rows, table_values(dae), 1e-5)
    size = np.array([np.std(run.truth[q.name]) or 1.0 for q in dae.states])
    predicted = ahead(dae, piece, starts, 100, size)
    for i, q in enumerate(dae.outputs):
        truth = run.truth[f"clean.{q.name}"][rows[:, None] + np.arange(101)]
        error = np.sqrt(np.nanmedian((predicted[i] - truth) ** 2))
        assert error < 0.1 * conditions.noise[q.name], q.name


def table_values(dae) -> dict[str, float]:
    machine_ = table.Table()
    return {p.name: float(getattr(machine_, table.NAMES[p.name])) for p in dae.parameters if p.name in table.NAMES}


def test_an_uneven_clock_and_inputs_that_run_straight_are_followed_exactly():
    """A mass under a ramp: x = v t + a t^2/2 + j t^3/6."""
    dae = compile_model(actuator())
    time = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.03, 60))
    piece = Recording(name="ramp", time=time, inputs={"F": 2.0 + 3.0 * time}, outputs={"x": np.zeros(60)}, hold="linear")
    values = {"carriage.m": 2.0, "friction.d": 0.0, "friction.f_c": 0.0, "offset.f": 0.0}
    rows = np.array([0, 7])
    x = np.array([[0.1, 0.2], [-0.3, 0.4]])
    p = np.repeat(np.array(dae.parameter_values(values))[:, None], 2, axis=1)
    starts = Starts(rows=rows, x=x, rates=np.zeros((2, 2)), z=np.zeros((len(dae.algebraics), 2)), parameters=p)
    found = ahead(dae, piece, starts, 20, np.ones(2))[0]
    for j, row in enumerate(rows):
        t = time[row : row + 21] - time[row]
        force = 2.0 + 3.0 * time[row]
        assert found[j] == pytest.approx(x[0, j] + x[1, j] * t + force / 4 * t**2 + 3.0 / 12 * t**3, abs=1e-12)


def test_a_machine_that_swings_too_fast_is_predicted_for_as_long_as_its_steps_last_and_slower_ones_beside_it_to_the_end(monkeypatch):
    """Masses on springs of 5000, 60 and 5 rad/s: s = s_0 cos(omega t)."""
    monkeypatch.setattr(steps_of, "MOST", 1000)
    rows, dt, s_0, omega = 40, 0.02, 1e-3, np.array([5000.0, 60.0, 5.0])
    dae = compile_model(replace(body_with(Spring(), mass=2.0), outputs={"s": "body.s"}))
    time = dt * np.arange(rows + 1)
    piece = Recording(name="run", time=time, inputs={"F": np.zeros(rows + 1)}, outputs={"s": np.zeros(rows + 1)})
    p = np.repeat(np.array(dae.parameter_values())[:, None], 3, axis=1)
    p[[q.name for q in dae.parameters].index("element.k")] = 2.0 * omega**2
    x = np.zeros((2, 3))
    x[[q.name for q in dae.states].index("body.s")] = s_0
    size = np.array([{"body.s": s_0, "body.v": s_0 * omega[0]}[q.name] for q in dae.states])
    starts = Starts(rows=np.zeros(3, dtype=np.int64), x=x, rates=np.zeros_like(x), z=np.zeros((len(dae.algebraics), 3)), parameters=p)
    fast, moderate, slow = ahead(dae, piece, starts, rows, size)[0]
    assert slow == pytest.approx(s_0 * np.cos(omega[2] * time), abs=1e-3 * s_0)
    assert moderate == pytest.approx(s_0 * np.cos(omega[1] * time), abs=0.02 * s_0)
    lasted = np.flatnonzero(np.isfinite(fast))
    assert 1 <= len(lasted) < 10
    assert np.array_equal(lasted, np.arange(len(lasted)))
    assert fast[lasted] == pytest.approx(s_0 * np.cos(omega[0] * time[lasted]), abs=0.1 * s_0)
