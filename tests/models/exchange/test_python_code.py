"""A model written as a Python file, read back by Python itself."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from backsight.models import Component, Model, ModelError, Output, Parameter
from backsight.models.exchange import python_code
from backsight.models.exchange.python_code import function_name
from backsight.models.mechanics.translational import Fixed, Force, Friction, Mass, PositionSensor, StribeckFriction
from backsight.models.plants import PLANTS
from backsight.models.signals import Lag


def read(code: str, model: Model) -> Model:
    there: dict = {}
    exec(compile(code, "model.py", "exec"), there)
    return there[function_name(model.name)]()


@pytest.mark.parametrize("name", sorted(PLANTS))
def test_every_plant_comes_back_equal(name):
    model = PLANTS[name]()
    assert read(python_code(model), model) == model


def test_what_was_edited_comes_back_too_with_every_digit():
    model = PLANTS["actuator"]().insert("input:F", Lag(tau=0.1 + 0.2), "slow").insert("carriage", StribeckFriction(f_s=1 / 3), "sticking")
    model = model.since("sticking.f_s", 3.2, 0.1).with_values(carriage={"m": 1e-300})
    back = read(python_code(model), model)
    assert back == model
    assert back.components["slow"].parameters["tau"] == 0.1 + 0.2
    assert dict(back.onsets) == {"sticking.f_s": (3.2, 0.1)}


def test_names_that_are_no_identifiers_noise_and_parameters_of_the_model_come_back():
    model = Model(
        name="2 masses, \'soft\'",
        components={"force": Force(), "a": Mass(m=2.0), "friction": Friction(d=1.0, f_c=0.0), "ground": Fixed(), "scale": PositionSensor()},
        connections=[("force.flange", "a.flange"), ("a.flange", "friction.flange_a"), ("friction.flange_b", "ground.flange"),
                     ("scale.flange", "a.flange")],
        inputs={"F": "force.f"},
        outputs={"x": Output("scale.s", noise_std=1e-6)},
        parameters={"all.m": Parameter("kg", 2.5, min=0.0, description="of both")},
        bindings={"a.m": "all.m"},
        start={"a.s": 0.1},
    )  # fmt: skip
    assert function_name(model.name) == "_2_masses___soft_"
    back = read(python_code(model, said='What a study found: C:\\\\new """ ' + 40 * "and more "), model)
    assert back == model
    assert back.measured["x"].noise_std == 1e-6


def test_a_component_of_a_users_own_is_named():
    class Own(Component):
        k = Parameter("1", 1.0)

    model = PLANTS["actuator"]()
    with pytest.raises(ModelError, match="component 'own' of 'actuator' is a Own"):
        python_code(Model(name=model.name, components={**model.components, "own": Own()}, connections=model.connections))


def test_the_file_is_written_as_the_house_writes(tmp_path: Path):
    assert python_code(PLANTS["xy_table"]()).startswith('"""The model xy_table."""\n\nfrom backsight.models import ')


OWN = """
from backsight.models import Model, law
from backsight.models.mechanics.translational import Element, Fixed, Force, Mass
from limits import LIMIT


class Magnet(Element):
    def equations(self, c):
        return {**super().equations(c), "attraction": law(c.f, LIMIT / (1.0 + c.s_rel**2))}


def drive():
    return Model(
        name="drive",
        components={"motor": Force(), "body": Mass(m=2.0), "magnet": Magnet(), "base": Fixed()},
        connections=[("motor.flange", "body.flange"), ("body.flange", "magnet.flange_a"), ("magnet.flange_b", "base.flange")],
        inputs={"F": "motor.f"},
        outputs={"s": "body.s"},
    )
"""


def loaded(file: Path, monkeypatch) -> ModuleType:
    """As a study loads it, under a name that no other file could import."""
    spec = spec_from_file_location("under_a_name_of_its_own", file)
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("out", ["", "results", "of/several"])
def test_a_component_of_a_users_own_file_is_imported_from_there(tmp_path, monkeypatch, out):
    """By the way from where the file will stand, wherever both are then."""
    (tmp_path / "here" / out).mkdir(parents=True)
    (tmp_path / "here" / "machine.py").write_text(OWN, encoding="utf-8")
    (tmp_path / "here" / "limits.py").write_text("LIMIT = 3.0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path / "here")
    model = loaded(tmp_path / "here" / "machine.py", monkeypatch).drive().with_values(body={"m": 1 / 3})
    code = python_code(model, folder=tmp_path / "here" / out)
    (tmp_path / "here" / out / "repaired.py").write_text(code, encoding="utf-8")
    (tmp_path / "here").rename(tmp_path / "there")
    done = subprocess.run(
        [sys.executable, "-c", "import repaired; print(sorted(type(c).__name__ for c in repaired.drive().components.values()), "
         "repaired.drive().components['body'].parameters['m'] == 1 / 3)"],
        cwd=tmp_path / "there" / out, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["['Fixed',", "'Force',", "'Magnet',", "'Mass']", "True"]
