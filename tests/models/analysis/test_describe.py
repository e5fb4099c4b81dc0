"""Models as text: what is in it, that it fits the terminal, and that shortened equations say the same."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

from backsight.models import Component, Model, Variable, compile_model, equal
from backsight.models.analysis.describe import describe
from backsight.models.mechanics.translational import Mass, Rigid
from backsight.models.plants import actuator
from backsight.models.plants.five_bar import five_bar
from backsight.models.text import abbreviated, is_longer, wrapped


def section(text: str, title: str) -> str:
    """The block of a description that begins with `title`."""
    return next(block for block in text.split("\n\n") if block.startswith(title))


def test_flanges_that_meet_are_one_line() -> None:
    assert section(describe(actuator(), 120), "connections").splitlines()[1:] == [
        "  motor.flange = screw.flange_a = encoder.flange",
        "  screw.flange_b = carriage.flange = friction.flange_a = offset.flange_a",
        "  friction.flange_b = ground.flange = offset.flange_b",
    ]


def test_a_description_says_what_the_outputs_can_tell() -> None:
    assert section(describe(actuator(), 120), "what the outputs can tell").splitlines()[1] == "  all 4 parameters can be told from x"
    twice = actuator().insert("carriage", Mass(m=1.0), name="load")
    told = section(describe(twice, 120), "what the outputs can tell")
    assert "only in combination: carriage.m" in told
    assert "load.m" in told


def test_a_body_that_moves_with_another_is_named_where_its_residual_is() -> None:
    text = describe(actuator().insert("carriage", Mass(m=1.0), name="load"), 120)
    assert re.search(r"carriage stands for +load|load stands for +carriage", section(text, "places"))


@pytest.fixture(scope="module")
def loop() -> str:
    """The description of a plant with a closed loop."""
    return describe(five_bar(), 120)


def test_the_index_the_states_and_the_algebraic_variables_are_listed(loop: str) -> None:
    assert section(loop, "equations").startswith("equations (4 states, 2 algebraic variables, index 3, reduced)")
    assert [line.split()[0] for line in section(loop, "states").splitlines()[1:]] == [q.name for q in compile_model(five_bar()).states]
    assert [line.split()[0] for line in section(loop, "algebraic variables").splitlines()[1:]] == ["joint_3.phi", "joint_4.phi"]


@pytest.mark.slow
@pytest.mark.parametrize("width", [70, 110])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    for line in describe(five_bar(), width).splitlines():
        assert len(line) <= width or " " not in line.strip() or re.search(r"\S{40}", line), line


def test_a_model_that_cannot_run_is_described_all_the_same() -> None:
    class Nowhere(Component):
        """x' = log(-1 - x^2)."""

        x = Variable("1")

        def equations(self, c):  # type: ignore[no-untyped-def]
            return {"rate": equal(c.der(c.x), ca.log(-1 - c.x**2))}

    text = describe(Model(name="nowhere", components={"a": Nowhere()}, outputs={"x": "a.x"}))
    assert "not judged: no experiment with 'nowhere'" in " ".join(text.split())


def test_a_long_equation_is_broken_before_its_signs_and_loses_nothing() -> None:
    text = "a*der(b) = c*(d + e*(f - g)) + h*i*(j + k) - l*m + n"
    lines = wrapped(text, 24, 4)
    assert len(lines) > 2
    assert all(len(line) <= 24 for line in lines)
    assert all(line.lstrip()[0] in "=+-" for line in lines[1:])
    assert " ".join(line.strip() for line in lines) == text


def test_an_equation_without_signs_stays_in_one_line() -> None:
    assert wrapped("a*b*c*d*e*f*g*h*i", 8, 2) == ["a*b*c*d*e*f*g*h*i"]


def test_abbreviations_are_defined_before_their_use_and_mean_the_same() -> None:
    x, y = ca.SX.sym("first.coordinate"), ca.SX.sym("second.coordinate")
    inner = ca.sin(x * y) + ca.cos(x) * y**2
    outer = ca.exp(inner) * inner + x * ca.sin(inner * x)
    rows = [outer * outer + inner, outer / (1 + inner)]
    short, definitions = abbreviated(rows)
    assert [name for name, _ in definitions] == [f"e{i + 1}" for i in range(len(definitions))]
    assert len(definitions) >= 2
    known = {x.name(): 0.7, y.name(): -1.3}
    for name, value in definitions:
        symbols = ca.symvar(value)
        known[name] = float(ca.Function("f", symbols, [value])(*(known[s.name()] for s in symbols)))
    for row, brief in zip(rows, short, strict=True):
        symbols = ca.symvar(brief)
        found = float(ca.Function("f", symbols, [brief])(*(known[s.name()] for s in symbols)))
        assert found == pytest.approx(float(ca.Function("f", [x, y], [row])(0.7, -1.3)), rel=1e-12)


def test_lengths_of_shared_expressions_are_counted_without_writing_them_out() -> None:
    e = ca.SX.sym("x")
    for _ in range(200):  # 2^200 characters
        e = e * e + 1
    assert is_longer(e, 500)
    assert not is_longer(ca.SX.sym("x") + 1, 20)


def test_terms_that_are_absent_do_not_hide_what_is_there(loop: str) -> None:
    text = section(loop, "equations")
    note = " ".join(text.split("In the long ones")[1].split())
    assert "link_12.m_y" in note
    assert "link_12.m_y" not in text.split("In the long ones")[0]


def test_components_show_the_parameters_that_differ_from_their_defaults() -> None:
    lines = section(describe(actuator().replace("screw", Rigid()), 120), "components")
    assert "Mass(m=95.109)" in lines
    assert "Friction(d=203.5, f_c=20.394) " in lines  # not its width
    assert np.all([len(line) <= 120 for line in lines.splitlines()])
