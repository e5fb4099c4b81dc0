"""Equations and models as text."""

import casadi as ca
import pytest

from backsight.models import compile_model, equations_text
from backsight.models.plants import actuator
from backsight.models.text import expression_text

a, b, c = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("c")


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (a + b - c, "a + b - c"),
        (a - (b - c), "a + c - b"),
        (-(a + b), "-a - b"),
        (a * (b + c), "a*(b + c)"),
        (a / (b * c), "a/(b*c)"),
        (a * b / c, "a*b/c"),
        ((a + b) ** 2, "(a + b)^2"),
        (2 * a, "2*a"),
        (ca.tanh(a / b), "tanh(a/b)"),
        (ca.sin(a) * ca.exp(-b), "sin(a)*exp(-b)"),
        (a**2.5 + 1.5, "a^2.5 + 1.5"),
        (ca.atan2(a, b), "atan2(a, b)"),
        (a - 0.25, "a - 0.25"),
        (1 / a, "1/a"),
        (b + 1 / a, "b + 1/a"),
        (1 / (a * b), "1/(a*b)"),
        (a ** (1 / b), "a^(1/b)"),
        ((1 / a) ** 2, "(1/a)^2"),
        (a**-2, "1/a^2"),
        (a**-2.5, "a^(-2.5)"),
        (-(a**2), "-a^2"),
        (2 * (a + b), "2*(a + b)"),
        (ca.sqrt(a) / b, "sqrt(a)/b"),
    ],
)
def test_an_expression_reads_without_needless_brackets(expression: ca.SX, text: str) -> None:
    assert expression_text(expression) == text


_ONE = (
    "sin",
    "cos",
    "tan",
    "sinh",
    "cosh",
    "tanh",
    "asinh",
    "atan",
    "exp",
    "expm1",
    "erf",
    "fabs",
    "floor",
    "ceil",
    "sign",
    "sqrt",
    "log",
    "log1p",
    "asin",
    "acos",
    "atanh",
    "erfinv",
    "acosh",
)
_TWO = ("fmin", "fmax", "atan2", "hypot", "fmod", "remainder", "copysign")


@pytest.mark.parametrize("name", _ONE)
def test_a_function_of_something_that_is_used_twice_is_called_by_its_name(name: str) -> None:
    inner = a + b
    assert expression_text(getattr(ca, name)(inner) * inner) == f"{name}(a + b)*(a + b)"


@pytest.mark.parametrize("name", _TWO)
def test_a_function_of_two_is_called_by_its_name(name: str) -> None:
    both = getattr(ca, name)(a * b, c)
    assert expression_text(both + c * both) == f"{name}(a*b, c) + c*{name}(a*b, c)"


def test_the_balance_of_the_axis_reads_like_the_textbook() -> None:
    lines = equations_text(compile_model(actuator())).splitlines()
    assert lines[0] == "der(carriage.s) = carriage.v    [velocity of carriage]"
    assert lines[1].startswith(
        "carriage.m*der(carriage.v) = F - friction.d*carriage.v - friction.f_c*tanh(carriage.v/friction.width) - offset.f + w[carriage]"
    )
    assert lines[2] == "x = encoder.gain*carriage.s + encoder.bias    [output]"


def test_a_model_describes_all_that_a_user_may_name() -> None:
    text = actuator().describe()
    for word in (
        "motor.flange = screw.flange_a",
        "carriage.m",
        "95.109 kg",
        "friction.width",
        "smoothing, no physics",
        "force balance of carriage",
        "off unless asked for",
        "residual on",
        "F  [N]  motor.f",
        "x  [m]  encoder.s",
    ):
        assert word in text


def test_a_sum_of_thousands_of_terms_is_written_without_running_out_of_stack() -> None:
    x = ca.SX.sym("x", 3000)
    total = x[0]
    for i in range(1, 3000):
        total = total + x[i]
    assert expression_text(total).count(" + ") == 2999


def test_a_condition_reads_as_one() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    assert expression_text(ca.if_else(x < y, x, 0)) == "x if x < y else 0"
    assert expression_text(1 + ca.if_else(x < y, x, 0)) == "1 + (x if x < y else 0)"
