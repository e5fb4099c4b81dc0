"""Models as values: edits return new ones, wrong declarations are refused by name."""

import pickle
from dataclasses import FrozenInstanceError
from typing import Any

import pytest

from backsight.models import Model, ModelError, Output, compile_model
from backsight.models.mechanics.rotational import Inertia, RotationalDamper
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, PositionSensor, Rigid, Spring
from backsight.models.plants import actuator


def axis(**changes: Any) -> Model:
    values: dict[str, Any] = {
        "name": "axis",
        "components": {"motor": Force(), "body": Mass(m=2.0)},
        "connections": [("motor.flange", "body.flange")],
        "inputs": {"F": "motor.f"},
        "outputs": {"x": "body.s"},
    }
    return Model(**{**values, **changes})


def test_a_model_cannot_be_changed() -> None:
    model = axis()
    with pytest.raises(FrozenInstanceError):
        model.name = "other"  # type: ignore[misc]
    with pytest.raises(TypeError):
        model.components["more"] = Mass()  # type: ignore[index]
    assert isinstance(model.connections, tuple)


def test_a_change_of_the_dictionary_handed_in_does_not_reach_the_model() -> None:
    parts = {"motor": Force(), "body": Mass(m=2.0)}
    model = axis(components=parts)
    parts["body"] = Mass(m=9.0)
    assert model.components["body"] == Mass(m=2.0)


def test_a_model_survives_pickling_and_hashes_by_value() -> None:
    model = actuator()
    copy = pickle.loads(pickle.dumps(model))
    assert copy == model
    assert hash(copy) == hash(model)


def test_an_output_carries_its_noise_when_told() -> None:
    model = axis(outputs={"x": Output("body.s", noise_std=1e-6), "v": "body.v"})
    assert [q.noise_std for q in compile_model(model).outputs] == [1e-6, None]


def test_insert_at_a_body_puts_an_element_between_it_and_a_new_ground() -> None:
    base = axis()
    braked = base.insert("body", Damper(d=4.0), name="brake")
    assert set(braked.components) - set(base.components) == {"brake", "ground"}
    assert ("body.flange", "brake.flange_a") in braked.connections
    assert ("brake.flange_b", "ground.flange") in braked.connections
    assert set(base.components) == {"motor", "body"}
    assert compile_model(braked).states[1].name == "body.v"


def test_insert_uses_the_ground_that_is_there() -> None:
    twice = axis().insert("body", Damper(d=4.0)).insert("body", Spring(k=3.0))
    assert [name for name, c in twice.components.items() if isinstance(c, Fixed)] == ["ground"]
    assert "damper" in twice.components
    assert "spring" in twice.components


def test_insert_at_an_element_goes_in_parallel_with_it() -> None:
    model = actuator().insert("friction", Spring(k=10.0), name="stop")
    assert ("friction.flange_a", "stop.flange_a") in model.connections
    assert ("friction.flange_b", "stop.flange_b") in model.connections


def test_insert_joins_a_one_flange_component_to_a_named_flange() -> None:
    compliant = actuator().replace("screw", Spring(k=1e6)).insert("screw.flange_a", Mass(m=5.0), name="nut")
    assert [q.name for q in compile_model(compliant).states] == ["carriage.s", "carriage.v", "nut.s", "nut.v"]


def test_without_undoes_insert() -> None:
    base = axis()
    assert base.insert("body", Damper(d=4.0), name="brake").without("brake") == base


def test_with_values_changes_parameters_only() -> None:
    model = axis().with_values(body={"m": 7.0})
    assert model.components["body"] == Mass(m=7.0)
    assert model.connections == axis().connections


def test_connect_joins_several_flanges_in_one_node() -> None:
    loose = axis(components={"motor": Force(), "body": Mass(), "sensor": PositionSensor()}, connections=[])
    joined = loose.connect("body.flange", "motor.flange", "sensor.flange")
    assert joined.connections == (("body.flange", "motor.flange"), ("body.flange", "sensor.flange"))
    assert [q.name for q in compile_model(joined).states] == ["body.s", "body.v"]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"connections": [("motor.flange", "bdy.flange")]}, r"no component 'bdy'; did you mean 'body'\?"),
        ({"connections": [("motor.flange", "body.flnge")]}, r"'body.flnge' is no connector of Mass 'body'; did you mean 'body.flange'\?"),
        ({"connections": [("motor.flange", "body")]}, r"'body' is no connector of Mass 'body'"),
        ({"connections": [("body.flange", "body.flange")]}, "cannot be joined to itself"),
        ({"inputs": {"F": "motor.ff"}}, r"input 'F': Force 'motor' has no variable 'ff'; did you mean 'motor.f'\?"),
        ({"outputs": {"x": "body.position"}}, r"output 'x': Mass 'body' has no variable 'position'"),
        ({"outputs": {"x": "boddy.s"}}, r"no component 'boddy'; did you mean 'body'\?"),
        ({"inputs": {"F": "motor.f", "G": "motor.f"}}, "'motor.f' is driven by more than one input"),
        ({"components": {"motor": Force(), "body": Mass}}, r"component 'body' is .*Mass.*, which is no component; write Mass\(...\)"),
        ({"components": {"motor": Force(), "body": 3}}, "component 'body' is 3, which is no component"),
        ({"components": {"motor": Force(), "body": Mass(), "a.b": Mass()}}, r"component name 'a.b' must be a word"),
        (
            {"components": {"motor": Force(), "body": Inertia()}, "outputs": {}},
            "connection motor.flange = body.flange: a Translational flange cannot be joined to a Rotational flange; put a component",
        ),
    ],
)
def test_a_wrong_declaration_is_refused_by_name(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ModelError, match=text):
        axis(**change)


def test_wrong_edits_are_refused_with_the_remedy() -> None:
    model = actuator()
    with pytest.raises(ModelError, match=r"no component 'cariage'; did you mean 'carriage'\?"):
        model.insert("cariage", Damper())
    with pytest.raises(ModelError, match=r"already has a component 'friction'; choose another name"):
        model.insert("carriage", Damper(), name="friction")
    with pytest.raises(ModelError, match=r"RotationalDamper has Rotational flanges, the place is Translational"):
        model.insert("carriage", RotationalDamper())
    with pytest.raises(ModelError, match=r"name one flange: 'screw.flange_a' or 'screw.flange_b'"):
        model.insert("screw", Mass())
    with pytest.raises(ModelError, match=r"input 'F' is its variable 'motor.f'; point the input elsewhere first"):
        model.without("motor")
    with pytest.raises(ModelError, match=r"output 'x' is its variable 'encoder.s'"):
        model.without("encoder")
    with pytest.raises(ModelError, match=r"'screw.flange_a' is no connector of Mass 'screw'"):
        model.replace("screw", Mass())
    with pytest.raises(ModelError, match=r"no component 'spindle'"):
        model.without("spindle")


def test_a_rigid_place_may_be_left_in_series_and_parallel() -> None:
    model = axis().insert("motor.flange", Rigid().with_values(), name="twin")
    assert "ground" in model.components
