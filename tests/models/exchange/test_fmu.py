"""FMU export: another importer reads it, and what it computes are the accelerations of the equations."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from backsight.models import InputError, ModelError, compile_model, simulate
from backsight.models.exchange.fmu import export_fmu
from backsight.models.plants import PLANTS


@pytest.mark.parametrize("name", list(PLANTS))
def test_every_plant_is_exported_and_imported_again_with_the_same_accelerations(tmp_path: Path, name: str) -> None:
    dae = compile_model(PLANTS[name]())
    path = export_fmu(dae, tmp_path / "plant.fmu", binary=False)
    again = ca.DaeBuilder("again", str(path))
    assert again.x() == [q.name for q in dae.states]
    assert again.u() == [q.name for q in dae.inputs]
    assert again.p() == [q.name for q in dae.parameters]
    x = np.array([q.start for q in dae.states]) + 0.01 * np.arange(1, len(dae.states) + 1)
    u, p = 0.3 * np.ones(len(dae.inputs)), np.array([q.value for q in dae.parameters])
    rates, outputs = (m.full().ravel() for m in again.create("f", ["x", "u", "p"], ["ode", "y"])(x, u, p))
    initial = {q.name: float(v) for q, v in zip(dae.states, x, strict=True)}
    given = {q.name: float(v) for q, v in zip(dae.parameters, p, strict=True)}
    here = simulate(dae, [0.0], {q.name: 0.3 for q in dae.inputs}, given, initial)
    assert_allclose(rates, [here.derivatives[q.name][0] for q in dae.states], rtol=1e-9, atol=1e-9)
    assert_allclose(outputs, [here.outputs[q.name][0] for q in dae.outputs], rtol=1e-9, atol=1e-9)


@pytest.mark.checkout
def test_another_tool_validates_and_simulates_it(tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMU binaries are an optional extra")
    from fmpy.validation import validate_fmu

    try:
        path = export_fmu(PLANTS["actuator"](), tmp_path / "actuator.fmu", binary=True)
    except InputError as error:
        pytest.skip(str(error))
    assert validate_fmu(str(path)) == []
    t, given = np.linspace(0, 1, 1001), {"friction.width": 1e-2, "carriage.m": 80.0}
    result = fmpy.simulate_fmu(
        str(path), stop_time=1.0, output_interval=1e-3, solver="CVode", relative_tolerance=1e-9, start_values={**given, "F": 50.0}
    )
    here = simulate(compile_model(PLANTS["actuator"]()), t, {"F": 50.0}, given)
    assert_allclose(np.interp(t, result["time"], result["x"]), here.outputs["x"], atol=1e-6 * np.ptp(here.outputs["x"]))


def test_a_path_that_is_no_fmu_is_refused_and_nothing_is_left_behind(tmp_path: Path) -> None:
    before = os.getcwd()
    with pytest.raises(InputError, match=r"the path ends in \.fmu and its folder exists"):
        export_fmu(PLANTS["actuator"](), tmp_path / "actuator.zip")
    with pytest.raises(InputError, match="its folder exists"):
        export_fmu(PLANTS["actuator"](), tmp_path / "none" / "actuator.fmu")
    export_fmu(PLANTS["actuator"](), tmp_path / "actuator.fmu", binary=False)
    assert [p.name for p in tmp_path.iterdir()] == ["actuator.fmu"]
    assert os.getcwd() == before


def test_a_relative_path_means_the_folder_the_caller_stands_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert export_fmu(PLANTS["actuator"](), "actuator.fmu", binary=False).resolve() == tmp_path / "actuator.fmu"


def test_constraints_between_states_are_refused_with_the_remedy(tmp_path: Path) -> None:
    loop = replace(PLANTS["five_bar"](), states=())
    with pytest.raises(ModelError, match=r"4 constraints between its states .* name the independent coordinates: Model\(states=\.\.\.\)"):
        export_fmu(loop, tmp_path / "loop.fmu", binary=False)


@pytest.mark.parametrize(("name", "what"), [("carriage.s", "a state"), ("F", "an input"), ("carriage.m", "a parameter")])
def test_an_output_with_the_name_of_another_quantity_is_refused(tmp_path: Path, name: str, what: str) -> None:
    twice = replace(PLANTS["actuator"](), outputs={name: "encoder.s"})
    with pytest.raises(ModelError, match=rf"output '{name}' of 'actuator' has the name of {what}; give it another"):
        export_fmu(twice, tmp_path / "twice.fmu", binary=False)
