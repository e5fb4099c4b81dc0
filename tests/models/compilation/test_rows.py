"""The occurrence index: it says at all times which rows hold which symbol."""

import casadi as ca
import numpy as np
import pytest

from backsight.models.compilation.rows import Held, Rows, steps

a, b, c, p = (ca.SX.sym(name) for name in "abcp")


def true_index(rows: Rows) -> dict[str, set[int]]:
    """Which rows hold which symbol, by looking at all of them."""
    found: dict[str, set[int]] = {}
    for i, held in rows.held.items():
        for symbol in ca.symvar(held.value):
            found.setdefault(symbol.name(), set()).add(i)
    return found


def test_a_symbol_that_cancels_is_not_held() -> None:
    held = Held((a + b) - a)
    assert list(held.symbols) == ["b"]
    assert [s.name() for s in ca.symvar(held.value)] == ["b"]


def test_slopes_are_those_of_the_expression_and_parameters_have_none() -> None:
    held = Held(p * a - a * b + 3 * c, fixed={"p"})
    assert list(held.slopes) == list(held.symbols) == ["a", "b", "c"]
    slopes = ca.Function("slopes", [a, b, p], [held.slopes["a"], held.slopes["b"], held.slopes["c"]])
    assert [float(slope) for slope in slopes(2.0, 5.0, 7.0)] == [7.0 - 5.0, -2.0, 3.0]


def test_an_equation_is_solved_for_what_it_holds_linearly() -> None:
    value = Held(p * a - b * c).solved_for("a")
    assert float(ca.Function("a", [b, c, p], [value])(3.0, 4.0, 2.0)) == 6.0


def test_the_index_follows_every_change() -> None:
    rows = Rows()
    for i, value in enumerate((a - b, b * c - 1, c - a, 2 * c - 4)):
        rows.put(i, Held(value))
    assert rows.where == true_index(rows)
    rows.settle()
    rows.substitute({"a": b + 1})
    assert rows.where == true_index(rows)
    assert rows.settle() == ({0, 2}, {"a"})  # row 0 has become a number
    rows.take(1)
    assert rows.where == true_index(rows)
    rows.put(3, Held(a - 4))
    assert rows.where == true_index(rows)
    assert rows.settle() == ({3}, {"a"})


def test_rows_that_do_not_hold_the_symbol_are_left_alone() -> None:
    rows = Rows()
    for i, value in enumerate((a - b, b - c)):
        rows.put(i, Held(value))
    untouched = rows.held[1]
    rows.substitute({"a": 2 * c})
    assert rows.held[1] is untouched
    assert rows.work == 2


@pytest.mark.parametrize("seed", range(3))
def test_a_substitution_changes_no_value(seed: int) -> None:
    point = np.random.default_rng(seed).uniform(0.5, 1.5, 3)
    rows, values = Rows(), (a * b + ca.sin(a * c), ca.sin(a * c) / b, b - c)
    for i, value in enumerate(values):
        rows.put(i, Held(value))
    rows.substitute({"a": b * c})
    before = ca.Function("before", [a, b, c], list(values))(point[1] * point[2], point[1], point[2])
    after = ca.Function("after", [b, c], [rows.held[i].value for i in range(3)])(point[1], point[2])
    assert [float(v) for v in after] == pytest.approx([float(v) for v in before], rel=1e-14)


def test_what_two_terms_share_is_one_node_after_a_substitution() -> None:
    rows = Rows()
    rows.put(0, Held(a * ca.sin(b + c) + b))
    rows.substitute({"a": ca.cos(ca.sin(b + c))})
    function = ca.Function("f", [b, c], [rows.held[0].value])
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    assert operations.count(ca.OP_SIN) == 1


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (2 * a + ca.sign(a) + b, {"a"}),
        (ca.if_else(a > b, c, 2 * c), {"a", "b"}),
        (ca.floor(a * b) + c, {"a", "b"}),
        (ca.fmod(a, b) + c, {"a", "b"}),
        (ca.remainder(a, b) + c, {"a", "b"}),
        (ca.copysign(a, b) + c, {"a", "b"}),
        (b * ca.if_else(ca.logic_not(a), 1, 2), {"a"}),
        (ca.fabs(a) + ca.tanh(b), set()),
    ],
)
def test_a_value_steps_in_what_is_compared_or_rounded(value: ca.SX, expected: set[str]) -> None:
    assert steps(value) == Held(value).steps == expected
