"""The command: what it writes, what it prints, and how it fails."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backsight.data.generators.table import FRICTION
from backsight.estimation.command import cli, commands
from backsight.estimation.command.cli import main
from backsight.models.errors import SolveError

T = np.arange(400) * 0.005
FORCE = 60 * np.sin(4 * T) + 40 * np.sin(11 * T)
MASS, DAMPING = 95.0, 203.0


def axis(t: np.ndarray, force: np.ndarray) -> np.ndarray:
    """m x'' + d x' = F under a held force, from rest: the exact step of the linear system."""
    h, x, v = t[1] - t[0], np.zeros(len(t)), np.zeros(len(t))
    decay = np.exp(-DAMPING / MASS * h)
    for k in range(len(t) - 1):
        final = force[k] / DAMPING
        x[k + 1] = x[k] + final * h + (v[k] - final) * MASS / DAMPING * (1 - decay)
        v[k + 1] = final + (v[k] - final) * decay
    return x


X = axis(T, FORCE)
NOISE = 1e-5 * np.random.default_rng(1).standard_normal(len(T))
STUDY = """model = "actuator"

[parameters]
"carriage.m" = { guess = 80.0, min = 1.0, max = 1e3 }
"friction.d" = { guess = 100.0, min = 0.0, max = 1e4 }
"friction.f_c" = 0.0
"offset.f" = 0.0

[[recording]]
file = "record.csv"
role = "fit"
time = "t_s"
inputs = { F = "F_N" }
outputs = { x = { column = "x_m", std = 1e-5 } }
"""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(STUDY)
    pd.DataFrame({"t_s": T, "F_N": FORCE, "x_m": X + NOISE}).to_csv("record.csv", index=False)
    return tmp_path


def content(folder: Path) -> dict[str, bytes | None]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def fails(capsys, folder: Path, *arguments: str, status: int = 2) -> str:
    """Run the command, which must fail in one line and leave the folder as it was; returns that line."""
    before = content(folder)
    assert main(arguments) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert content(folder) == before
    return err


# ---------------------------------------------------------------- simulate


def test_simulate_writes_the_motion_under_the_recorded_input(folder):
    values = STUDY.replace("{ guess = 80.0, min = 1.0, max = 1e3 }", "95.0").replace("{ guess = 100.0, min = 0.0, max = 1e4 }", "203.0")
    Path("study.toml").write_text(values)
    assert main(["simulate", "study.toml", "--out", "out", "--quiet"]) == 0
    table = pd.read_csv("out/estimates.csv")
    assert list(table.columns) == ["t_s", "x", "carriage.s", "carriage.v"]
    np.testing.assert_allclose(table["t_s"], T, atol=1e-12)
    np.testing.assert_allclose(table["x"], X, atol=1e-8 * np.ptp(X))
    result = json.loads(Path("out/result.json").read_text())
    fit = result["fit"]["record.csv"]["x"]
    assert fit["rms"] == pytest.approx(np.sqrt(np.mean(NOISE**2)), rel=1e-3)
    assert fit["fit_percent"] == pytest.approx(100 * (1 - np.linalg.norm(NOISE) / np.linalg.norm(X + NOISE - np.mean(X + NOISE))), rel=1e-6)
    assert result["parameters"]["carriage.m"] == {"value": 95.0, "std": None, "unit": "kg", "fixed": True, "identifiable": None}
    assert result["command"] == "simulate"
    assert (folder / "out" / "report.html").stat().st_size > 1000


def test_simulate_needs_no_outputs_and_starts_from_initial(folder):
    text = STUDY.replace('outputs = { x = { column = "x_m", std = 1e-5 } }', "") + '\n[initial]\n"carriage.s" = 0.25\n'
    Path("study.toml").write_text(text)
    assert main(["simulate", "study.toml", "--quiet"]) == 0
    table = pd.read_csv("study_simulated/estimates.csv")
    assert table["x"].iloc[0] == 0.25
    assert json.loads(Path("study_simulated/result.json").read_text())["fit"] == {"record.csv": {}}


def test_several_recordings_are_simulated_alike_by_one_process_and_by_two(folder):
    pd.DataFrame({"t_s": T, "F_N": -FORCE, "x_m": X}).to_csv("other.csv", index=False)
    other = STUDY[STUDY.index("[[recording]]") :].replace("record.csv", "other.csv")
    Path("study.toml").write_text(STUDY + other)
    assert main(["simulate", "study.toml", "--out", "one", "--quiet"]) == 0
    assert main(["simulate", "study.toml", "--out", "two", "--quiet", "--jobs", "2"]) == 0
    one, two = pd.read_csv("one/estimates.csv"), pd.read_csv("two/estimates.csv")
    pd.testing.assert_frame_equal(one, two)
    assert one["recording"].unique().tolist() == ["record.csv", "other.csv"]
    np.testing.assert_allclose(one["x"][:400], -one["x"][400:], atol=1e-9)


# ---------------------------------------------------------------- smooth


def test_smooth_recovers_mass_and_damping_and_writes_every_promised_column(folder, capsys):
    assert main(["smooth", "study.toml", "--out", "out", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    result = json.loads(out, parse_constant=pytest.fail)
    assert result == json.loads(Path("out/result.json").read_text())
    for name, truth in (("carriage.m", MASS), ("friction.d", DAMPING)):
        estimate = result["parameters"][name]
        assert estimate["fixed"] is False
        assert abs(estimate["value"] - truth) < 4 * estimate["std"] < 0.1 * truth
    assert {"command", "model", "recordings", "parameters", "weights", "fit", "solver", "version", "seed"} <= set(result)
    assert result["correlation"]["parameters"] == ["carriage.m", "friction.d"]
    (one, r), (also_r, also_one) = result["correlation"]["matrix"]
    assert (one, also_one, r) == pytest.approx((1.0, 1.0, also_r))
    assert 0.0 < abs(r) < 0.9
    assert {"status", "iterations", "seconds", "build_seconds", "variables"} <= set(result["solver"])
    table = pd.read_csv("out/estimates.csv")
    promised = ["t_s", "x", "x.measured", "x.std", "carriage.s", "carriage.s.std", "carriage.v", "carriage.v.std"]
    assert set(promised) | {"residual.carriage", "residual.carriage.std"} <= set(table.columns)
    np.testing.assert_allclose(table["x.measured"], X + NOISE, rtol=0, atol=1e-15)
    assert result["fit"]["record.csv"]["x"]["rms"] == pytest.approx(np.sqrt(np.mean((table["x"] - table["x.measured"]) ** 2)), rel=1e-6)


def test_smooth_prints_the_estimates_and_where_the_report_is(folder, capsys):
    assert main(["smooth", "study.toml"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "carriage.m" in out
    assert "kg" in out
    assert os.path.join("study", "report.html") in out
    assert (folder / "study" / "report.html").is_file()


def test_a_horizon_that_smooth_does_not_use_is_said(folder, capsys):
    Path("study.toml").write_text(STUDY + "\n[horizon]\nsamples = 50\n")
    assert main(["smooth", "study.toml", "--out", "out"]) == 0
    assert "- [horizon] is for a moving horizon" in capsys.readouterr().out
    assert sum("[horizon]" in note for note in json.loads(Path("out/result.json").read_text())["notes"]) == 1


def test_smooth_says_whether_the_errors_are_white_and_how_well_the_model_explains_them(folder, capsys):
    assert main(["smooth", "study.toml", "--out", "out"]) == 0
    assert re.search(r"fit of x, record.csv .*%\); (white|not white, \d+ effective of 400)", capsys.readouterr().out)
    result = json.loads(Path("out/result.json").read_text())
    fit = result["fit"]["record.csv"]["x"]
    assert fit["whiteness_p"] > 0.001
    assert fit["normality_p"] > 0.001
    assert fit["samples"] == len(T)
    assert 0.3 * len(T) < fit["effective_samples"] <= len(T)
    assert set(result["criteria"]) == {"log_evidence", "log_likelihood", "first_states", "aic", "bic", "effective_parameters", "samples"}
    assert result["criteria"]["samples"] == len(T)
    assert result["profile"] == {}


def test_profiles_are_written_and_printed(folder, capsys):
    assert main(["smooth", "study.toml", "--out", "out", "--profile", "carriage.m", "--profile", "friction.d"]) == 0
    out = capsys.readouterr().out
    result = json.loads(Path("out/result.json").read_text())
    assert list(result["profile"]) == ["carriage.m", "friction.d"]
    for name, p in result["profile"].items():
        assert f"95 % of {name}" in out
        std = result["parameters"][name]["std"]
        # tells little less than a parabola of the deviation, with 400 samples of a strong drive
        assert p["upper"] - p["value"] == pytest.approx(1.96 * std, rel=0.05)
        assert p["value"] - p["lower"] == pytest.approx(1.96 * std, rel=0.05)
        assert p["open"] == p["limited_by_bound"] == []
        assert len(p["values"]) == len(p["cost"]) > 6
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "Profile likelihood" in page


def test_a_profile_of_what_is_fixed_is_refused_before_the_work(folder, capsys):
    error = fails(capsys, folder, "smooth", "study.toml", "--profile", "friction.f_c")
    assert '"friction.f_c" is not estimated' in error


def test_the_three_lines_of_the_readme_follow_each_other(folder):
    """Simulated, smoothed, and simulated again with what was found: in folders of their own."""
    assert main(["smooth", "study.toml", "--quiet"]) == 0
    smoothed = content(folder / "study")
    assert main(["simulate", "study.toml", "--quiet"]) == 0
    assert content(folder / "study") == smoothed
    assert main(["simulate", "study.toml", "--estimates", "study", "--out", "again", "--quiet"]) == 0
    assert json.loads(Path("again/result.json").read_text())["fit"]["record.csv"]["x"]["fit_percent"] > 99
    guessed = json.loads(Path("study_simulated/result.json").read_text())["fit"]["record.csv"]["x"]["fit_percent"]
    assert guessed < 90


def test_smooth_opens_no_pool_that_nobody_uses(folder, monkeypatch):
    from backsight.estimation import workers

    monkeypatch.setattr(workers, "ProcessPoolExecutor", None)
    assert main(["smooth", "study.toml", "--jobs", "2", "--quiet"]) == 0


def test_verbose_says_every_stage_in_a_line_of_its_own(folder, capsys):
    assert main(["smooth", "study.toml", "--verbose", "--json"]) == 0
    out, err = capsys.readouterr()
    json.loads(out)
    stages = [line.split(" s  ")[1] for line in err.splitlines()]
    assert stages[0] == "reading the study"
    assert stages[-1] == "writing the report"
    assert any(s.startswith("mesh of") for s in stages)
    assert all(a.split()[:2] != b.split()[:2] for a, b in pairwise(stages))


def test_a_parameter_on_its_bound_is_there_exactly_and_says_so(folder, capsys):
    text = STUDY.replace("guess = 100.0, min = 0.0, max = 1e4", "guess = 250.0, min = 230.0, max = 1e4")
    Path("study.toml").write_text(text)
    assert main(["smooth", "study.toml"]) == 0
    out = capsys.readouterr().out
    assert "230 N.s/m (on its bound)" in " ".join(out.split())
    assert "friction.d ended on its bound" in out
    found = json.loads(Path("study/result.json").read_text())["parameters"]["friction.d"]
    assert (found["value"], found["std"]) == (230.0, None)


def test_an_interrupt_after_the_results_are_written_says_where_they_are(folder, capsys, monkeypatch):
    monkeypatch.setattr(commands, "_say", raising(KeyboardInterrupt()))
    assert main(["simulate", "study.toml"]) == 130
    assert capsys.readouterr().err == "interrupted: the results are in study_simulated\n"
    assert Path("study_simulated/result.json").is_file()


def test_quiet_prints_nothing(folder, capsys):
    assert main(["smooth", "study.toml", "--out", "Läufe am Montag/eins", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert (folder / "Läufe am Montag" / "eins" / "result.json").is_file()


def test_what_has_not_converged_is_written_marked_and_ends_with_status_3(folder, capsys, monkeypatch):
    from backsight.estimation.smoothing import smoother

    sound = smoother.smooth

    def stopped(problem, **options):
        from dataclasses import replace

        answer = sound(problem, **options)
        return replace(answer, solver=replace(answer.solver, converged=False, status="stopped at the iteration limit"))

    monkeypatch.setattr(smoother, "smooth", stopped)
    assert main(["smooth", "study.toml", "--out", "out", "--quiet"]) == 3
    assert capsys.readouterr().err == "error: no convergence: stopped at the iteration limit; what there is, is in out, marked\n"
    solver = json.loads(Path("out/result.json").read_text())["solver"]
    assert (solver["converged"], solver["status"]) == (False, "stopped at the iteration limit")


# ---------------------------------------------------------------- demo and models


@pytest.mark.slow
def test_the_demo_runs_where_one_stands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["demo"]) == 0
    result = json.loads(Path("backsight_demo/result.json").read_text())
    assert result["command"] == "demo"
    assert result["verdict"] == "missing_physics"
    (found,) = result["findings"]
    assert (found["place"], found["physics"]) == ("drive_2", "coulomb_friction")
    level = found["parameters"]["tau_c"]
    assert abs(level["value"] - FRICTION) < 4 * level["std"] < 0.02 * FRICTION
    assert result["held_out"]["improvement_percent"] > 40
    assert result["held_out"]["p_value"] < 0.01
    assert "report.html" in capsys.readouterr().out


def test_a_model_leaves_as_an_fmu_only_when_it_is_named(capsys, tmp_path):
    assert main(["models", "actuator", "--fmu", str(tmp_path / "axis.fmu")]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "axis.fmu")
    assert (tmp_path / "axis.fmu").stat().st_size > 1000
    assert "no model is named" in fails(capsys, tmp_path / "none", "models", "--fmu", str(tmp_path / "axis.fmu"))


def test_models_are_listed_and_described(capsys):
    assert main(["models"]) == 0
    assert "actuator" in capsys.readouterr().out
    assert main(["models", "actuator"]) == 0
    text = capsys.readouterr().out
    for word in ("carriage.m", "kg", "force balance", "F", "x"):
        assert word in text
    assert main(["models", "actuator", "--json"]) == 0
    described = json.loads(capsys.readouterr().out)
    assert described["inputs"] == {"F": "N"}
    assert described["parameters"]["carriage.m"]["unit"] == "kg"


def test_components_are_listed_and_explained(capsys):
    """By library and by name; of a name that two libraries have, both."""
    assert main(["models"]) == 0
    assert "Inertia" in capsys.readouterr().out
    assert main(["models", "electrical"]) == 0
    text = capsys.readouterr().out
    for word in ("from backsight.models.electrical import DCMotor", "Km [V.s/rad]", "p, n (electrical), flange (rotational)"):
        assert word in text
    assert main(["models", "Accelerometer", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["components"]
    assert [c["module"].rpartition(".")[2] for c in found] == ["planar", "spatial"]
    assert main(["models", "Inertia", "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["components"]
    assert found["connectors"] == {"flange": "Rotational"}
    assert found["parameters"]["J"]["unit"] == "kg.m2"


def test_an_unknown_model_is_bad_input(tmp_path, capsys):
    assert "did you mean 'actuator'" in fails(capsys, tmp_path, "models", "actuatr")
    assert "did you mean 'Inertia'" in fails(capsys, tmp_path, "models", "Inertai")
    assert "is no plant; known: actuator" in fails(capsys, tmp_path, "models", "xyzzy")


# ---------------------------------------------------------------- failures


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["smooth", "absent.toml"], "absent.toml"),
        (["smooth", "study.toml", "--frobnicate"], "--frobnicate"),
        (["smoothen", "study.toml"], "smoothen"),
        (["smooth"], "STUDY"),
        (["smooth", "study.toml", "--jobs", "0"], "--jobs 0"),
        (["weigh", "study.toml", "--jobs", "0"], "--jobs 0"),
        (["diagnose", "study.toml", "--jobs", "0"], "--jobs 0"),
        (["smooth", "study.toml", "--jobs", "many"], "--jobs"),
        (["smooth", "study.toml", "--out", "record.csv"], "--out record.csv"),
        (["smooth", "study.toml", "--out", "record.csv/inside"], "record.csv is a file"),
        (["simulate", "study.toml", "--out", "/proc/backsight_out"], "/proc"),
        (["simulate", "study.toml", "--scheduler", "tcp://nowhere.invalid:8786"], "nowhere.invalid"),
        (["smooth", "study.toml", "--scheduler", "tcp://nowhere.invalid:8786"], "nowhere.invalid"),
        (["--nonsense"], "--nonsense"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line_with_status_2(folder, capsys, arguments, word):
    if "/proc" in word and not Path("/proc").is_dir():
        pytest.skip("no such folder on this system")
    assert word in fails(capsys, folder, *arguments)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"carriage.m"', '"carriage.mass"', ("study.toml", "line 4", "carriage.mass", "carriage.m")),
        ("record.csv", "nowhere.csv", ("nowhere.csv",)),
        ('"x_m"', '"pos_m"', ("record.csv", "line 1", "pos_m")),
        ("guess = 80.0", "guess = nan", ("carriage.m", "nan")),
    ],
)
@pytest.mark.parametrize("verb", ["smooth", "simulate"])
def test_bad_input_leaves_nothing_behind(folder, capsys, verb, old, new, words):
    Path("study.toml").write_text(STUDY.replace(old, new))
    message = fails(capsys, folder, verb, "study.toml", "--out", "out")
    for word in words:
        assert word in message


def test_a_bad_cell_reaches_the_user_with_its_line(folder, capsys):
    lines = Path("record.csv").read_text().splitlines()
    lines[100] = lines[100].rsplit(",", 1)[0] + ",broken"
    Path("record.csv").write_text("\n".join(lines))
    message = fails(capsys, folder, "smooth", "study.toml", "--out", "out")
    assert "record.csv, line 101" in message
    assert '"broken"' in message


def raising(error: BaseException):
    def run(*_: object) -> int:
        raise error

    return run


def test_a_fault_of_the_program_is_one_line_and_says_how_to_see_more(folder, capsys, monkeypatch):
    monkeypatch.setattr(commands, "run_smooth", raising(ZeroDivisionError("a\nb")))
    assert "BACKSIGHT_TRACEBACK=1" in fails(capsys, folder, "smooth", "study.toml", status=1)
    monkeypatch.setenv("BACKSIGHT_TRACEBACK", "1")
    assert main(["smooth", "study.toml"]) == 1
    assert "Traceback (most recent call last)" in capsys.readouterr().err


def test_a_solver_that_gives_up_ends_with_status_3_and_an_interrupt_with_130(folder, capsys, monkeypatch):
    monkeypatch.setattr(commands, "run_smooth", raising(SolveError("the integration stops at t = 1.2 s")))
    assert "t = 1.2 s" in fails(capsys, folder, "smooth", "study.toml", status=3)
    monkeypatch.setattr(commands, "run_smooth", raising(KeyboardInterrupt()))
    assert main(["smooth", "study.toml"]) == 130
    assert capsys.readouterr() == ("", "interrupted: nothing was written\n")


def test_version_and_help_say_what_there_is(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("backsight 0.")
    for arguments in ([], ["--help"]):
        assert main(arguments) == 0
        out = capsys.readouterr().out
        for verb in ("demo", "diagnose", "models", "simulate", "smooth", "track", "weigh"):
            assert verb in out
    registered = {info.name or info.callback.__name__ for info in cli.app.registered_commands if info.callback}
    assert registered == {"demo", "diagnose", "models", "simulate", "smooth", "track", "weigh"}


@pytest.mark.slow
@pytest.mark.parametrize("which", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_the_process_with_130_and_leaves_nothing(folder, which):
    t = np.arange(60_000) * 1e-3
    pd.DataFrame({"t_s": t, "F_N": 50 * np.sin(t), "x_m": np.cos(t)}).to_csv("record.csv", index=False)
    before = set(content(folder))
    code = "import sys; from backsight.estimation.command.cli import main; sys.exit(main())"
    process = subprocess.Popen([sys.executable, "-c", code, "simulate", "study.toml", "--out", "out"], stderr=subprocess.PIPE, text=True)
    for _ in range(300):
        if any(path.name.startswith(".backsight-") for path in folder.iterdir()):
            break
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(which)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err == "interrupted: nothing was written\n"
    assert set(content(folder)) == before


def test_an_interrupt_after_the_last_word_is_no_fault(folder):
    """The interpreter still has a while to clear away: Ctrl-C would come out of whatever it is at."""
    ask = "import atexit, os, signal, sys; atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))"
    code = f"{ask}; from backsight.estimation.command.cli import main; sys.exit(main())"
    ended = subprocess.run([sys.executable, "-c", code, "--version"], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("backsight 0.")


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3])
def test_an_interrupt_near_the_end_leaves_all_or_nothing_and_says_which(folder, after):
    code = "import sys; from backsight.estimation.command.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "simulate", "study.toml", "--out", "out", "--verbose"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if "writing the report" in line:
            break
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    written = {path.name for path in (folder / "out").iterdir()} if (folder / "out").exists() else set()
    ends = {
        (130, "interrupted: nothing was written\n"): set(),
        (130, "interrupted: the results are in out\n"): {"result.json", "estimates.csv", "report.html"},
        (0, ""): {"result.json", "estimates.csv", "report.html"},
    }
    assert written == ends[process.returncode, err]
    assert process.returncode == 130 or out.endswith("results: out/report.html\n")
    assert not [path for path in folder.rglob(".*") if path.name.startswith(".backsight-")]


# ---------------------------------------------------------------- estimates taken along, recordings held out


def test_simulate_takes_the_parameters_that_smooth_estimated(folder):
    assert main(["smooth", "study.toml", "--out", "fitted", "--quiet"]) == 0
    estimated = json.loads(Path("fitted/result.json").read_text())["parameters"]
    two = STUDY + STUDY[STUDY.index("[[recording]]") :].replace("record.csv", "other.csv")
    Path("study.toml").write_text(two)
    pd.DataFrame({"t_s": T, "F_N": -FORCE, "x_m": -X}).to_csv("other.csv", index=False)
    for jobs in ("1", "2"):
        assert main(["simulate", "study.toml", "--estimates", "fitted", "--out", f"out{jobs}", "--quiet", "--jobs", jobs]) == 0
        result = json.loads(Path(f"out{jobs}/result.json").read_text())
        for name in ("carriage.m", "friction.d"):
            assert result["parameters"][name]["value"] == estimated[name]["value"] != pytest.approx(80.0)
        assert result["parameters"]["friction.f_c"]["value"] == 0.0
        # the exact motion of the true axis, which the guesses of the study miss by far
        assert result["fit"]["other.csv"]["x"]["rms"] < 1e-4 * np.ptp(X)
    assert main(["simulate", "study.toml", "--out", "guessed", "--quiet"]) == 0
    assert json.loads(Path("guessed/result.json").read_text())["fit"]["other.csv"]["x"]["rms"] > 1e-2 * np.ptp(X)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, ("nowhere", "cannot be read", "folder of results")),
        ("{", ("holds no results of smooth",)),
        ("[]", ("holds no results of smooth",)),
        ('{"model": "crane", "parameters": {}}', ('"crane"', '"actuator"')),
        ('{"model": "actuator", "parameters": {}}', ("nothing was estimated",)),
        ('{"model": "actuator", "parameters": {"carriage.n": {"value": 1.0, "fixed": false}}}', ('"carriage.n"', "'carriage.m'")),
        ('{"model": "actuator", "parameters": {"carriage.m": {"value": null, "fixed": false}}}', ("holds no results of smooth",)),
    ],
)
def test_estimates_that_cannot_be_used_are_refused(folder, capsys, content, words):
    if content is not None:
        Path("nowhere").mkdir()
        Path("nowhere/result.json").write_text(content)
    message = fails(capsys, folder, "simulate", "study.toml", "--estimates", "nowhere", "--out", "out")
    assert message.startswith("error: --estimates nowhere: ")
    assert all(word in message for word in words), message


def test_what_is_held_out_is_predicted_in_result_json_and_in_the_report(folder, capsys):
    pd.DataFrame({"t_s": T, "F_N": -FORCE, "x_m": NOISE[::-1] - X}).to_csv("other.csv", index=False)
    held_out = STUDY[STUDY.index("[[recording]]") :].replace("record.csv", "other.csv").replace('"fit"', '"held_out"')
    Path("study.toml").write_text(STUDY + held_out)
    assert main(["smooth", "study.toml", "--out", "out"]) == 0
    fit = json.loads(Path("out/result.json").read_text())["fit"]
    assert fit["record.csv"]["x"]["role"] == "fit"
    assert fit["other.csv"]["x"]["role"] == "held_out"
    assert main(["simulate", "study.toml", "--out", "simulated", "--quiet"]) == 0
    simulated = json.loads(Path("simulated/result.json").read_text())["fit"]
    assert [simulated[name]["x"]["role"] for name in ("record.csv", "other.csv")] == ["fit", "held_out"]
    assert fit["other.csv"]["x"]["rms"] < 1e-4
    assert fit["other.csv"]["x"]["fit_percent"] > 99
    assert fit["other.csv"]["x"]["window_rms"] == pytest.approx(1e-5, rel=0.5)
    assert set(pd.read_csv("out/estimates.csv").columns) >= {"x", "x.std"}
    assert len(pd.read_csv("out/estimates.csv")) == len(T)
    page, ahead = Path("out/report.html").read_text(), fit["other.csv"]["x"]["window_rms"]
    assert "Held out: other.csv" in page
    lead = page[page.index("<p class=answer>") :].partition("</p>")[0]
    assert re.search(
        rf"Held out: <code>x</code> of <code>other.csv</code> is predicted to .* rms \(fit 99.*{1e6 * ahead:.3g} µm over 0.1 s", lead
    )
    assert re.search(rf"prediction of x, other.csv +rms .*; {ahead:.3g} m over 0.1 s", capsys.readouterr().out)


def test_the_linear_algebra_library_starts_no_threads_but_those_that_the_environment_asks_for():
    code = "import os; from backsight.estimation.command.cli import main; main(['--version']); print(os.environ['OPENBLAS_NUM_THREADS'])"
    clean = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    for given, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=clean | given, check=True)
        assert done.stdout.splitlines()[-1] == expected
