"""Signals, shared components, bound parameters, start values: what the language says beside flanges."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backsight.models import (
    Component,
    Equation,
    Model,
    ModelError,
    Output,
    Parameter,
    Shared,
    SignalInput,
    SignalOutput,
    Translational,
    Variable,
    balance,
    compile_model,
    equal,
    law,
    simulate,
)
from backsight.models.mechanics.translational import Damper, Fixed, Mass, Spring


class Push(Component):
    """A force source told by a signal.   flange.f = -f"""

    f = SignalInput("N")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.f, -c.f)}


class Scale(Component):
    """y = k u"""

    u = SignalInput()
    y = SignalOutput()
    k = Parameter("1", 1.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"gain": equal(c.y, c.k * c.u)}


class Reading(Component):
    """s = flange.s"""

    s = SignalOutput("m")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no force": equal(c.flange.f, 0), "reading": equal(c.s, c.flange.s)}


class Slope(Component):
    """What all bodies see."""

    g = Parameter("m/s2", 9.81)


class Weight(Component):
    """A force m g down the slope."""

    slope = Shared(Slope)
    flange = Translational()
    m = Parameter("kg", 1.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"weight": law(c.flange.f, -c.m * c.slope.g)}


def axis(**changes: Any) -> Model:
    values: dict[str, Any] = {
        "name": "axis",
        "components": {"motor": Push(), "body": Mass(m=2.0), "gauge": Reading()},
        "connections": [("motor.flange", "body.flange"), ("gauge.flange", "body.flange")],
        "inputs": {"F": "motor.f"},
        "outputs": {"x": Output("gauge.s", noise_std=1e-6)},
    }
    return Model(**{**values, **changes})


def moved(model: Model, **inputs: float) -> float:
    """Where the body is after one second from rest."""
    return float(simulate(compile_model(model), np.linspace(0, 1, 11), inputs).outputs["x"][-1])


def test_a_signal_input_is_driven_by_the_model_and_gives_its_unit() -> None:
    dae = compile_model(axis())
    assert [(q.name, q.unit) for q in dae.inputs] == [("F", "N")]
    assert moved(axis(), F=3.0) == pytest.approx(3.0 / 2.0 / 2.0, rel=1e-9)


def test_a_block_put_into_an_input_scales_the_force_and_takes_its_unit() -> None:
    model = axis().insert("input:F", Scale(k=0.5), name="fade")
    dae = compile_model(model)
    assert [(q.name, q.unit) for q in dae.inputs] == [("F", "N")]
    assert moved(model, F=3.0) == pytest.approx(0.5 * 3.0 / 2.0 / 2.0, rel=1e-9)
    assert model.inputs == {"F": "fade.u"}


def test_a_block_put_behind_a_sensor_scales_the_reading_and_keeps_its_noise() -> None:
    model = axis().insert("sensor:x", Scale(k=1e3))
    [x] = compile_model(model).outputs
    assert (x.unit, x.noise_std) == ("m", 1e-6)
    assert moved(model, F=3.0) == pytest.approx(750.0, rel=1e-9)


def test_a_block_can_follow_a_plain_variable() -> None:
    model = axis(outputs={"x": "body.s"}).insert("sensor:x", Scale(k=2.0))
    assert moved(model, F=3.0) == pytest.approx(1.5, rel=1e-9)


def test_one_signal_drives_several_inputs() -> None:
    model = axis().insert("body", Push(), name="second").connect("motor.f", "second.f")
    assert moved(model, F=3.0) == pytest.approx(1.5, rel=1e-9)


def test_a_shared_component_is_seen_by_all() -> None:
    parts = {"body": Mass(m=2.0), "a": Weight(m=0.5), "b": Weight(m=1.5), "slope": Slope(g=4.0)}
    joined = [("a.flange", "body.flange"), ("b.flange", "body.flange")]
    model = axis(components=parts, connections=joined, inputs={}, outputs={"x": "body.s"})
    assert moved(model) == pytest.approx(4.0 * 2.0 / 2.0 / 2.0, rel=1e-9)
    with pytest.raises(ModelError, match=r"Weight 'a' needs the model's Slope, and 'axis' has none; add one, e\.g\. slope=Slope"):
        compile_model(model.without("slope"))
    with pytest.raises(ModelError, match=r"has 2 \(slope, other\); keep one"):
        compile_model(replace(model, components={**model.components, "other": Slope()}))


def bound() -> Model:
    return axis(
        components={"body": Mass(), "left": Spring(k=0.0), "right": Spring(k=0.0), "wall": Fixed(), "motor": Push()},
        connections=[
            ("body.flange", "left.flange_a"),
            ("body.flange", "right.flange_a"),
            ("body.flange", "motor.flange"),
            ("wall.flange", "left.flange_b"),
            ("wall.flange", "right.flange_b"),
        ],
        outputs={"x": "body.s"},
        parameters={"spring.k": Parameter("N/m", 7.0, min=0.0, description="stiffness of both")},
        bindings={"left.k": "spring.k", "right.k": "spring.k"},
    )


def test_a_parameter_of_the_model_stands_for_those_bound_to_it() -> None:
    dae = compile_model(bound())
    names = [p.name for p in dae.parameters]
    assert "spring.k" in names
    assert not {"left.k", "right.k"} & set(names)
    omega = np.sqrt(2 * 7.0)
    assert moved(bound(), F=1.0) == pytest.approx((1 - np.cos(omega)) / omega**2, rel=1e-8)
    stiff = bound().with_values(**{"spring.k": 20.0})
    assert moved(stiff, F=1.0) == pytest.approx((1 - np.cos(np.sqrt(40.0))) / 40.0, rel=1e-8)


def test_removing_or_exchanging_a_part_lets_its_bindings_go() -> None:
    assert bound().without("left").bindings == {"right.k": "spring.k"}
    assert bound().replace("left", Damper()).bindings == {"right.k": "spring.k"}


def test_a_start_value_of_the_model_is_where_it_starts() -> None:
    model = axis(start={"body.s": 0.25, "body.v": 1.0})
    assert moved(model, F=0.0) == pytest.approx(1.25, rel=1e-9)


def geared(**start: float) -> Model:
    from backsight.models.mechanics.rotational import Gear, Inertia

    return Model(
        name="geared",
        components={"fast": Inertia(J=1.0), "gear": Gear(ratio=4.0), "slow": Inertia(J=2.0)},
        connections=[("fast.flange", "gear.flange_a"), ("gear.flange_b", "slow.flange")],
        outputs={"phi": "slow.phi"},
        start={name.replace("_", ".", 1): value for name, value in start.items()},
    )


@pytest.mark.parametrize(("name", "value"), [("fast_phi", 2.0), ("slow_phi", 0.5)])
def test_a_start_value_of_a_coordinate_that_another_stands_for_is_handed_on(name: str, value: float) -> None:
    run = simulate(compile_model(geared(**{name: value})), [0.0])
    assert run.outputs["phi"][0] == pytest.approx(0.5, rel=1e-12)


def test_start_values_that_contradict_each_other_are_refused() -> None:
    assert simulate(compile_model(geared(fast_phi=2.0, slow_phi=0.5)), [0.0]).outputs["phi"][0] == pytest.approx(0.5)
    with pytest.raises(ModelError, match=r"start '.*' makes .*; keep one of them"):
        compile_model(geared(fast_phi=2.0, slow_phi=0.6))


def test_a_start_value_of_what_follows_from_several_states_is_refused_with_their_names() -> None:
    model = replace(bound(), start={"left.s_rel": 0.3})
    assert simulate(compile_model(model), [0.0], {"F": 0.0}).outputs["x"][0] == pytest.approx(0.3)
    with pytest.raises(ModelError, match=r"'motor\.flange\.f' follows from motor\.f \(.*\), without a start value; leave it out$"):
        compile_model(replace(axis(), start={"motor.flange.f": 1.0}))


def test_models_with_all_of_this_are_pickled_and_compared_by_value() -> None:
    model = replace(bound(), start={"body.s": 0.25}, states=("body.s",))
    assert pickle.loads(pickle.dumps(model)) == model
    assert hash(pickle.loads(pickle.dumps(model))) == hash(model)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"inputs": {}}, r"Push 'motor': nothing drives its signal input 'f'; connect 'motor\.f'"),
        ({"inputs": {"F": "gauge.s"}}, r"input 'F': 'gauge\.s' is a signal output"),
        ({"connections": [("gauge.s", "motor.f")]}, r"connection gauge\.s \[m\] = motor\.f \[N\]: the units differ"),
        ({"connections": [("gauge.s", "body.flange")]}, r"a signal output cannot be joined to a Translational flange"),
        ({"connections": [("body.s", "body.v")]}, r"two plain variables cannot be joined"),
        ({"parameters": {"body.m": Parameter("kg", 1.0)}}, r"parameter 'body\.m' of model 'axis' has the name of a parameter of component"),
        ({"parameters": {"P 1": Parameter("kg", 1.0)}}, r"parameter name 'P 1' must be words"),
        ({"bindings": {"body.m": "mm"}}, r"binding 'body\.m' = 'mm': model 'axis' has no parameter 'mm'"),
        ({"bindings": {"body.mass": "m"}}, r"binding 'body\.mass': Mass 'body' has no parameter 'mass'"),
        (
            {"parameters": {"m": Parameter("g", 1.0)}, "bindings": {"body.m": "m"}},
            r"binding 'body\.m' \[kg\] = 'm' \[g\]: the units differ",
        ),
        ({"start": {"body.x": 1.0}}, r"start 'body\.x': Mass 'body' has no variable 'x'"),
        ({"start": {"body.s": float("nan")}}, r"start 'body\.s' = nan: a finite number is needed"),
        ({"states": ("body.q",)}, r"state 'body\.q': Mass 'body' has no variable 'q'"),
        ({"residuals": ("motor",)}, r"has no place 'motor' for a residual"),
    ],
)
def test_a_wrong_declaration_is_refused_by_name(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ModelError, match=text):
        compile_model(axis(**change))


def test_two_sources_of_one_signal_are_refused() -> None:
    model = axis().insert("body", Push(), name="second")
    model = replace(model, inputs={"F": "motor.f", "G": "second.f"}).connect("motor.f", "second.f")
    with pytest.raises(
        ModelError, match=r"connection motor\.f = second\.f: driven by more than one source \(motor\.f, second\.f\); keep one"
    ):
        compile_model(model)


def test_units_that_meet_through_blocks_must_agree() -> None:
    parts = {"motor": Push(), "body": Mass(), "gauge": Reading(), "block": Scale()}
    joined = [("motor.flange", "body.flange"), ("gauge.flange", "body.flange"), ("gauge.s", "block.u"), ("block.y", "motor.f")]
    with pytest.raises(ModelError, match=r"connection of signals: the units of .* differ; put a gain between them"):
        compile_model(axis(components=parts, connections=joined, inputs={}))


@pytest.mark.parametrize(
    ("place", "block", "text"),
    [
        ("input:G", Scale(), r"insert at 'input:G': model 'axis' has no such input; "),
        ("output:x", Scale(), r"a place with a colon begins with 'input:' or 'sensor:'"),
        ("input:F", Mass(), r"Mass has 0 signal input\(s\), 0 signal output\(s\) and 1 flange\(s\); a block"),
        ("motor.f", Damper(), r"'motor\.f' is a SignalInput, not a connector"),
    ],
)
def test_a_block_where_it_does_not_belong_is_refused(place: str, block: Component, text: str) -> None:
    with pytest.raises(ModelError, match=text):
        axis().insert(place, block)


def test_a_component_with_variables_needs_equations() -> None:
    class Mute(Component):
        q = Variable("m")

    with pytest.raises(ModelError, match="Mute declares variables or connectors but no equations"):
        compile_model(axis(components={**axis().components, "mute": Mute()}))


class Handle(Component):
    """A mass with a second flange that may stay open."""

    v = Variable("m/s", state=True)
    flange = Translational()
    spare = Translational(optional=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "one body": equal(c.flange.s, c.spare.s),
            "velocity": equal(c.v, c.der(c.flange.s)),
            "force balance": balance(c.der(c.v), c.flange.f + c.spare.f),
        }


def test_an_optional_flange_may_stay_open_and_takes_what_is_put_there() -> None:
    parts = {"motor": Push(), "body": Handle(), "gauge": Reading()}
    model = axis(components=parts, connections=[("motor.flange", "body.flange"), ("gauge.flange", "body.flange")])
    assert moved(model, F=3.0) == pytest.approx(1.5, rel=1e-9)
    assert moved(model.insert("body.spare", Mass(m=2.0)), F=3.0) == pytest.approx(0.5, rel=1e-9)
