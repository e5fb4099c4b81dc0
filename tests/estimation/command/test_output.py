"""The folder of results appears whole or not at all."""

from __future__ import annotations

import json
import shutil
import signal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backsight.estimation.command.interrupt import remembered
from backsight.estimation.command.output import json_text, results_folder, write_estimates
from backsight.models.errors import InputError, SolveError


def test_the_folder_appears_only_when_everything_is_written(tmp_path):
    out = tmp_path / "deep" / "out"
    with results_folder(out) as folder:
        (folder / "result.json").write_text("{}")
        assert not out.exists()
    assert [path.name for path in out.iterdir()] == ["result.json"]
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]
    assert out.stat().st_mode & 0o700 == 0o700


def write_half(target, failure):
    with results_folder(target) as folder:
        (folder / "result.json").write_text("half")
        raise failure


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, OSError])
def test_after_a_failure_nothing_is_left_and_old_results_stand(tmp_path, failure):
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text("old")
    for target in (out, tmp_path / "new"):
        with pytest.raises(failure):
            write_half(target, failure)
    assert (out / "result.json").read_text() == "old"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["out", "result.json"]


def test_success_replaces_old_results_and_leaves_other_files_alone(tmp_path):
    for name in ("result.json", "report.html", "mine.txt"):
        (tmp_path / name).write_text("old")
    with results_folder(tmp_path) as folder:
        (folder / "result.json").write_text("new")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"result.json": "new", "mine.txt": "old"}


def write_new(target, *names):
    with results_folder(target) as folder:
        for name in names:
            (folder / name).write_text("new")


def test_of_two_runs_into_one_new_folder_the_one_that_ends_last_has_its_results_there(tmp_path):
    out = tmp_path / "out"
    with results_folder(out) as slow:
        (slow / "result.json").write_text("slow")
        (slow / "estimates.csv").write_text("slow")
        with results_folder(out) as quick:
            (quick / "result.json").write_text("quick")
            (quick / "report.html").write_text("quick")
        assert (out / "result.json").read_text() == "quick"
    assert {path.name: path.read_text() for path in out.iterdir()} == {"result.json": "slow", "estimates.csv": "slow"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_file_that_takes_the_folders_name_meanwhile_is_left_alone(tmp_path):
    out = tmp_path / "out"

    def written_beside():
        with results_folder(out):
            out.write_text("mine")

    with pytest.raises(InputError, match="cannot be written"):
        written_beside()
    assert out.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_interrupt_among_the_renames_leaves_no_mixture(tmp_path, monkeypatch):
    for name in ("result.json", "estimates.csv", "report.html", "mine.txt"):
        (tmp_path / name).write_text("old")
    plain, asked = Path.rename, []

    def interrupted(path, target):
        if not asked:
            asked.append(path)
            signal.raise_signal(signal.SIGTERM)
        return plain(path, target)

    monkeypatch.setattr(Path, "rename", interrupted)
    with remembered():
        write_new(tmp_path, "result.json", "estimates.csv", "report.html")
    assert asked
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == dict.fromkeys(("result.json", "estimates.csv", "report.html"), "new") | {
        "mine.txt": "old"
    }


def test_an_interrupt_while_the_folder_is_cleared_away_leaves_nothing_of_it(tmp_path, monkeypatch):
    plain, asked = shutil.rmtree, []

    def interrupted(folder, **more):
        asked.append(folder)
        if len(asked) == 1:
            raise KeyboardInterrupt
        plain(folder, **more)

    def half_written():
        with results_folder(tmp_path / "out") as folder:
            (folder / "result.json").write_text("half")
            raise SolveError("it does not arrive")

    monkeypatch.setattr(shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt):
        half_written()
    assert list(tmp_path.iterdir()) == []


def test_a_rename_that_fails_brings_the_old_results_back(tmp_path, monkeypatch):
    for name in ("result.json", "estimates.csv"):
        (tmp_path / name).write_text("old")
    plain = Path.rename

    def failing(path, target):
        if path.parent != tmp_path and path.name == "result.json" and ".former" not in path.parts:
            raise OSError(28, "No space left on device")
        return plain(path, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(InputError, match="cannot be written"):
        write_new(tmp_path, "result.json", "estimates.csv")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"result.json": "old", "estimates.csv": "old"}


def test_a_file_in_the_way_is_refused_before_any_work(tmp_path):
    (tmp_path / "taken").write_text("mine")
    for out in (tmp_path / "taken", tmp_path / "taken" / "inside"):
        with pytest.raises(InputError, match=r"--out .*taken.* is a file"), results_folder(out):
            pytest.fail("the work was begun")
    assert (tmp_path / "taken").read_text() == "mine"


def test_json_holds_null_where_there_is_no_number():
    text = json_text(
        {"a": float("nan"), "b": [np.float64("inf"), np.int64(3)], "c": np.array([1.5, np.nan]), "d": None, "e": True, "f": "é"}
    )
    assert json.loads(text, parse_constant=pytest.fail) == {"a": None, "b": [None, 3], "c": [1.5, None], "d": None, "e": True, "f": "é"}


def test_several_recordings_are_told_apart_by_the_first_column(tmp_path):
    one, two = pd.DataFrame({"t_s": [0.0, 0.1], "x": [1 / 3, 2.0]}), pd.DataFrame({"t_s": [5.0], "x": [7.0]})
    write_estimates({"one.csv": one}, tmp_path / "single.csv")
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "single.csv", float_precision=None), one)
    write_estimates({"one.csv": one, "two.csv": two}, tmp_path / "both.csv")
    both = pd.read_csv(tmp_path / "both.csv")
    assert list(both.columns) == ["recording", "t_s", "x"]
    assert both["recording"].tolist() == ["one.csv", "one.csv", "two.csv"]
