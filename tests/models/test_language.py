"""The acausal language: what a component declares and what it refuses."""

import math
import pickle
from typing import Any

import pytest

from backsight.models import Component, Equation, Model, ModelError, Parameter, Variable, compile_model, equal
from backsight.models.mechanics.translational import Friction, Mass, Spring


def test_parameters_take_their_defaults_unless_given() -> None:
    assert Spring().k == 1.0
    assert dict(Spring(k=5.0).parameters) == {"k": 5.0, "s_rel0": 0.0}


def test_an_instance_cannot_be_changed() -> None:
    mass = Mass(m=2.0)
    with pytest.raises(AttributeError, match="Mass is immutable; make a new one"):
        mass.m = 3.0  # type: ignore[misc]
    with pytest.raises(AttributeError, match="immutable"):
        del mass.m
    with pytest.raises(TypeError):
        mass.parameters["m"] = 3.0  # type: ignore[index]
    assert mass.m == 2.0
    assert mass.with_values(m=3.0) == Mass(m=3.0) != mass


def test_equal_components_hash_alike_and_survive_pickling() -> None:
    assert hash(Mass(m=2.0)) == hash(Mass(m=2.0))
    assert pickle.loads(pickle.dumps(Friction(d=3.0))) == Friction(d=3.0)


@pytest.mark.parametrize(
    ("values", "error", "text"),
    [
        ({"mass": 2.0}, TypeError, r"Mass has no parameter 'mass' \(= 2.0\); did you mean 'm'|known: m"),
        ({"m": -1.0}, ModelError, r"Mass\(m=-1.0\): the value must lie between 0 and inf kg"),
        ({"m": math.nan}, ModelError, r"Mass\(m=nan\): the value must be finite"),
        ({"m": math.inf}, ModelError, r"Mass\(m=inf\): the value must be finite"),
        ({"m": "two"}, TypeError, r"Mass\(m='two'\): a parameter value is a number \[kg\], not str"),
        ({"m": "2.0"}, TypeError, r"Mass\(m='2.0'\): a parameter value is a number \[kg\], not str"),
        ({"m": True}, TypeError, r"Mass\(m=True\): a parameter value is a number \[kg\], not bool"),
        ({"m": None}, TypeError, r"not NoneType"),
    ],
)
def test_a_bad_parameter_value_is_refused_by_class_name_value_and_remedy(values: dict[str, Any], error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        Mass(**values)


def test_a_model_error_is_a_value_error() -> None:
    with pytest.raises(ValueError, match="between 0 and inf"):
        Mass(m=-1.0)


def test_a_word_of_the_language_cannot_be_declared() -> None:
    with pytest.raises(ModelError, match="'der' is a word of the language"):
        type("Wrong", (Component,), {"der": Variable("m")})


class Oscillator(Component):
    """x'' = -k x, with the second derivative written directly."""

    x = Variable("m", state=True)
    k = Parameter("1/s2", 1.0, min=0.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"oscillation": equal(c.der(c.der(c.x)), -c.k * c.x)}


def test_a_second_derivative_may_be_written_directly() -> None:
    dae = compile_model(Model(name="free", components={"o": Oscillator()}))
    assert [q.name for q in dae.states] == ["o.x", "o.x'"]


class Misspelt(Component):
    """Uses a name that it does not declare."""

    speed = Variable("m/s")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rest": equal(c.sped, 0)}


class NoList(Component):
    """Returns no dictionary."""

    x = Variable("m")

    def equations(self, c: Any) -> dict[str, Equation]:
        return [c.x]  # type: ignore[return-value]


class NoEquation(Component):
    """Forgets equal(...)."""

    x = Variable("m")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rest": c.x - 1}


@pytest.mark.parametrize(
    ("component", "text"),
    [
        (Misspelt(), r"'a' declares no 'sped'; did you mean 'speed'\?"),
        (NoList(), r"NoList 'a': equations\(\) must return a dictionary"),
        (NoEquation(), r"NoEquation 'a': equation 'rest' is a SX; write equal\(...\), balance\(...\) or law\(...\)"),
    ],
)
def test_a_component_written_wrongly_is_refused_by_name(component: Component, text: str) -> None:
    with pytest.raises(ModelError, match=text):
        compile_model(Model(name="m", components={"a": component}))


@pytest.mark.parametrize(
    ("parameter", "error", "text"),
    [
        (Parameter("N/m", -1.0, min=0.0), ModelError, r"Bad\.k = Parameter\(default=-1\.0\): the value must lie between 0 and inf N/m"),
        (Parameter("N/m", math.nan), ModelError, r"Bad\.k = Parameter\(default=nan\): the value must be finite"),
        (Parameter("N/m", "1"), TypeError, r"Bad\.k = Parameter\(default='1'\): a parameter value is a number"),  # type: ignore[arg-type]
    ],
)
def test_a_default_outside_its_own_bounds_is_refused_with_the_class(parameter: Parameter, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        type("Bad", (Component,), {"k": parameter})


def test_one_parameter_under_two_names_is_refused() -> None:
    shared = Parameter("N/m", 2.0)
    with pytest.raises(
        ModelError, match=r"Two\.k_2: the same Parameter\(\.\.\.\) is already called 'k_1'; write Parameter\(\.\.\.\) again"
    ):
        type("Two", (Component,), {"k_1": shared, "k_2": shared})
    again = type("Again", (Component,), {"k_1": shared})
    assert again(k_1=5.0).k_1 == 5.0
