"""`diagnose` from the command line: what it writes of a diagnosis, what it says, and its exit status."""

from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from diagnoses import diagnosis

from backsight.data import path as bundled
from backsight.estimation import Problem
from backsight.estimation import diagnosis as package
from backsight.estimation.command.cli import main
from backsight.estimation.command.diagnosis_json import result_of_diagnosis
from backsight.estimation.diagnosis import Diagnosis, Explanation, Strength, Tried
from backsight.estimation.diagnosis.answer.verdict import TOO_SMALL
from backsight.estimation.diagnosis.answer.words import sentence, with_deviation
from backsight.estimation.diagnosis.diagnose import SEARCH
from backsight.models import InputError

STUDY = f"""model = "actuator"

[parameters]
"carriage.m" = {{ guess = 90.0 }}
"friction.f_c" = 0.0

[[recording]]
file = '{bundled("axis_fit.csv.gz")}'
time = "t_s"
range = [0.0, 1.0]
inputs = {{ F = "F_N" }}
outputs = {{ x = {{ column = "x_m", std = 1e-6 }} }}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "axis.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


class Diagnoser:
    """Stands in for the search, which has tests of its own; remembers what it was asked."""

    def __init__(self, found: Diagnosis | BaseException) -> None:
        self.found, self.asked = found, {}

    def __call__(self, problem: Problem, **options) -> Diagnosis:
        self.asked = {"problem": problem, **options}
        options["keep"].mkdir()
        (options["keep"] / "part").write_text("finished")
        if isinstance(self.found, BaseException):
            raise self.found
        return self.found


@pytest.fixture
def search(monkeypatch: pytest.MonkeyPatch) -> Diagnoser:
    one = Diagnoser(diagnosis())
    monkeypatch.setattr(package, "diagnose", one, raising=False)
    return one


def test_the_verdict_is_written_with_its_findings_its_proof_and_its_limits(study, search, capsys):
    assert main(["diagnose", str(study), "--json", "--jobs", "2"]) == 0
    printed = json.loads(capsys.readouterr().out)
    folder = study.parent / "axis_diagnosed"
    assert json.loads((folder / "result.json").read_text(encoding="utf-8")) == printed
    assert search.asked["jobs"] == 2
    assert search.asked["scheduler"] is None
    assert search.asked["seconds"] == SEARCH
    assert search.asked["keep"] == study.parent / ".axis_diagnosed.parts"
    assert [r.time[-1] for r in search.asked["problem"].recordings] == [1.0]
    assert printed["command"] == "diagnose"
    assert printed["verdict"] == "missing_physics"
    (finding,) = printed["findings"]
    found = diagnosis().findings[0]
    strength = found.explanation.parameters["f_c"]
    assert (finding["place"], finding["family"], finding["physics"]) == ("carriage", "friction", "coulomb_friction")
    assert finding["parameters"] == {"f_c": {"value": strength.value, "std": strength.std, "unit": "N"}}
    assert finding["onset_s"] is None
    assert (finding["regime"], finding["share_of_force"], finding["p_value"]) == ("whole record", 0.34, 0.005)
    assert finding["log_evidence_gain"] == 812.0
    assert finding["alternatives"] == [{"place": "carriage", "physics": "stribeck_friction", "log_evidence_gap": 6.4}]
    assert finding["ambiguous_with"] == [{"place": "input:F", "physics": "input_dead_zone"}]
    assert finding["model_change"] == found.change
    held = printed["held_out"]
    assert held["before"] == {"x": {"0.05": 4e-6, "0.25": 1.6e-5, "1.5": 3.6e-5}, "residual.carriage": {"rms": 8.0}}
    assert held["after"]["residual.carriage"] == {"rms": 0.4}
    assert (held["improvement_percent"], held["p_value"]) == (75.0, 0.001)
    assert held["units"] == {"x": "m", "residual.carriage": "N"}
    assert printed["not_detectable"][0]["minimum_strength"] == 2e-5
    assert printed["not_detectable"][1]["minimum_strength"] is None  # infinite
    assert printed["parameters"]["friction.f_c"]["value"] == strength.value
    assert {"recordings", "weights", "fit", "solver", "version", "model"} <= set(printed)
    assert printed["seed"] == 7
    assert printed["notes"][0] == "The noise of x is that given."
    assert "carriage.v" in pd.read_csv(folder / "estimates.csv")
    assert "coulomb friction at carriage" in (folder / "report.html").read_text(encoding="utf-8")
    assert not (study.parent / ".axis_diagnosed.parts").exists()


def test_the_repaired_model_is_a_file_that_a_study_names_as_its_model(study, search, capsys):
    assert main(["diagnose", str(study), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    file = study.parent / "axis_diagnosed" / printed["repaired_model"]
    assert "leaves out coulomb friction at carriage" in " ".join(file.read_text(encoding="utf-8").split())
    lines = [line for line in STUDY.splitlines() if not line.startswith('"')]
    again = study.parent / "again.toml"
    again.write_text("\n".join(["model = 'axis_diagnosed/repaired_model.py:actuator'" if "model" in line else line for line in lines]))
    assert main(["simulate", str(again), "--json"]) == 0
    simulated = json.loads(capsys.readouterr().out)["parameters"]
    told = {name: p["value"] for name, p in printed["parameters"].items() if name in simulated and not p["fixed"]}
    assert "friction.f_c" in told
    assert {name: simulated[name]["value"] for name in told} == told


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_study_is_simulated_with_the_repaired_model_of_its_diagnosis(study, search, capsys, monkeypatch, jobs):
    """With all of its numbers, fixed ones too, and in other processes too."""
    _, _, recording = STUDY.partition("[[recording]]")
    study.write_text(STUDY + "\n[[recording]]" + recording.replace("[0.0, 1.0]", "[1.0, 2.0]"), encoding="utf-8")
    assert main(["diagnose", str(study), "--json"]) == 0
    told = {name: p["value"] for name, p in json.loads(capsys.readouterr().out)["parameters"].items()}
    monkeypatch.chdir(study.parent)
    assert main(["simulate", "axis.toml", "--estimates", "axis_diagnosed", "--json", "--jobs", jobs]) == 0
    simulated = json.loads(capsys.readouterr().out)
    assert told["friction.f_c"] > 1.0  # the study says 0
    assert told == {name: p["value"] for name, p in simulated["parameters"].items()}
    assert len(simulated["recordings"]) == 2


def test_a_repaired_model_that_could_not_be_written_is_not_simulated_as_if_it_were_the_declared_one(study, search, capsys, monkeypatch):
    assert main(["diagnose", str(study), "--json"]) == 0
    result = study.parent / "axis_diagnosed" / "result.json"
    result.write_text(json.dumps(json.loads(result.read_text(encoding="utf-8")) | {"repaired_model": None}), encoding="utf-8")
    capsys.readouterr()
    assert main(["simulate", str(study), "--estimates", str(result.parent)]) == 2
    assert "has a component of a class that no file has, and was not written; put coulomb_friction into" in capsys.readouterr().err


def test_a_search_ends_when_it_is_told_to(study, search, capsys):
    assert main(["diagnose", str(study), "--json", "--seconds", "90"]) == 0
    assert search.asked["seconds"] == 90.0
    capsys.readouterr()
    assert main(["diagnose", str(study), "--seconds", "0"]) == 2
    assert "--seconds" in capsys.readouterr().err


def test_where_nothing_was_found_there_is_no_repaired_model(study, search, capsys):
    search.found = replace(search.found, verdict="none", findings=())
    assert main(["diagnose", str(study), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["repaired_model"] is None
    assert not (study.parent / "axis_diagnosed" / "repaired_model.py").exists()


def test_the_terminal_has_the_verdict_first(study, search, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["diagnose", str(study)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("actuator: The model leaves out coulomb friction at carriage (f_c = ")
    assert "or input dead zone at input:F" in printed
    assert "axis_diagnosed/report.html" in printed
    assert main(["diagnose", str(study), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_the_folder_that_one_is_in_may_be_that_of_the_results(study, search, monkeypatch):
    """What is finished then lies beside it, as beside any other."""
    inside = study.parent / "inside"
    inside.mkdir()
    monkeypatch.chdir(inside)
    for named in (".", "../inside"):
        assert main(["diagnose", str(study), "--out", named]) == 0
        assert search.asked["keep"] == study.parent / ".inside.parts"
        assert not search.asked["keep"].exists()
    assert (inside / "result.json").exists()


def test_an_interrupt_keeps_what_is_finished_and_a_bad_problem_writes_nothing(study, search, capsys):
    search.found = KeyboardInterrupt()
    assert main(["diagnose", str(study)]) == 130
    assert str(study.parent / ".axis_diagnosed.parts") in capsys.readouterr().err
    assert (study.parent / ".axis_diagnosed.parts" / "part").exists()
    (study.parent / ".axis_diagnosed.parts" / "part").unlink()
    (study.parent / ".axis_diagnosed.parts").rmdir()
    search.found = InputError("nothing to learn from")
    assert main(["diagnose", str(study)]) == 2
    assert capsys.readouterr().err == "error: nothing to learn from\n"
    assert "axis_diagnosed" not in os.listdir(study.parent)


def test_without_convergence_what_there_is_is_written_and_marked(study, search, capsys):
    search.found = replace(diagnosis(), after=replace(diagnosis().after, solver=replace(diagnosis().after.solver, converged=False)))
    assert main(["diagnose", str(study), "--quiet"]) == 3
    assert "no convergence" in capsys.readouterr().err
    assert (study.parent / "axis_diagnosed" / "result.json").exists()


def said(verdict: str, **changes) -> str:
    finding = replace(diagnosis().findings[0], **changes)
    return sentence(replace(diagnosis(), verdict=verdict, findings=(finding,), held_out=None))


def test_what_was_found_beside_a_wrong_value_is_none():
    m = Strength(value=95.1, std=0.52, unit="kg")
    mass = Explanation(place="carriage", family="parameter", physics="wrong_parameter", parameters={"carriage.m": m})
    gain = Explanation(place="sensor:x", family="sensor", physics="sensor_gain")
    first = replace(diagnosis().findings[0], rivals=())
    friction = replace(first.explanation, parameters={})
    findings = tuple(replace(first, explanation=e) for e in (mass, friction, gain))
    assert sentence(replace(diagnosis(), verdict="parameter", findings=findings, held_out=None)) == (
        "A given value is wrong: carriage.m = 95.10 ± 0.52 kg. The model leaves out coulomb friction at carriage. "
        "A sensor does not read what the model supposes: sensor gain at sensor:x."
    )


def test_what_recordings_cannot_tell_apart_is_said_at_once():
    rivals = tuple(Explanation(place=f"input:{k}", family="actuator", physics="input_offset") for k in "abcde")
    for count, end in (
        (1, "it may be input offset at input:a: these recordings cannot tell."),
        (4, "or input offset at input:c or input offset at input:d: these recordings cannot tell."),
        (5, "or input offset at input:c or one of 2 more: these recordings cannot tell."),
    ):
        assert said("missing_physics", rivals=rivals[:count]).endswith(end)
    assert "cannot tell" not in said("missing_physics", rivals=())


def test_every_verdict_is_one_sentence():
    rival = Explanation(place="input:F", family="actuator", physics="input_offset")
    m = Strength(value=95.1, std=0.52, unit="kg")
    mass = Explanation(
        place="carriage",
        family="parameter",
        physics="wrong_parameter",
        parameters={"carriage.m": m},
    )
    assert said("parameter", explanation=mass, rivals=()) == "A given value is wrong: carriage.m = 95.10 ± 0.52 kg."
    assert said("undecided", rivals=(rival,)).endswith("which it is: coulomb friction at carriage and input offset at input:F.")
    refuted = replace(diagnosis(), verdict="undecided", held_out=replace(diagnosis().held_out, p_value=0.999, improvement_percent=-3.0))
    assert "would explain it where it was fitted alone" in sentence(refuted)
    assert said("unknown_physics") == "Something is missing at carriage that no member of the library explains."
    elsewhere = (Explanation(place="screw", family="unknown", physics="unknown_physics"),)
    torque = {"tau_x": Strength(value=0.0016, std=None, unit="N.m")}
    rolled = Explanation(place="body", family="unknown", physics="unknown_physics", parameters=torque)
    assert said("unknown_physics", explanation=rolled).startswith("Something is missing at body (tau_x) that no member")
    assert said("unknown_physics", rivals=elsewhere) == "Something is missing at carriage or screw that no member of the library explains."
    assert sentence(replace(diagnosis(), verdict="none", findings=(), held_out=None)).startswith("Nothing is missing")
    clean = replace(diagnosis(), verdict="none", findings=(), held_out=None)
    d = {"d": Strength(value=0.25, std=0.01, unit="N.m.s/rad")}
    slight = Explanation(place="hook", family="friction", physics="viscous_friction", parameters=d)
    fainter, clear = (Tried(explanation=slight, predicted=99.0, fitted=gain, refused=TOO_SMALL) for gain in (9.0, 11.0))
    assert sentence(replace(clean, tried=(*clean.tried, fainter))).startswith("Nothing is missing")
    assert sentence(replace(clean, tried=(fainter, clear, *clean.tried))) == (
        "Nothing that matters is missing: what stands out, viscous friction at hook (d = 0.250 ± 0.010 N.m.s/rad), "
        "is less than 1 % of what acts there."
    )
    with_proof = sentence(diagnosis())
    assert "On held.csv, which the fit has not seen, prediction errors are 75 % smaller with it (p = 0.001)." in with_proof
    few = replace(diagnosis(), held_out=replace(diagnosis().held_out, blocks=2, p_value=0.03))
    assert "smaller with it (p = 0.03 from 2 stretches)." in sentence(few)


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (20.314159, 0.1234, "N", "20.31 ± 0.12 N"),
        (1234567.0, 4321.0, "N/m", "1234600 ± 4300 N/m"),
        (3.0e-9, 2.0e-10, "1", "3.00e-09 ± 2.0e-10"),
        (0.25, None, "rad", "0.25 rad"),
        (0.25, float("inf"), "", "0.25"),
    ],
)
def test_a_strength_has_the_digits_that_its_deviation_leaves(value, std, unit, text):
    assert with_deviation(Strength(value=value, std=std, unit=unit)) == text


def test_a_diagnosis_without_a_proof_says_null():
    assert result_of_diagnosis(replace(diagnosis(), held_out=None))["held_out"] is None


def test_what_the_model_predicts_without_a_repair_has_no_gain_and_no_chance():
    had = diagnosis()
    told = result_of_diagnosis(replace(had, verdict="none", findings=(), held_out=had.held_out.unrepaired))["held_out"]
    assert told["before"] == told["after"]
    assert told["before"]["x"] == result_of_diagnosis(had)["held_out"]["before"]["x"]
    assert told["repaired"] is False
    assert math.isnan(told["improvement_percent"])  # null in the file
    assert math.isnan(told["p_value"])
    assert sentence(replace(had, verdict="none", findings=(), held_out=had.held_out.unrepaired)).endswith("stands out of these recordings.")
