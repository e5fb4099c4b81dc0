"""`track` over a recording, and over rows on standard input."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from friction_axis import STUDY as MACHINE
from friction_axis import FrictionAxis

from backsight.estimation.command.cli import main

STUDY = (
    MACHINE
    + """outputs = { x = { column = "x_mm", unit = "mm", std = 1e-5 } }

[weights]
W = { "carriage" = { std = 0.4 } }

[horizon]
samples = 25
"""
)


@pytest.fixture(scope="module")
def axis() -> FrictionAxis:
    return FrictionAxis(count=400)


@pytest.fixture
def folder(tmp_path, monkeypatch, axis) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(STUDY)
    pd.DataFrame({"t_s": axis.time, "F_N": axis.force, "x_mm": 1e3 * axis.read}).to_csv("record.csv", index=False)
    return tmp_path


def streamed(monkeypatch, capsys, text: str, *arguments: str) -> tuple[pd.DataFrame, str]:
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    assert main(["track", "study.toml", "--stdin", *arguments]) == 0
    out, err = capsys.readouterr()
    return pd.read_csv(io.StringIO(out)), err


def test_one_estimate_per_sample_ends_at_the_truth_and_says_how_long_it_took(folder, axis):
    assert main(["track", "study.toml", "--quiet"]) == 0
    out = folder / "study_tracked"
    result, table = json.loads((out / "result.json").read_text()), pd.read_csv(out / "estimates.csv")
    assert len(table) == len(axis.time)
    for name, truth in FrictionAxis.FREE.items():
        found = result["parameters"][name]
        assert abs(found["value"] - truth) < 4 * found["std"]
        assert table[name].iloc[-1] == pytest.approx(found["value"], rel=1e-12)
        assert table[f"{name}.std"].iloc[-1] < 0.15 * table[f"{name}.std"].iloc[0]
    error = (table["carriage.v"] - axis.states[:, 1]) / table["carriage.v.std"]
    assert 0.6 < np.sqrt(np.mean(error[20:] ** 2)) < 1.5
    assert result["failed_steps"] == 0
    assert set(result["latency_ms"]) == {"median", "p95", "p99", "max"}
    assert result["horizon"] == {"samples": 25}
    assert "moving horizon" in (out / "report.html").read_text().lower()


def test_rows_on_standard_input_give_what_the_recording_gives(folder, monkeypatch, capsys):
    assert main(["track", "study.toml", "--quiet"]) == 0
    table = pd.read_csv("study_tracked/estimates.csv")
    rows, err = streamed(monkeypatch, capsys, Path("record.csv").read_text(), "--out", "live")
    assert err == ""
    pd.testing.assert_frame_equal(rows, table, rtol=1e-9)
    assert json.loads(Path("live/result.json").read_text())["outcomes"] == {"estimated": 400}


def test_stopped_and_resumed_the_stream_goes_on_exactly(folder, monkeypatch, capsys):
    header, *lines = Path("record.csv").read_text().splitlines(keepends=True)
    whole, _ = streamed(monkeypatch, capsys, header + "".join(lines))
    first, _ = streamed(monkeypatch, capsys, header + "".join(lines[:150]), "--state", "s.npz")
    second, _ = streamed(monkeypatch, capsys, header + "".join(lines[150:]), "--state", "s.npz")
    pd.testing.assert_frame_equal(pd.concat([first, second], ignore_index=True), whole, rtol=0, atol=0)


def test_stopped_between_two_rows_that_count_it_goes_on_with_the_right_one(folder, monkeypatch, capsys):
    header, *lines = Path("record.csv").read_text().splitlines(keepends=True)
    Path("third.toml").write_text(Path("study.toml").read_text().replace('time = "t_s"', 'time = "t_s"\nevery = 3'))

    def rows(part, *more):
        monkeypatch.setattr("sys.stdin", io.StringIO(header + "".join(part)))
        assert main(["track", "third.toml", "--stdin", *more]) == 0
        return pd.read_csv(io.StringIO(capsys.readouterr().out))

    whole = rows(lines)
    first, second = rows(lines[:151], "--state", "t.npz"), rows(lines[151:], "--state", "t.npz")
    pd.testing.assert_frame_equal(pd.concat([first, second], ignore_index=True), whole, rtol=0, atol=0)
    before = rows(lines[:31], "--state", "u.npz")
    again = rows(["n/a,1.0,2.0\n"] * 3, "--state", "u.npz")
    assert again["outcome"].tolist() == ["late"] * 3
    assert again["carriage.s"].tolist() == [before["carriage.s"].iloc[-1]] * 3


def test_what_cannot_be_read_is_said_and_is_missing_and_no_row_stays_without_an_estimate(folder, monkeypatch, capsys):
    header, *lines = Path("record.csv").read_text().splitlines(keepends=True)
    lines = lines[:120]
    lines[60] = lines[60].rsplit(",", 1)[0] + ",abc\n"
    lines[70] = "n/a,1.0,2.0\n"
    lines[80] = lines[79]  # sent twice
    lines[90] = lines[90].rsplit(",", 1)[0] + ",\n"
    rows, err = streamed(monkeypatch, capsys, header + "".join(lines))
    assert len(rows) == 120
    assert 'line 62: column "x_mm" is "abc"' in err
    assert 'line 72: column "t_s" is "n/a"' in err
    assert rows["outcome"][[60, 70, 80, 90]].tolist() == ["predicted", "late", "late", "predicted"]
    assert np.isfinite(rows["carriage.s"]).all()
    assert rows["carriage.s.std"][90] > rows["carriage.s.std"][89]


def test_a_clock_that_starts_anew_is_said(folder, monkeypatch, capsys):
    header, *lines = Path("record.csv").read_text().splitlines(keepends=True)
    monkeypatch.setattr("sys.stdin", io.StringIO(header + "".join(lines[10:30] + lines[:8])))
    assert main(["track", "study.toml", "--stdin"]) == 0
    captured = capsys.readouterr()
    assert captured.err.count("warning:") == 1
    assert "for the 5th time in a row" in captured.err
    assert captured.out.count(",late") == 8


def test_json_is_one_object_per_row(folder, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(Path("record.csv").read_text().splitlines(keepends=True)[:30])))
    assert main(["track", "study.toml", "--stdin", "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(rows) == 29
    assert rows[0]["outcome"] == "estimated"
    assert rows[0]["carriage.v.std"] is None


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "it is empty"), ("t,F_N,x_mm\n0,0,0\n", 'no column "t_s"')],
)
def test_a_stream_that_cannot_be_understood_is_bad_input(folder, monkeypatch, capsys, text, said):
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    assert main(["track", "study.toml", "--stdin"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err


def test_a_state_without_a_stream_and_a_known_delay_in_one_are_refused(folder, monkeypatch, capsys):
    assert main(["track", "study.toml", "--state", "s.npz"]) == 2
    assert "--stdin" in capsys.readouterr().err
    Path("study.toml").write_text(STUDY.replace("std = 1e-5", "std = 1e-5, delay = 0.02"))
    monkeypatch.setattr("sys.stdin", io.StringIO(Path("record.csv").read_text()))
    assert main(["track", "study.toml", "--stdin"]) == 2
    assert 'delay = "estimate"' in capsys.readouterr().err


def test_estimates_come_while_rows_are_still_to_come_and_an_interrupt_leaves_the_state(folder):
    header, *lines = Path("record.csv").read_text().splitlines(keepends=True)
    code = "import sys; from backsight.estimation.command.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "track", "study.toml", "--stdin", "--state", "s.npz"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ}) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(header + lines[0])
        process.stdin.flush()
        assert process.stdout.readline().startswith("t_s,")
        assert process.stdout.readline().startswith("0.0,")
        for line in lines[1:20]:
            process.stdin.write(line)
            process.stdin.flush()
            assert float(process.stdout.readline().split(",")[0]) == float(line.split(",")[0])
        process.send_signal(signal.SIGINT)
        began = time.monotonic()
        assert process.wait(timeout=60) == 130
        assert time.monotonic() - began < 60
    assert Path("s.npz").exists()
