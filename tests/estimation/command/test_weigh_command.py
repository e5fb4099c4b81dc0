"""`weigh` from the command line: what it writes, what it says, and that it goes on after an interrupt."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from friction_axis import STUDY as MACHINE
from friction_axis import FrictionAxis

from backsight.estimation import Problem
from backsight.estimation import weighing as package
from backsight.estimation.command import commands
from backsight.estimation.command.cli import main
from backsight.models.errors import InputError

STUDY = (
    MACHINE
    + """outputs = { x = "x_m" }
"""
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, axis = tmp_path_factory.mktemp("weigh"), FrictionAxis(seed=3)
    pd.DataFrame({"t_s": axis.time, "F_N": axis.force, "x_m": axis.read}).to_csv(folder / "record.csv", index=False)
    path = folder / "axis.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def test_the_study_is_written_with_its_settings_and_its_recommendation(study, capsys):
    assert main(["weigh", str(study), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    result = json.loads((study.parent / "axis_weighed" / "result.json").read_text(encoding="utf-8"))
    assert printed == result
    assert result["command"] == "weigh"
    low, high = result["recommended"]["V"]["x"]["interval"]
    assert low / 1.1 < FrictionAxis.NOISE < 1.1 * high
    low, high = result["recommended"]["W"]["carriage"]["interval"]
    assert low < 1.5 * FrictionAxis.FORCE_STD
    assert high > FrictionAxis.FORCE_STD / 1.5
    assert result["recommended"]["W"]["carriage"]["p_zero"] < 0.05
    names = [row["name"] for row in result["study"]]
    assert {"greatest likelihood", "rule of magnitudes", "W x 10", "V of x x 0.1"} <= set(names)
    best = result["study"][names.index("greatest likelihood")]
    assert best["fit"]["x"]["balance"] == pytest.approx(1.0, abs=0.05)
    assert best["condition"] > 1
    assert set(result["influence"]["V of x"]) == {"friction.f_c", "offset.f"}
    ten = result["study"][names.index("V of x x 10")]["parameters"]["offset.f"]["value"] - best["parameters"]["offset.f"]["value"]
    moved = result["influence"]["V of x"]["offset.f"]
    assert moved["tenfold"] * best["parameters"]["offset.f"]["std"] == pytest.approx(ten, rel=1e-9)
    assert all(np.isfinite(moved[key]) for key in ("tenth", "slope"))
    assert result["notes"].count(result["recommended"]["why"]) == 1
    assert not any(note.startswith(("W of carriage: std", "V of x: std")) for note in result["notes"])  # the table has them
    assert any("last third" in note for note in result["notes"])
    estimates = pd.read_csv(study.parent / "axis_weighed" / "estimates.csv")
    assert np.isfinite(estimates["carriage.v"]).all()
    page = (study.parent / "axis_weighed" / "report.html").read_text(encoding="utf-8")
    assert "L-curve" in page
    assert "heatmap" in page
    assert not (study.parent / ".axis_weighed.settings").exists()


@pytest.mark.parametrize("verb", ["weigh", "diagnose"])
def test_help_says_how_many_processes_there_are(verb, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "200")
    assert main([verb, "--help"]) == 0
    assert "one for every processor" in capsys.readouterr().out


@pytest.mark.parametrize(("words", "jobs"), [([], os.cpu_count()), (["--jobs", "3"], 3)])
def test_without_a_number_there_is_a_process_for_every_processor(study, monkeypatch, words, jobs):
    asked = {}

    def stop(_: object, **arguments: object) -> None:
        asked.update(arguments)
        raise InputError("that will do")

    monkeypatch.setattr(package, "weigh", stop)
    assert main(["weigh", str(study), "--out", str(study.parent / "unwritten"), *words]) == 2
    assert asked["jobs"] == jobs
    assert asked["scheduler"] is None


def test_weights_are_varied_as_they_are_written(study, monkeypatch):
    asked = {}

    def stop(_: object, **arguments: object) -> None:
        asked.update(arguments)
        raise InputError("that will do")

    monkeypatch.setattr(package, "weigh", stop)
    assert main(["weigh", str(study), "--vary", "W of carriage=0.1, 1,10", "--vary", " V of x = 2e-1", "--jobs", "1"]) == 2
    assert asked["vary"] == {"W of carriage": [0.1, 1.0, 10.0], "V of x": [0.2]}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["V of x"], '--vary "V of x": needs the label of a weight and factors on its std, as in --vary "W of carriage=0.1,1,10"'),
        (["=1,2"], '--vary "=1,2": needs the label'),
        (["V of x=1,two"], '"two" is no number'),
        (["V of x=1,,2"], '"" is no number'),
        (["V of x=1", "V of x=2"], '"V of x" is there twice'),
        (["V of x="], "'V of x' = []: there is no factor"),
        (["V of x=-1"], "'V of x': factor -1"),
        (["V of y=1"], "'V of y': this study has no such weight; did you mean 'V of x'?"),
    ],
)
def test_what_cannot_be_varied_is_bad_input(study, capsys, words, said):
    out = study.parent / "unvaried"
    assert main(["weigh", str(study), "--out", str(out), "--jobs", "1", *(w for word in words for w in ("--vary", word))]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert said in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.slow
def test_a_grid_is_written_with_the_rest(study):
    out = study.parent / "grid"
    assert main(["weigh", str(study), "--out", str(out), "--quiet", "--vary", "W of carriage=0.5,2", "--vary", "V of x=1,2"]) == 0
    rows = json.loads((out / "result.json").read_text(encoding="utf-8"))["study"]
    factors = [row["factors"] for row in rows if row["group"] == "chosen"]
    assert sorted((f["W of carriage"], f["V of x"]) for f in factors) == [(0.5, 1.0), (0.5, 2.0), (2.0, 1.0), (2.0, 2.0)]
    assert 'data-chart="chosen_weights"' in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_an_interrupted_study_goes_on_and_solves_nothing_again(study, monkeypatch, capsys):
    """But for a chain of settings that was not at its end: what it gives hangs on where it came from."""
    code = "import sys; from backsight.estimation.command.cli import main; sys.exit(main(sys.argv[1:]))"
    arguments = ["weigh", str(study), "--out", str(study.parent / "again"), "--verbose"]
    kept = study.parent / ".again.settings"
    process = subprocess.Popen([sys.executable, "-c", code, *arguments], stderr=subprocess.PIPE, text=True)
    began = time.monotonic()
    while not (kept.is_dir() and len(list(kept.glob("*.json"))) > 3):
        assert process.poll() is None
        assert time.monotonic() - began < 300
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert str(kept) in said
    assert not (study.parent / "again").exists()
    finished, after = {path: path.stat().st_mtime_ns for path in kept.glob("*.json")}, dict[Path, int]()
    parts = {path: json.loads(path.read_text(encoding="utf-8")) for path in finished}
    settings = {path: part["setting"] for path, part in parts.items() if "setting" in part}
    candidates = [path for path, setting in settings.items() if setting["group"] == "candidate"]

    def vanish(folder: Path, *, ignore_errors: bool) -> None:
        after.update({path: path.stat().st_mtime_ns for path in folder.glob("*.json")})
        rmtree(folder, ignore_errors=ignore_errors)

    rmtree = shutil.rmtree
    monkeypatch.setattr(commands, "shutil", SimpleNamespace(rmtree=vanish))
    assert main(arguments) == 0
    counted = [int(k) for k in re.findall(r"setting (\d+) of \d+", capsys.readouterr().err)]
    assert counted[0] == len(settings) > 2
    assert (study.parent / "again" / "result.json").exists()
    assert len(after) > len(finished)
    again = [path for path in finished if after[path] != finished[path]]
    assert len(again) < 4
    assert len(candidates) == 3
    assert not set(again) & set(candidates)
    assert not kept.exists()


def test_the_folder_that_one_is_in_may_be_that_of_the_results(study, monkeypatch):
    asked = list[Path]()

    def interrupted(_problem: Problem, *, keep: Path, **_options: object) -> None:
        asked.append(keep)
        raise KeyboardInterrupt

    monkeypatch.setattr(package, "weigh", interrupted)
    monkeypatch.chdir(study.parent)
    assert main(["weigh", study.name, "--out", "."]) == 130
    assert main(["weigh", study.name, "--out", "other"]) == 130
    assert asked == [study.parent.parent / f".{study.parent.name}.settings", study.parent / ".other.settings"]


def test_a_study_without_anything_to_estimate_from_is_bad_input(study, capsys):
    other = study.with_name("none.toml")
    other.write_text(STUDY.replace('file = "record.csv"', 'file = "record.csv"\nrole = "held_out"'), encoding="utf-8")
    assert main(["weigh", str(other)]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert not [name for name in os.listdir(study.parent) if name.startswith((".none", "none_"))]
