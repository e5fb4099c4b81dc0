"""Samples moved back in time."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation import OutputColumn, Recording
from backsight.estimation.recordings.delay import between_rows, moved
from backsight.estimation.recordings.drive import Drive, drive_of

TIME = 0.01 * np.arange(50)
Y = np.random.default_rng(0).normal(size=50)


def recording(y: np.ndarray = Y, time: np.ndarray = TIME, **more: np.ndarray) -> Recording:
    return Recording(name="a", time=time, inputs={"F": np.cos(time)}, outputs={"x": y, **more})


def test_whole_intervals_move_samples_as_they_are():
    y = np.where(np.arange(50) == 7, np.nan, Y)
    r = moved(recording(y), {"x": 0.05})
    np.testing.assert_array_equal(r.time, TIME)
    np.testing.assert_array_equal(r.outputs["x"][:45], y[5:])
    assert np.isnan(r.outputs["x"][45:]).all()
    assert r.drive is None


@pytest.mark.parametrize("delay", [0.0137, 0.004])
@pytest.mark.parametrize("kind", ["even", "every other", "jittered"])
def test_between_the_rows_every_sample_has_a_time_of_its_own(delay, kind):
    time = TIME + (0.003 * np.random.default_rng(1).uniform(-1, 1, size=50) if kind == "jittered" else 0.0)
    y = np.where(np.arange(50) % 2 == 0, Y, np.nan) if kind == "every other" else Y
    r = moved(recording(y, time), {"x": delay})
    seen = np.isfinite(y) & (time - delay >= time[0])
    np.testing.assert_allclose(r.time, time[seen] - delay, atol=1e-15)
    np.testing.assert_array_equal(r.outputs["x"], Y[seen])
    # the inputs keep their clock
    inside = np.isin(drive_of(r).time, time)
    assert inside.all()
    np.testing.assert_array_equal(drive_of(r).inputs["F"], np.cos(drive_of(r).time))


def test_a_sensor_that_does_not_lag_keeps_its_rows():
    r = moved(recording(v=2 * Y), {"x": 0.004})
    own = np.isin(r.time, TIME)
    np.testing.assert_array_equal(r.outputs["v"][own], 2 * Y)
    assert np.isnan(r.outputs["v"][~own]).all()
    np.testing.assert_array_equal(r.outputs["x"][~own], Y[1:])


def test_a_sample_moved_into_a_gap_is_lost():
    time = np.where(np.arange(50) < 25, TIME, TIME + 1.0)
    r = moved(recording(time=time), {"x": 0.025})
    assert len(r.pieces) == 2
    later = r.pieces[1]
    assert later.time[0] >= time[25]
    np.testing.assert_array_equal(later.outputs["x"], Y[28:])


def test_between_rows_held_inputs_push_as_on_their_own_clock():
    drive = Drive(TIME, {"F": Y})
    rows = np.array([0.003, 0.0215, 0.04, 0.133])
    found = between_rows(drive, rows, "zero")["F"]
    fine = np.arange(0.003, 0.133, 1e-6) + 5e-7
    held = Y[np.searchsorted(TIME, fine, side="right") - 1]
    for k in range(3):
        assert found[k] == pytest.approx(held[(fine > rows[k]) & (fine < rows[k + 1])].mean(), rel=1e-3)


@pytest.mark.parametrize("delay", [0.02, 0.005])
def test_a_file_with_a_sensor_in_every_other_row_keeps_all_its_samples(tmp_path, delay):
    y = np.where(np.arange(50) % 2 == 0, Y, np.nan)
    lines = [f"{t!r},{k},{'' if np.isnan(v) else repr(float(v))}" for k, (t, v) in enumerate(zip(TIME.tolist(), y, strict=True))]
    (tmp_path / "run.csv").write_text("t,F,x\n" + "\n".join(lines) + "\n")
    r = Recording.read(tmp_path / "run.csv", time="t", inputs={"F": "F"}, outputs={"x": OutputColumn("x", delay=delay)})
    found = r.outputs["x"][np.isfinite(r.outputs["x"])]
    np.testing.assert_array_equal(found, y[np.isfinite(y) & (TIME - delay > -1e-9)])


def test_rows_that_are_left_out_leave_their_inputs_behind(tmp_path):
    lines = [f"{t!r},{k},{float(v)!r}" for k, (t, v) in enumerate(zip(TIME.tolist(), Y, strict=True))]
    (tmp_path / "run.csv").write_text("t,F,x\n" + "\n".join(lines) + "\n")
    r = Recording.read(tmp_path / "run.csv", time="t", inputs={"F": "F"}, outputs={"x": "x"}, every=7, range=(0.02, 0.45))
    np.testing.assert_array_equal(r.time, TIME[2:46:7])
    np.testing.assert_array_equal(r.inputs["F"], np.arange(2, 46, 7))
    np.testing.assert_array_equal(r.outputs["x"], Y[2:46:7])
    np.testing.assert_array_equal(drive_of(r).inputs["F"], np.arange(2, 2 + 7 * (len(r.time) - 1) + 1))
    half = Recording.read(
        tmp_path / "run.csv", time="t", inputs={"F": "F"}, outputs={"x": OutputColumn("x", delay=0.004)}, every=7
    )  # fmt: skip
    np.testing.assert_allclose(half.time, TIME[7::7] - 0.004)
    np.testing.assert_array_equal(half.outputs["x"], Y[7::7])
