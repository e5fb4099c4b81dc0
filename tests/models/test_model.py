"""Models as values: edits return new ones, wrong declarations are refused by name."""

import pickle
from dataclasses import FrozenInstanceError
from typing import Any

import pytest

from backsight.models import Model, ModelError, Output, Parameter, compile_model, simulate
from backsight.models.mechanics.rotational import EccentricRack, Inertia, Rack, RotationalDamper
from backsight.models.mechanics.translational import AddedMass, Damper, Fixed, Force, Mass, PositionSensor, Rigid, Spring
from backsight.models.plants import actuator, five_bar, quadrotor, xy_table
from backsight.models.signals import Lag, Sine


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
        ({"connections": [("motor.flange", "body.flange", "sensor.flange")]}, r"'sensor\.flange'\) is no connection, which connects two"),
        ({"connections": ["motor.flange"]}, "'motor.flange' is no connection, which connects two"),
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
    with pytest.raises(
        ModelError, match=r"replace\('screw', Mass\(...\)\): the model connects 'screw.flange_a' of Rigid 'screw', which Mass lacks"
    ):
        model.replace("screw", Mass())
    with pytest.raises(ModelError, match=r"no component 'spindle'"):
        model.without("spindle")


def test_a_rigid_place_may_be_left_in_series_and_parallel() -> None:
    model = axis().insert("motor.flange", Rigid().with_values(), name="twin")
    assert "ground" in model.components


def test_models_that_differ_in_the_order_of_parts_or_signals_are_different() -> None:
    model = axis(outputs={"x": "body.s", "v": "body.v"})
    assert model == axis(outputs={"x": "body.s", "v": "body.v"})
    assert model != axis(outputs={"v": "body.v", "x": "body.s"})
    turned = axis(components={"body": Mass(m=2.0), "motor": Force()}, outputs={"x": "body.s", "v": "body.v"})
    assert model != turned
    assert len({model, turned, axis(outputs={"x": "body.s", "v": "body.v"})}) == 2


def test_a_value_of_a_bound_parameter_is_refused_with_the_parameter_to_set() -> None:
    with pytest.raises(ModelError, match=r"link_12\.J is bound to P_1; use with_values\(P_1=\.\.\.\)"):
        five_bar().with_values(link_12={"J": 1.0})
    with pytest.raises(ModelError, match=r'rotor_1\.tau is bound to rotor\.tau; use with_values\(\*\*\{"rotor\.tau": \.\.\.\}\)'):
        quadrotor().with_values(rotor_1={"tau": 1.0})
    with pytest.raises(ModelError, match=r"wheel_1\.r is bound to r, so its value 0\.02 would have no effect"):
        xy_table().replace("wheel_1", EccentricRack(r=0.02))
    for same in (EccentricRack(), EccentricRack(r=0.010, amplitude=1e-4)):
        assert xy_table().replace("wheel_1", same).bindings["wheel_1.r"] == "r"


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (-5.0, ModelError, r"with_values\(P_1=-5\.0\): the value must lie between 0 and inf kg\.m2"),
        (float("nan"), ModelError, r"with_values\(P_1=nan\): the value must be finite"),
        (True, TypeError, r"with_values\(P_1=True\): a parameter value is a number \[kg\.m2\], not bool"),
        ("x", TypeError, r"with_values\(P_1='x'\): a parameter value is a number \[kg\.m2\], not str"),
    ],
)
def test_a_value_of_the_models_own_parameter_is_checked(value: Any, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        five_bar().with_values(P_1=value)


def test_a_parameter_of_the_model_respects_its_own_bounds_and_those_of_the_component() -> None:
    with pytest.raises(ModelError, match=r"parameter 'M' of model 'axis': Parameter\(default=9\): the value must lie between 0 and 5 kg"):
        axis(parameters={"M": Parameter("kg", 9, max=5.0, min=0.0)})
    with pytest.raises(ModelError, match=r"parameter 'M' of model 'axis', which is body\.m: the value must lie between 0 and inf kg"):
        axis(parameters={"M": Parameter("kg", -1.0)}, bindings={"body.m": "M"})


@pytest.mark.parametrize("std", [-1.0, 0.0, float("nan"), float("inf"), True, "x"])
def test_a_noise_that_is_no_positive_number_is_refused(std: Any) -> None:
    with pytest.raises(ModelError, match=r"Output\('body\.s', noise_std=.*\): a standard deviation is a positive number"):
        Output("body.s", noise_std=std)


@pytest.mark.parametrize("place", ["input:I_x", "input:I_y", "sensor:x_r", "sensor:ax_r"])
def test_without_undoes_insert_of_a_block(place: str) -> None:
    base = xy_table()
    once = base.insert(place, Lag(tau=0.1), "first")
    twice = once.insert(place, Lag(tau=0.2), "second")
    assert once.without("first") == base
    assert twice.without("second") == once
    assert twice.without("first") == base.insert(place, Lag(tau=0.2), "second")


def test_without_joins_what_a_block_stood_between() -> None:
    model = axis(
        components={"motor": Force(), "lag": Lag(), "sine": Sine(), "body": Mass()},
        connections=[("sine.y", "lag.u"), ("lag.y", "motor.f"), ("motor.flange", "body.flange")],
        inputs={},
        outputs={"F": "lag.y"},
    ).without("lag")
    assert model.connections == (("sine.y", "motor.f"), ("motor.flange", "body.flange"))
    assert model.outputs["F"].variable == "sine.y"


def test_replace_keeps_what_the_new_component_has_and_lets_go_of_the_rest() -> None:
    model = axis(start={"body.s": 1.0, "body.v": 2.0}, states=("body.v",), outputs={})
    gone = model.replace("body", AddedMass(m=1.0))
    assert dict(gone.start) == {"body.v": 2.0}
    assert gone.states == ("body.v",)
    assert model.replace("body", Mass(m=3.0)).start == model.start
    with pytest.raises(
        ModelError, match=r"replace\('body', AddedMass\(\.\.\.\)\): output 'x' measures 'body\.s' of Mass 'body', which AddedMass lacks"
    ):
        axis().replace("body", AddedMass())


def test_a_component_between_two_kinds_of_flanges_is_to_be_connected_on_both_sides() -> None:
    with pytest.raises(ModelError, match=r"Rack has Rotational and Translational flanges.*add it to components and connect both sides"):
        xy_table().insert("drive_1", Rack())


@pytest.mark.parametrize("word", ["states", "residuals"])
def test_a_text_where_a_list_of_names_belongs_is_refused(word: str) -> None:
    with pytest.raises(ModelError, match=rf"{word} = 'body' is a text, not a list; write \[\.\.\.\] even for one"):
        axis(**{word: "body"})


def test_a_single_place_is_given_in_a_list() -> None:
    with pytest.raises(ModelError, match=r"compile_model\(places='screw'\): a text is not a list; write places=\['screw'\]"):
        compile_model(actuator(), places="screw")


def test_a_model_is_simulated_as_it_is_and_what_is_no_model_is_refused_with_the_remedy() -> None:
    t = [0.0, 0.5, 1.0]
    assert simulate(actuator(), t, {"F": 30.0}).outputs["x"][-1] == simulate(compile_model(actuator()), t, {"F": 30.0}).outputs["x"][-1]
    with pytest.raises(ModelError, match=r"this is a function, not a Model; call it: compile_model\(name\(\)\)"):
        compile_model(actuator)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"Mass\(3\.0\): parameters are given by name; write Mass\(m=3\.0\)"):
        Mass(3.0)
