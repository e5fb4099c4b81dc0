"""Flattening: dotted names, origins, connection sets, and the errors of models that are not determined."""

from typing import Any

import casadi as ca
import pytest

from backsight.models import Component, Equation, Model, ModelError, Variable, compile_model, equal
from backsight.models.compilation.flat import connection_sets
from backsight.models.compilation.flatten import flatten
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, Spring
from backsight.models.plants import actuator


def test_every_equation_keeps_its_origin() -> None:
    origins = [equation.origin for equation in flatten(actuator()).equations]
    assert "force balance of carriage" in origins
    assert "connection screw.flange_b = carriage.flange (s)" in origins
    assert "force balance at the connection friction.flange_b = ground.flange = offset.flange_b" in origins
    assert len(origins) == len(set(origins))


def test_connections_that_share_a_flange_are_one_node() -> None:
    nodes = [set(node) for node in connection_sets(actuator())]
    assert {"screw.flange_b", "carriage.flange", "friction.flange_a", "offset.flange_a"} in nodes
    assert len(nodes) == 3


def test_a_node_has_equal_potentials_and_flows_that_sum_to_zero() -> None:
    flat = flatten(actuator())
    node = [e.residual for e in flat.equations if e.kind == "equal" and not e.component and "motor.flange" in e.origin]
    symbols = ca.vertcat(
        *(flat.symbols[f"{path}.{word}"] for path in ("motor.flange", "screw.flange_a", "encoder.flange") for word in "sf")
    )
    rows = ca.Function("node", [symbols], [ca.vertcat(*node)])
    assert rows([1, 5, 1, -2, 1, -3]).full()[:, 0].tolist() == [0, 0, 0]
    assert sorted(abs(rows([1, 5, 2, -2, 1, -4]).full()[:, 0])) == [0, 1, 1]


def test_a_flange_left_open_is_refused_by_name() -> None:
    model = Model(
        name="m", components={"body": Mass(), "spring": Spring(), "ground": Fixed()}, connections=[("body.flange", "spring.flange_a")]
    )
    with pytest.raises(ModelError, match=r"Spring 'spring': flange_b is not connected; connect 'spring.flange_b' to a flange or remove"):
        compile_model(model)


def test_an_undriven_source_is_named() -> None:
    model = Model(name="m", components={"motor": Force(), "body": Mass()}, connections=[("motor.flange", "body.flange")])
    with pytest.raises(ModelError, match=r"'motor': nothing drives its signal input 'f'; connect 'motor\.f'.* or name it as"):
        compile_model(model)


def test_two_grounds_on_a_body_are_over_determined_where_they_meet() -> None:
    model = Model(
        name="m",
        components={"body": Mass(), "here": Fixed(), "there": Fixed()},
        connections=[("body.flange", "here.flange"), ("body.flange", "there.flange")],
    )
    with pytest.raises(ModelError, match=r"over-determined: the equations .*'position of there'.*; and under-determined: .*flange.f"):
        compile_model(model)


class Pinned(Component):
    """Says twice what x is."""

    x = Variable("m")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"one": equal(c.x, 1), "two": equal(c.x, 2)}


def test_an_equation_too_many_is_named_with_its_variable() -> None:
    with pytest.raises(ModelError, match=r"over-determined: the equations 'one of a', 'two of a' \(2\) determine only a.x \(1\); remove 1"):
        compile_model(Model(name="m", components={"a": Pinned()}))


def test_an_input_on_a_variable_that_is_determined_already_is_over_determined() -> None:
    model = Model(
        name="m",
        components={"body": Mass(), "brake": Damper(), "ground": Fixed()},
        inputs={"f": "brake.f"},
        connections=[("body.flange", "brake.flange_a"), ("brake.flange_b", "ground.flange")],
    )
    with pytest.raises(ModelError, match=r"over-determined: .*damper law of brake.*or drive something else than brake.f"):
        compile_model(model)


def test_a_model_without_components_is_refused() -> None:
    with pytest.raises(ModelError, match=r"model 'empty' has no components; add some"):
        compile_model(Model(name="empty", components={}))
