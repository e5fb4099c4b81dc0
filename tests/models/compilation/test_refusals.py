"""What flattening refuses: names that something else has, and equations that are no equations of symbols."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import pytest

from backsight.models import Component, Equation, Model, ModelError, Parameter, Translational, compile_model, equal
from backsight.models.mechanics.planar import FrameFixed, RigidBody, World
from backsight.models.mechanics.translational import Force
from backsight.models.plants import actuator


def held_by(law: Callable[[Any], Any]) -> Model:
    """A force against a component with that law of its position."""

    class Law(Component):
        """f = law(s)"""

        flange = Translational()
        k = Parameter("N/m", 2.0)

        def equations(self, c: Any) -> dict[str, Equation]:
            return {"law": equal(c.flange.f, law(c))}

    return Model(
        name="m",
        components={"motor": Force(), "part": Law()},
        connections=[("motor.flange", "part.flange")],
        inputs={"F": "motor.f"},
        outputs={"s": "part.flange.s"},
    )


@pytest.mark.parametrize("law", [lambda c: math.sin(c.flange.s), lambda c: c.k * c.flange.s + math.inf, lambda c: c.flange.s / 0])
def test_a_number_that_is_not_finite_is_refused_in_its_equation(law: Callable[[Any], Any]) -> None:
    with pytest.raises(ModelError, match=r"Law 'part': equation 'law' holds a number that is not finite; .*from casadi import sin"):
        compile_model(held_by(law))


def test_a_function_of_casadi_is_no_such_number() -> None:
    assert compile_model(held_by(lambda c: c.flange.s + ca.sin(c.flange.s) / 2)).residual.shape[0] == 1


@pytest.mark.parametrize("law", [lambda c: c.k if c.flange.s > 0 else 0.0, lambda c: max(c.flange.s, 0.0)])
def test_a_branch_on_a_symbol_is_refused_with_its_remedy(law: Callable[[Any], Any]) -> None:
    with pytest.raises(ModelError, match=r"Law 'part': its equations ask whether a symbol is true .*casadi\.if_else\(condition, yes, no\)"):
        compile_model(held_by(law))


def test_other_errors_in_equations_are_their_own() -> None:
    with pytest.raises(ZeroDivisionError):
        compile_model(held_by(lambda c: c.flange.s + 1 / 0))


def test_a_base_class_is_refused_with_the_classes_to_use() -> None:
    model = Model(
        name="m", components={"world": World(), "part": RigidBody(), "held": FrameFixed()}, connections=[("part.frame", "held.frame")]
    )
    with pytest.raises(ModelError, match=r"RigidBody 'part' is an unfinished component \(.*\); use Body, MomentBody"):
        compile_model(model)


@pytest.mark.parametrize(
    ("name", "whose"), [("time", "the time"), ("carriage.v", "a variable of 'carriage'"), ("screw.flange_a.f", "a variable of 'screw'")]
)
def test_a_parameter_of_the_model_with_the_name_of_something_else_is_refused(name: str, whose: str) -> None:
    model = replace(actuator(), parameters={name: Parameter("kg", 95.0)}, bindings={"carriage.m": name})
    with pytest.raises(ModelError, match=rf"parameter '{name}' of model 'actuator' has the name of {whose}; rename it"):
        compile_model(model)


@pytest.mark.parametrize(
    ("name", "whose"),
    [
        ("time", "the time"),
        ("carriage.v", "a variable of 'carriage'"),
        ("carriage.m", "a parameter of 'carriage'"),
        ("mass", "a parameter of the model"),
    ],
)
def test_an_input_with_the_name_of_something_else_is_refused(name: str, whose: str) -> None:
    model = replace(actuator(), parameters={"mass": Parameter("kg", 95.0)}, inputs={name: "motor.f"})
    with pytest.raises(ModelError, match=rf"input '{name}' \('motor.f'\) of model 'actuator' has the name of {whose}; rename it"):
        compile_model(model)


def test_an_input_may_have_the_name_of_what_it_drives() -> None:
    assert [q.name for q in compile_model(replace(actuator(), inputs={"motor.f": "motor.f"})).inputs] == ["motor.f"]
