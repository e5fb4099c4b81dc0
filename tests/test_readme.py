"""The README keeps its word."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).resolve().parent.parent / "README.md"


@pytest.mark.skipif(not README.exists(), reason="the README lies beside the tests in a checkout only")
def test_the_first_example_prints_what_its_last_line_says(capsys):
    example = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[0]
    promised = re.search(r"# ([0-9.]+) ± ([0-9.]+) kg", example)
    assert promised is not None
    exec(compile(example, "README.md", "exec"), {})
    value, std = (float(word) for word in capsys.readouterr().out.replace("kg", "").split("±"))
    assert value == pytest.approx(float(promised[1]), abs=float(promised[2]))
    assert std == pytest.approx(float(promised[2]), rel=0.1)


@pytest.mark.skipif(not README.exists(), reason="the README lies beside the tests in a checkout only")
def test_the_plant_of_the_tutorial_compiles():
    from backsight.models import compile_model

    example = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[1]
    names: dict[str, object] = {}
    exec(compile(example, "README.md", "exec"), names)
    dae = compile_model(names["drive"]())  # type: ignore[operator]
    assert [q.name for q in dae.states] == ["motor.phi", "motor.omega", "load.phi", "load.omega"]
