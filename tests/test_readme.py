"""The README and the pages of the folders keep their word."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from backsight.estimation.command.cli import main

README = Path(__file__).resolve().parent.parent / "README.md"
ESTIMATION = README.parent / "estimation"


def examples(page: Path = README) -> list[str]:
    """The Python of a page, block by block."""
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.checkout
def test_the_first_example_prints_what_its_last_line_says(capsys):
    example = examples()[0]
    promised = re.search(r"# ([0-9.]+) ± ([0-9.]+) kg", example)
    assert promised is not None
    exec(compile(example, "README.md", "exec"), {})
    value, std = (float(word) for word in capsys.readouterr().out.replace("kg", "").split("±"))
    assert value == pytest.approx(float(promised[1]), abs=float(promised[2]))
    assert std == pytest.approx(float(promised[2]), rel=0.1)


@pytest.mark.checkout
def test_the_plant_of_the_readme_compiles():
    from backsight.models import compile_model

    example = next(e for e in examples() if "def drive" in e)
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    dae = compile_model(names["drive"]())  # type: ignore[operator]
    assert [q.name for q in dae.states] == ["motor.phi", "motor.omega", "load.phi", "load.omega"]


@pytest.mark.checkout
def test_the_example_of_a_weighting_study_finds_the_noise_of_the_simulated_axis():
    names: dict[str, Any] = {}
    for example in examples(ESTIMATION / "weighing" / "README.md"):
        exec(compile(example, "README.md", "exec"), names)
    low, high = names["study"].components["V of x"].interval
    assert low / 1.1 < 1e-6 < 1.1 * high
    assert [figure.data[0].type for figure in names["figures"]] == ["scatter", "heatmap", "scatter", "heatmap"]
    assert names["parameter_chart"](names["study"], "stage") is None


@pytest.mark.slow
@pytest.mark.checkout
def test_the_on_line_example_ends_at_the_friction_of_the_simulated_axis(capsys):
    exec(compile(examples(ESTIMATION / "tracking" / "README.md")[0], "README.md", "exec"), {})
    friction, std, _, *words = capsys.readouterr().out.split()
    assert abs(float(friction) - 20.0) < 4 * float(std)
    assert words[0] == "estimated"


@pytest.mark.slow
@pytest.mark.checkout
def test_the_bit_of_the_readme_is_followed(capsys):
    exec(compile(examples(ESTIMATION / "tracking" / "README.md")[1], "README.md", "exec"), {})
    assert float(capsys.readouterr().out.split()[0]) > 95.0


TUTORIAL = README.parent / "models" / "TUTORIAL.md"


@pytest.mark.slow
@pytest.mark.checkout
def test_the_tutorial_runs_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = examples(TUTORIAL)
    assert sum(line.strip() != "" for line in blocks[0].splitlines()) <= 25
    (tmp_path / "drive.py").write_text(blocks[0])
    monkeypatch.syspath_prepend(str(tmp_path))
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "TUTORIAL.md", "exec"), names)
    twist = re.search(r"the shaft twists by up to ([0-9.]+) rad", capsys.readouterr().out)
    assert twist is not None
    # the load's share of the torque over the stiffness, far below the resonance
    assert float(twist[1]) == pytest.approx(0.1 * 1e-3 / 1.2e-3 / 4.0, rel=0.25)
    assert (tmp_path / "two_mass_drive.fmu").exists()
    study = re.findall(r"```toml\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)[0]
    (tmp_path / "drive.toml").write_text(study)
    assert main(["smooth", "drive.toml", "--quiet"]) == 0
    parameters = json.loads((tmp_path / "drive" / "result.json").read_text())["parameters"]
    for name, truth in {"load.J": 1e-3, "shaft.k": 4.0, "bearing.tau_c": 0.02}.items():
        assert abs(parameters[name]["value"] - truth) < 4 * parameters[name]["std"], name


@pytest.mark.slow
@pytest.mark.checkout
def test_the_friction_that_was_kept_from_the_model_is_found():
    names: dict[str, object] = {"__name__": "readme"}
    exec(compile(next(e for e in examples() if "diagnose(" in e), "README.md", "exec"), names)
    found = names["found"]
    (finding,) = found.findings  # type: ignore[attr-defined]
    assert (finding.explanation.place, finding.explanation.physics) == ("carriage", "coulomb_friction")
    f_c = finding.explanation.parameters["f_c"]
    assert abs(f_c.value - 20.0) < 4 * f_c.std
    assert found.held_out.improvement_percent > 90  # type: ignore[attr-defined]
    assert found.held_out.p_value < 0.01  # type: ignore[attr-defined]


@pytest.mark.checkout
def test_the_pages_that_it_points_to_are_there():
    for page in (README, *ESTIMATION.glob("*/README.md")):
        targets = re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text(encoding="utf-8"))
        assert page != README or len(targets) > 5
        assert not [t for t in targets if not (page.parent / t).exists()], page


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.checkout
def test_the_table_of_classical_methods_is_the_one_that_its_example_makes():
    page, names = ESTIMATION / "classical" / "README.md", dict[str, object]()
    exec(compile(examples(page)[0], "README.md", "exec"), names)
    table = names["table"]
    for line in re.findall(r"^\| `(smooth|filtered_least_squares|prediction_error)` \|(.*) m \|$", page.read_text(encoding="utf-8"), re.M):
        promised = [float(cell) for cell in line[1].split("|")]
        row = table.loc[line[0]]  # type: ignore[attr-defined]
        found = [row[name] for name in ("carriage.m", "friction.d", "friction.f_c", "offset.f", "axis_held_out.csv.gz.x.ahead")]
        assert found == pytest.approx(promised, rel=0.05), line[0]


@pytest.mark.checkout
def test_the_page_on_smoothing_names_what_goes_in_and_comes_out(capsys):
    names: dict[str, Any] = {}
    exec(compile(examples(ESTIMATION / "smoothing" / "README.md")[0], "README.md", "exec"), names)
    assert names["result"].solver.converged
    assert abs(names["mass"].value - 95.0) < 4 * names["mass"].std
    assert {"x", "x.std", "x.measured", "carriage.v", "residual.carriage.std"} <= set(names["table"])
    assert str(names["mass"]) in capsys.readouterr().out
