"""Recordings that stop and go on later."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.recordings.delay import moved
from backsight.estimation.recordings.gaps import gap_note, lost_note
from backsight.models.errors import InputError

MODEL, PLANT, STD = compiled(oscillator()), truths.Plant(m=M, d=D, k=K, offset=OFFSET), 1e-3
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}


def interrupted(rows: slice = slice(200, 330), n: int = 500) -> tuple[Recording, np.ndarray]:
    """Five seconds of which nobody recorded 1.3; the input goes on in between. And the states of the rows that are left."""
    rng = np.random.default_rng(3)
    time, u = 0.01 * np.arange(n), 20 * np.sign(np.sin(np.arange(n) * 0.0483)) + 10 * np.repeat(rng.normal(size=n // 10), 10)
    x = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), 0.1, rng)
    y = x[:, 0] + STD * rng.normal(size=n)
    kept = np.setdiff1d(np.arange(n), np.arange(n)[rows])
    return Recording(name="run", time=time[kept], inputs={"F": u[kept]}, outputs={"x": y[kept]}, output_std={"x": STD}), x[kept]


def fitted(recordings: list[Recording], **more) -> Smoothing:
    s = smooth(Problem(model=MODEL, recordings=recordings, parameters=FREE, weights=Weights(W={"mass": 0.1}), **more))
    assert s.solver.converged
    return s


def scores(s: Smoothing) -> np.ndarray:
    return np.array([(s.parameters[n].value - v) / s.parameters[n].std for n, v in TRUE.items()])


def test_a_recording_with_a_gap_is_fitted_as_two_recordings_and_shown_as_one():
    whole, states = interrupted()
    halves = [
        Recording(name=name, time=whole.time[part], inputs={"F": whole.inputs["F"][part]}, outputs={"x": whole.outputs["x"][part]},
                  output_std={"x": STD})
        for name, part in (("a", slice(0, 200)), ("b", slice(200, None)))
    ]  # fmt: skip
    one, two = fitted([whole]), fitted(halves)
    for name in TRUE:
        assert one.parameters[name].value == pytest.approx(two.parameters[name].value, rel=1e-9)
        assert one.parameters[name].std == pytest.approx(two.parameters[name].std, rel=1e-9)
    table = one.estimates["run"]
    assert list(one.estimates) == ["run"]
    assert np.array_equal(table["t_s"], whole.time)
    both = np.concatenate([two.estimates[k]["mass.v"] for k in ("a", "b")])
    np.testing.assert_allclose(table["mass.v"], both, rtol=1e-9)
    assert np.mean(np.abs(table["mass.s"] - states[:, 0]) < 1.96 * table["mass.s.std"]) > 0.85
    assert one.fit["run"]["x"].rms == pytest.approx(STD, rel=0.2)
    assert len(one.inputs["run"]["F"]) == len(whole.time)
    assert any(re.search(r"run has a gap of more than 0.2 s .*1.31 s after t = 1.99 s.*2 pieces", note) for note in one.notes)


def test_the_input_that_nobody_saw_in_the_gap_spoils_nothing():
    whole, _ = interrupted()
    assert np.all(np.abs(scores(fitted([whole]))) < 3)
    # taken through the gap with the last input held, the parameters are far off
    assert np.max(np.abs(scores(fitted([replace(whole, gap=10.0)])))) > 10


def test_what_is_known_of_the_start_is_not_known_of_a_later_piece():
    whole, states = interrupted()
    table = fitted([whole], initial={"mass.s": 0.02, "mass.v": -0.1}).estimates["run"]
    assert table["mass.s"].iloc[0] == pytest.approx(0.02, abs=1e-9)
    assert abs(table["mass.s"].iloc[200] - states[200, 0]) < 4 * table["mass.s.std"].iloc[200]
    assert table["mass.s.std"].iloc[200] > 1e-4


def test_a_row_without_neighbours_is_left_out_and_its_estimates_are_missing():
    whole, _ = interrupted()
    time = np.append(whole.time, 9.0)
    lonely = Recording(
        name="run", time=time, inputs={"F": np.append(whole.inputs["F"], 0.0)}, outputs={"x": np.append(whole.outputs["x"], 0.5)},
        output_std={"x": STD},
    )  # fmt: skip
    s, without = fitted([lonely]), fitted([whole])
    assert s.parameters["mass.m"].value == pytest.approx(without.parameters["mass.m"].value, rel=1e-9)
    last = s.estimates["run"].iloc[-1]
    assert (last["t_s"], last["x.measured"]) == (9.0, 0.5)
    assert np.isnan(last[["x", "mass.s", "residual.mass"]].to_numpy(dtype=float)).all()
    assert np.isfinite(s.residual_places["mass"].rms)
    assert s.fit["run"]["x"].rms == pytest.approx(without.fit["run"]["x"].rms, rel=1e-9)
    assert any("1 row without a neighbour" in note for note in s.notes)


def test_pieces_are_cut_where_the_step_is_longer_than_the_gap():
    time = np.concatenate([np.arange(10) * 0.1, 1.5 + np.arange(10) * 0.1])
    r = Recording(name="a", time=time, inputs={"F": time}, outputs={"x": time})
    assert len(r.pieces) == 1  # 0.6 s is six intervals
    assert gap_note(r) is None
    parts = replace(r, gap=0.5).pieces
    assert [(p.part, len(p.time), p.time[0], p.title) for p in parts] == [(0, 10, 0.0, "a"), (1, 10, 1.5, "a from t = 1.5 s")]
    assert all(len(p.pieces) == 1 for p in parts)


def test_sensors_with_clocks_of_their_own_are_joined_and_not_cut_between_their_rows():
    rng, clock = np.random.default_rng(0), 0.01 * np.arange(300)
    time = np.sort(np.concatenate([clock, clock + 3e-4]))
    odd = np.arange(600) % 2 == 1
    noise = rng.normal(size=600)
    r = Recording(name="a", time=time, inputs={"F": time}, outputs={"x": np.where(odd, np.nan, noise), "v": np.where(odd, noise, np.nan)})
    assert r.pieces == (r,)
    # of 0.3 s without a row, thirty intervals of either sensor, nobody knows the input
    later = replace(r, time=np.where(np.arange(600) < 300, time, time + 0.3))
    assert [len(p.time) for p in later.pieces] == [300, 300]


def test_a_sensor_far_slower_than_the_rows_does_not_hide_a_gap():
    time = 0.001 * np.arange(4000)
    time[2000:] += 1.0
    rare = np.where(np.arange(4000) % 1000 == 0, 1.0, np.nan)
    r = Recording(name="a", time=time, inputs={"F": time}, outputs={"x": time, "rare": rare})
    assert [len(p.time) for p in r.pieces] == [2000, 2000]


def test_a_piece_without_a_sample_of_an_output_is_left_out():
    time = np.concatenate([np.arange(10) * 0.1, 5 + np.arange(10) * 0.1])
    y, v = time.copy(), time.copy()
    y[10:], v[:10] = np.nan, np.nan
    r = Recording(name="a", time=time, inputs={"F": time}, outputs={"x": y, "v": v})
    assert [list(p.outputs) for p in r.pieces] == [["x"], ["v"]]
    assert len(Recording(name="a", time=time, inputs={"F": time}, outputs={"x": y}).pieces) == 1


def test_a_gap_no_longer_than_the_sampling_interval_is_refused():
    time = np.arange(10) * 0.1
    with pytest.raises(InputError, match=r"gap = 0.05 s would cut between all rows; .* 0.1 s"):
        Recording(name="a", time=time, inputs={"F": time}, outputs={"x": time}, gap=0.05)


def test_rows_that_are_missing_from_an_even_clock_are_said_and_an_uneven_clock_is_not_accused():
    time = 0.01 * np.arange(200)
    even = Recording(name="run", time=time, inputs={"F": 0 * time}, outputs={"x": 0 * time})
    assert lost_note(even) is None
    kept = np.delete(np.arange(200), [50, 120, 121])
    said = lost_note(replace(even, time=time[kept], inputs={"F": time[kept]}, outputs={"x": time[kept]}))
    assert said is not None
    assert said.startswith("run: 3 rows are missing, the first after t = 0.49 s; its inputs are taken to keep their value")
    uneven = np.cumsum(np.random.default_rng(1).uniform(0.005, 0.03, 200))
    assert lost_note(replace(even, time=uneven)) is None
    # samples that a delay moved keep the inputs on their own clock, which lacks the same rows
    late = moved(replace(even, time=time[kept], inputs={"F": time[kept]}, outputs={"x": time[kept]}), {"x": 0.003})
    assert late.drive is not None
    assert lost_note(late) == said
