"""Recordings as the arrays of a horizon."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import compiled, lagged

from backsight.data.generators import xy_table
from backsight.estimation import Known, Problem, Recording, Weights
from backsight.estimation.smoothing.horizons import make_horizon, output_stds, sample_density, sampling_interval, shown_noise
from backsight.models.plants import PLANTS

DAE = compiled(lagged())


def recording(clock: float = 0.0, **more) -> Recording:
    n = 101
    rng = np.random.default_rng(0)
    time = clock + np.arange(n) * 0.01
    y = np.sin(np.arange(n) * 0.05) + 1e-2 * rng.normal(size=n)
    return Recording(**{"name": "run", "time": time, "inputs": {"F": np.arange(n) * 1.0}, "outputs": {"v": y}, **more})


def test_arrays_are_in_the_models_order_and_what_was_not_measured_is_missing():
    h = make_horizon(DAE, recording(hold="linear"), {"v": 0.3}, {"mass.v": Known(2.0)}, 0.05)
    assert np.isnan(h.target[:, 0]).all()
    assert np.array_equal(h.target[:, 1], recording().outputs["v"])
    assert np.all(h.target_std[:, 1] == 0.3)
    assert h.hold == "linear"
    assert h.inputs[:, 0].tolist() == list(np.arange(101.0))
    assert (h.initial.tolist(), h.initial_std.tolist()) == ([0.0, 0.0, 2.0], [np.inf, np.inf, 0.0])
    assert h.mesh.count == 20


def test_time_counts_from_the_recordings_start():
    h = make_horizon(DAE, recording(clock=1.7e9), {"v": 0.3}, {}, 0.05)
    assert h.time[0] == 0.0
    np.testing.assert_allclose(h.time, np.arange(101) * 0.01, atol=3e-7)  # what a double near 1.7e9 keeps


def test_a_deviation_comes_from_v_else_from_the_recording_else_from_the_samples():
    own = recording(output_std={"v": 0.2})
    assert output_stds(Problem(model=DAE, recordings=[own], weights=Weights(V={"v": 0.5}))) == ([{"v": 0.5}], [set()])
    assert output_stds(Problem(model=DAE, recordings=[own])) == ([{"v": 0.2}], [set()])
    tables, chosen = output_stds(Problem(model=DAE, recordings=[recording()]))
    assert chosen == [{"v"}]
    assert tables[0]["v"] == pytest.approx(1e-2, rel=0.25)


def test_the_models_own_noise_stands_where_the_samples_are_too_few_to_tell():
    sensor = replace(DAE, outputs=tuple(replace(q, noise_std=0.07) for q in DAE.outputs))
    y = np.full(101, np.nan)
    y[::12] = np.linspace(0.0, 1.0, 9)
    assert output_stds(Problem(model=sensor, recordings=[recording(outputs={"v": y})]))[0][0]["v"] == 0.07
    assert output_stds(Problem(model=sensor, recordings=[recording()]))[0][0]["v"] == pytest.approx(1e-2, rel=0.25)


def test_an_output_that_rests_in_one_recording_has_the_noise_that_the_others_show():
    moving, still = recording(), recording(name="still", outputs={"v": np.full(101, 1e-3)})
    tables, chosen = output_stds(Problem(model=DAE, recordings=[still, moving]))
    assert tables[0] == tables[1]
    assert tables[1]["v"] == pytest.approx(1e-2, rel=0.25)
    assert chosen == [set(), {"v"}]  # what the fit leaves over where nothing moves is no noise
    third = recording(name="third", output_std={"v": 0.2})
    tables, chosen = output_stds(Problem(model=DAE, recordings=[still, moving, third]))
    assert tables[0]["v"] == pytest.approx(np.sqrt((tables[1]["v"] ** 2 + 0.2**2) / 2))
    assert output_stds(Problem(model=DAE, recordings=[still, moving], weights=Weights(V={"v [still]": 0.5})))[0][0] == {"v": 0.5}


def test_an_output_that_rests_throughout_has_the_noise_that_the_model_supposes():
    sensor = replace(DAE, outputs=tuple(replace(q, noise_std=0.07) for q in DAE.outputs))
    still = recording(outputs={"v": np.full(101, 1e-3)})
    assert output_stds(Problem(model=sensor, recordings=[still])) == ([{"v": 0.07}], [set()])
    tables, chosen = output_stds(Problem(model=DAE, recordings=[still]))  # which `check_varies` refuses
    assert tables[0]["v"] > 0
    assert chosen == [{"v"}]


def test_the_density_of_samples_counts_those_that_are_there():
    y = np.ones(101)
    y[1::2] = np.nan
    density = sample_density(DAE, recording(outputs={"v": y}), {"v": 0.1})
    assert density[0] == np.inf
    assert density[1] == pytest.approx(0.01 * 1.0 / 51)


def test_the_sampling_interval_is_the_median():
    assert sampling_interval(recording(time=np.concatenate([np.arange(100) * 0.01, [50.0]]))) == pytest.approx(0.01)


def test_an_encoder_shows_its_noise_and_an_accelerometer_shows_the_forces_it_reads():
    run = xy_table.record(seed=1, conditions=replace(xy_table.CONDITIONS, duration=1.0))
    recording = Recording(name="run", time=run.time, inputs=run.inputs, outputs=run.outputs)
    problem = Problem(model=PLANTS["xy_table"](), recordings=[recording])
    shown = dict(zip((q.name for q in problem.dae.outputs), shown_noise(problem)[0][0], strict=True))
    for name, std in run.noise.items():
        assert shown[name] == (0.0 if name.startswith("a") else pytest.approx(std, rel=0.15))
