"""Recordings in MDF files, written by asammdf itself."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from backsight.estimation import OutputColumn, Recording
from backsight.models.errors import InputError

pytestmark = pytest.mark.checkout

FAST, SLOW = 0.01 * np.arange(20), 0.03 * np.arange(6) + 0.005


def written(folder: Path, *groups: tuple[np.ndarray, dict[str, np.ndarray]], invalid: dict[str, int] | None = None) -> Path:
    """A file with one group of channels per (times, values), the sample `invalid[name]` of a channel marked as invalid."""
    asammdf = pytest.importorskip("asammdf", reason="needs asammdf (pip install backsight[mdf])")
    path, marks = folder / "run.mf4", invalid or {}
    with asammdf.MDF(version="4.10") as file:
        for time, columns in groups:
            signals = []
            for name, values in columns.items():
                bits = {"invalidation_bits": np.arange(len(time)) == marks[name]} if name in marks else {}
                signals.append(asammdf.Signal(values, time, name=name, **bits))
            file.append(signals)
        file.save(path, overwrite=True)
    return path


def read(path: Path, **more) -> Recording:
    return Recording.read(path, **{"time": "time", "inputs": {"F": "force"}, "outputs": {"x": OutputColumn("q", unit="mm")}, **more})


def test_channels_of_one_group_are_the_columns_and_its_master_the_time(tmp_path):
    r = read(written(tmp_path, (FAST, {"force": FAST * 2, "q": FAST * 3})))
    assert r.name == "run.mf4"
    np.testing.assert_array_equal(r.time, FAST)
    np.testing.assert_array_equal(r.inputs["F"], FAST * 2)
    np.testing.assert_allclose(r.outputs["x"], FAST * 3e-3)


def test_a_channel_beside_the_others_can_be_the_time(tmp_path):
    r = read(written(tmp_path, (FAST, {"stamp": 100 + FAST, "force": FAST * 2, "q": FAST})), time="stamp")
    np.testing.assert_array_equal(r.time, 100 + FAST)


def test_an_invalid_sample_of_an_output_is_missing(tmp_path):
    r = read(written(tmp_path, (FAST, {"force": FAST, "q": FAST + 1}), invalid={"q": 3}))
    assert np.flatnonzero(np.isnan(r.outputs["x"])).tolist() == [3]
    assert len(r.time) == 20


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_groups_with_times_of_their_own_meet_at_all_of_them(tmp_path, hold):
    path = written(tmp_path, (FAST, {"q": FAST + 1}), (SLOW, {"force": np.arange(6.0)}))
    r = read(path, hold=hold)
    every = np.union1d(FAST, SLOW)
    last = SLOW[-1] if hold == "linear" else SLOW[-1] + 0.03
    np.testing.assert_allclose(r.time, every[(every >= SLOW[0]) & (every <= last + 1e-12)])
    sampled = np.isin(r.time, FAST)
    np.testing.assert_allclose(r.outputs["x"][sampled], (r.time[sampled] + 1) * 1e-3)
    assert np.isnan(r.outputs["x"][~sampled]).all()
    for t, u in zip(r.time, r.inputs["F"], strict=True):
        k = int(np.flatnonzero(t >= SLOW)[-1])
        assert u == pytest.approx(k if hold == "zero" else k + (t - SLOW[k]) / 0.03)


def test_times_that_differ_by_rounding_are_one_row(tmp_path):
    r = read(written(tmp_path, (FAST, {"q": FAST}), (FAST * (1 + 1e-14), {"force": FAST})))
    assert len(r.time) == 20
    assert np.isfinite(r.outputs["x"]).all()


def test_what_is_not_there_or_not_clear_is_refused(tmp_path):
    path = written(tmp_path, (FAST, {"force": FAST, "q": FAST, "twice": FAST}), (SLOW, {"twice": SLOW, "late": SLOW}))
    with pytest.raises(InputError, match=r"run\.mf4: no channel \"forse\"; did you mean 'force'"):
        read(path, inputs={"F": "forse"})
    with pytest.raises(InputError, match='no channel "clock" for the time; the master channel is "time"'):
        read(path, time="clock")
    with pytest.raises(InputError, match='the channel "twice" occurs in 2 groups'):
        read(path, inputs={"F": "twice"})
    with pytest.raises(InputError, match='the channel "late" has times of its own, so "q" is not its time'):
        read(path, time="q", outputs={"x": "late"})


def test_a_file_that_only_ends_like_one_is_refused(tmp_path):
    pytest.importorskip("asammdf", reason="needs asammdf (pip install backsight[mdf])")
    (tmp_path / "run.mf4").write_bytes(b"t,F,x\n" * 100)
    with pytest.raises(InputError, match=r"run\.mf4: this is no MDF file"):
        read(tmp_path / "run.mf4")


def test_without_asammdf_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "run.mf4").write_bytes(b"MDF     ")
    with pytest.raises(InputError, match=r"pip install backsight\[mdf\]"):
        read(tmp_path / "run.mf4")


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_an_input_that_is_no_number_is_refused_as_in_a_text_file(tmp_path, hold):
    force = np.where(np.arange(20) == 7, np.nan, FAST)
    with pytest.raises(InputError, match=r"run\.mf4, t = .* s: .*input F is missing"):
        read(written(tmp_path, (FAST, {"force": force, "q": FAST})), hold=hold)
    read(written(tmp_path, (FAST, {"force": force, "q": FAST})), hold=hold, range=(FAST[8], FAST[-1]))
