"""Parameters that have their value from a time on."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.models import Model, compile_model, simulate
from backsight.models.errors import ModelError
from backsight.models.exchange.python_code import python_code
from backsight.models.mechanics.translational import ConstantForce, Friction, Mass
from backsight.models.signals import Gain

TIMES = np.linspace(0.0, 1.0, 11)


def axis(**more) -> Model:
    carriage = Model(name="axis", components={"carriage": Mass(m=2.0)}, outputs={"v": "carriage.v"}, start={"carriage.v": 1.0}, **more)
    return carriage.insert("carriage", ConstantForce(f=3.0), "push")


def test_what_sets_in_acts_from_its_time_on():
    model = axis().since("push.f", 0.4)
    found = simulate(model, TIMES).outputs["v"]
    assert found == pytest.approx(1.0 - 1.5 * np.maximum(TIMES - 0.4, 0.0), abs=1e-9)


def test_before_it_a_parameter_has_the_value_that_is_named():
    model = axis().since("push.f", 0.5, before=-3.0)
    found = simulate(model, TIMES).outputs["v"]
    assert found[-1] == pytest.approx(1.0, abs=1e-9)
    assert found[5] == pytest.approx(1.75, abs=1e-9)


def test_friction_that_sets_in_brings_to_rest():
    model = axis().insert("carriage", Friction(f_c=4.0), "rubs").since("rubs.f_c", 0.2).with_values(push={"f": 0.0})
    found = simulate(model, TIMES).outputs["v"]
    assert found == pytest.approx(np.maximum(1.0 - 2.0 * np.maximum(TIMES - 0.2, 0.0), 0.0), abs=1e-6)


def test_it_stays_with_its_component_and_goes_with_it():
    model = axis().insert("carriage", Friction(f_c=1.0), "rubs").since("rubs.f_c", 0.3)
    assert model.replace("rubs", Friction(f_c=2.0)).onsets == {"rubs.f_c": (0.3, 0.0)}
    assert model.replace("rubs", ConstantForce(f=2.0)).onsets == {}
    assert model.without("rubs").onsets == {}
    assert model.without("rubs") == axis()


def test_what_changes_is_larger_from_its_time_on():
    model = axis().changing("push.f", 0.4, "fallen", by=-1.0)
    found = simulate(model, TIMES).outputs["v"]
    assert found == pytest.approx(1.0 - 1.5 * TIMES + 0.5 * np.maximum(TIMES - 0.4, 0.0), abs=1e-9)
    assert model.parameters["fallen"].unit == "N"
    assert simulate(model.with_values(fallen=0.0), TIMES).outputs["v"] == pytest.approx(1.0 - 1.5 * TIMES, abs=1e-9)


@pytest.mark.parametrize("rate", [0.0, 1e-7, 2.0])
def test_what_changes_little_by_little_is_larger_by_all_of_it_in_the_end(rate):
    model = axis().changing("push.f", 0.2, "worn", by=-3.0, until=1.0, rate=rate)
    passed, r = np.maximum(TIMES - 0.2, 0.0), rate
    ramp, waning = passed**2 / 1.6, (passed - (1.0 - np.exp(-r * passed)) / (r or 1.0)) / (1.0 - np.exp(-0.8 * r) or 1.0)
    gone = waning if r > 1e-3 else ramp  # what the force has done, in closed form
    assert simulate(model, TIMES).outputs["v"] == pytest.approx(1.0 - 1.5 * (TIMES - gone), abs=1e-6)


def test_what_several_share_changes_for_all_of_them():
    twice = Model(
        name="two",
        components={"a": Mass(), "b": Mass()},
        parameters={"m": Mass().declared_parameters["m"]},
        bindings={"a.m": "m", "b.m": "m"},
        outputs={"a": "a.v", "b": "b.v"},
    )
    model = twice.insert("a", ConstantForce(f=1.0), "on_a").insert("b", ConstantForce(f=2.0), "on_b").with_values(m=2.0)
    model = model.changing("m", 0.5, "more", by=2.0)
    found, slower = simulate(model, TIMES).outputs, 0.25 * np.maximum(TIMES - 0.5, 0.0)
    assert found["a"] == pytest.approx(-0.5 * TIMES + slower, abs=1e-9)
    assert found["b"] == pytest.approx(2 * (-0.5 * TIMES + slower), abs=1e-9)
    assert model.replace("a", Mass()).changes == {"more": ("m", 0.5)}  # it is the model's
    space: dict[str, object] = {}
    exec(python_code(model), space)
    assert space["two"]() == model


def test_a_change_is_one_of_a_shared_parameter_at_one_component_alone():
    twice = Model(
        name="two",
        components={"a": Mass(m=1.0), "b": Mass(m=1.0)},
        parameters={"m": Mass().declared_parameters["m"]},
        bindings={"a.m": "m", "b.m": "m"},
        outputs={"a": "a.v", "b": "b.v"},
    )
    model = twice.insert("a", ConstantForce(f=1.0), "on_a").insert("b", ConstantForce(f=1.0), "on_b").with_values(m=2.0)
    found = simulate(model.changing("a.m", 0.5, "more", by=2.0), TIMES).outputs
    assert found["a"] == pytest.approx(-0.5 * TIMES + 0.25 * np.maximum(TIMES - 0.5, 0.0), abs=1e-9)
    assert found["b"] == pytest.approx(-0.5 * TIMES, abs=1e-9)


def test_a_change_goes_with_its_component_and_is_told_of():
    model = axis().changing("push.f", 0.3, "fallen", by=2.0)
    assert model.without("push") == axis().without("push")
    assert model.replace("push", Friction(f_c=2.0)).parameters == {}
    assert "push.f  + fallen from 0.3 s on" in model.describe()
    worn = axis().changing("push.f", 0.3, "worn", by=2.0, until=0.9, rate=1.0)
    assert "push.f  + worn little by little, from 0.3 s on, all of it at 0.9 s, at the rate worn_rate" in worn.describe()
    lent = worn.changing("push.f", 0.4, "lent", by=1.0, until=0.6)
    assert "push.f  + lent from 0.4 to 0.6 s" in lent.describe()
    exec(python_code(lent), space := {})
    assert space["axis"]() == lent
    assert worn.replace("push", Friction(f_c=2.0)).parameters == {}
    space: dict[str, object] = {}
    exec(python_code(model), space)
    assert space["axis"]() == model


@pytest.mark.parametrize(
    ("path", "time", "name", "said"),
    [
        ("push.g", 0.1, "fallen", "has no parameter 'g'"),
        ("pull.f", 0.1, "fallen", "has no component 'pull'"),
        ("push.f", float("inf"), "fallen", "a finite time"),
        ("push.f", 0.1, "taken", "has a parameter of the name taken"),
        ("push.f", 0.1, "of it", "must be words"),
        ("carriage.m", 0.1, "fallen", "which makes -1 of it"),
    ],
)
def test_what_cannot_change_is_refused(path, time, name, said):
    model = axis(parameters={"taken": Mass().declared_parameters["m"]})
    with pytest.raises(ModelError, match=said):
        model.changing(path, time, name, by=-3.0)


def test_a_change_by_nothing_that_there_is_is_refused():
    m, f = Mass().declared_parameters["m"], Friction().declared_parameters["f_c"]
    with pytest.raises(ModelError, match="has no parameter 'nothing'"):
        axis(changes={"nothing": ("carriage.m", 0.1)})
    with pytest.raises(ModelError, match=r"is in \[N\] and has to be in \[kg\]"):
        axis(parameters={"f": f}, changes={"f": ("carriage.m", 0.1)})
    with pytest.raises(ModelError, match="has no parameter 'rate'"):
        axis(parameters={"m": m}, changes={"m": ("carriage.m", 0.1, 0.2, "rate")})
    with pytest.raises(ModelError, match="which is itself a change"):
        axis().changing("push.f", 0.1, "a").changing("a", 0.2, "b")


def test_what_changes_for_a_while_and_again_is_the_sum():
    model = axis().changing("push.f", 0.2, "leant", by=3.0, until=0.4).changing("push.f", 0.3, "pushed", by=-1.0)
    more = 1.5 * (np.maximum(TIMES - 0.2, 0.0) - np.maximum(TIMES - 0.4, 0.0)) - 0.5 * np.maximum(TIMES - 0.3, 0.0)
    assert simulate(model, TIMES).outputs["v"] == pytest.approx(1.0 - 1.5 * TIMES - more, abs=1e-9)
    assert model.without("push") == axis().without("push")


@pytest.mark.parametrize(
    ("time", "given", "said"),
    [
        (0.1, {"rate": 2.0}, "what changes at once has none"),
        (0.1, {"until": 0.1, "rate": 0.0}, "until a later one"),
        (0.1, {"until": 0.1}, "until a later one"),
        (0.1, {"until": float("nan")}, "a finite time"),
        (0.1, {"until": 0.5, "rate": -1.0}, "-1"),
    ],
)
def test_what_cannot_change_little_by_little_is_refused(time, given, said):
    with pytest.raises(ModelError, match=said):
        axis().changing("push.f", time, "worn", by=1.0, **given)
    with pytest.raises(ModelError, match="has a parameter of the name worn_rate"):
        axis(parameters={"worn_rate": Mass().declared_parameters["m"]}).changing("push.f", 0.1, "worn", until=0.4, rate=0.0)


def test_what_sets_in_may_end():
    model = axis().since("push.f", 0.2, 1.0, until=0.5)
    more = np.maximum(TIMES - 0.2, 0.0) - np.maximum(TIMES - 0.5, 0.0)
    assert simulate(model, TIMES).outputs["v"] == pytest.approx(1.0 - 0.5 * TIMES - more, abs=1e-9)
    assert "push.f  from 0.2 to 0.5 s; 1 before" in model.describe()
    exec(python_code(model), space := {})
    assert space["axis"]() == model
    with pytest.raises(ModelError, match="until a later one"):
        axis().since("push.f", 0.4, until=0.4)


def test_the_description_tells_it():
    assert "push.f  from 0.4 s on; 0 before" in axis().since("push.f", 0.4).describe()


@pytest.mark.parametrize(
    ("path", "onset", "said"),
    [
        ("push.g", 0.1, "has no parameter 'g'"),
        ("pull.f", 0.1, "has no component 'pull'"),
        ("push.f", float("nan"), "a pair of finite numbers"),
        ("push.f", True, "a pair of finite numbers"),
    ],
)
def test_what_cannot_set_in_is_refused(path, onset, said):
    with pytest.raises(ModelError, match=said):
        axis().since(path, onset)


def test_a_block_in_a_signal_may_set_in_too():
    model = axis(inputs={}).insert("sensor:v", Gain(gain=2.0), "twice").since("twice.gain", 0.5, before=1.0)
    dae = compile_model(model)
    assert dae.parameters
    found = simulate(model.since("push.f", 5.0), TIMES).outputs["v"]
    assert found[2] == pytest.approx(1.0)
    assert found[8] == pytest.approx(2.0)
