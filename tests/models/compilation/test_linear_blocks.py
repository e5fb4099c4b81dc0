"""Blocks of algebraic variables that enter linearly are solved for; what is nonlinear or too large stays."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from backsight.models.compilation.eliminate import Heirs, Reduced
from backsight.models.compilation.flat import FlatEquation, FlatModel, FlatVariable
from backsight.models.compilation.index_reduction import Semi
from backsight.models.compilation.linear_blocks import solve_linear_blocks

X, DX = ca.SX.sym("body.x"), ca.SX.sym("der(body.x)")
Y = [ca.SX.sym(f"link.y{i}") for i in range(6)]


def system(rows: list[FlatEquation], z: list[Any]) -> tuple[FlatModel, Semi, Reduced]:
    variables = {s.name(): FlatVariable(name=s.name(), unit="1", rank=1) for s in (X, *z)}
    symbols = {s.name(): s for s in (X, *z)}
    flat = FlatModel(name="m", variables=variables, symbols=symbols, derivatives={"body.x": DX}, parameters={}, time=ca.SX.sym("time"))
    semi = Semi(x=[X], dx=[DX], z=z, equations=rows, invariants=[], index=3)
    return flat, semi, Reduced(flat=flat, equations=rows, definitions={"link.sum": ca.SX(sum(z))}, merged={})


def row(residual: Any, place: str = "", kind: Any = "equal") -> FlatEquation:
    return FlatEquation(residual=residual, name="row", component=place.partition(".")[0], kind=kind, slot=(place, "N") if place else None)


def test_a_linear_block_whose_coefficients_change_with_the_state_is_solved_for() -> None:
    rows = [row(DX - Y[0]), row(ca.cos(X) * Y[0] + Y[1] - 1), row(Y[0] - ca.cos(X) * Y[1] - X)]
    left, reduced = solve_linear_blocks(*system(rows, Y[:2]), {})
    assert (len(left.equations), left.z) == (1, [])
    at = 0.7
    exact = np.linalg.solve([[np.cos(at), 1.0], [1.0, -np.cos(at)]], [1.0, at])
    values = ca.Function("v", [X], [reduced.definitions[f"link.{name}"] for name in ("y0", "y1", "sum")])(at)
    assert [float(v) for v in values] == pytest.approx([*exact, exact.sum()])
    assert float(ca.Function("r", [X, DX], [left.equations[0].residual])(at, 2.0)) == pytest.approx(2.0 - exact[0])


def test_blocks_are_solved_in_the_order_in_which_they_need_each_other() -> None:
    rows = [row(DX - Y[2]), row(Y[2] - Y[1] * Y[0]), row(Y[1] - Y[0] ** 2), row(2 * Y[0] - X)]
    left, reduced = solve_linear_blocks(*system(rows, Y[:3]), {})
    assert left.z == []
    assert float(ca.Function("v", [X], [reduced.definitions["link.y2"]])(4.0)) == pytest.approx(8.0)


def test_a_nonlinear_block_stays_and_what_hangs_on_it_is_solved_for() -> None:
    rows = [row(DX - Y[1]), row(ca.sin(Y[0]) - X), row(ca.cos(Y[0]) * Y[1] - 1)]
    left, reduced = solve_linear_blocks(*system(rows, Y[:2]), {})
    assert [s.name() for s in left.z] == ["link.y0"]
    assert float(ca.Function("v", [Y[0]], [reduced.definitions["link.y1"]])(0.5)) == pytest.approx(1 / np.cos(0.5))


def test_a_block_of_more_than_four_stays() -> None:
    ring = [row(Y[i] + 2 * Y[(i + 1) % 5] - X) for i in range(5)]
    left, _ = solve_linear_blocks(*system([row(DX - Y[0]), *ring], Y[:5]), {})
    assert len(left.z) == 5


def test_a_block_that_is_singular_everywhere_stays() -> None:
    rows = [row(DX - Y[0]), row(ca.cos(X) * (Y[0] + Y[1]) - 1), row(Y[0] + Y[1] - X)]
    left, _ = solve_linear_blocks(*system(rows, Y[:2]), {})
    assert len(left.z) == 2


def test_an_equation_with_a_residual_is_used_only_when_its_body_moves_with_another() -> None:
    w = ca.SX.sym("w[link]")
    rows = [row(DX - 3 * Y[0], "body", "balance"), row(ca.cos(X) * Y[0] - X - w, "link", "balance")]
    slots = {"link": w, "body": ca.SX.sym("w[body]")}
    left, reduced = solve_linear_blocks(*system(rows, Y[:1]), slots)
    assert reduced.merged == {"link": Heirs(left=("row of body",))}
    assert float(ca.Function("r", [X, DX], [left.equations[0].residual])(0.5, 2.0)) == pytest.approx(2.0 - 3 * 0.5 / np.cos(0.5))
    law = [rows[0], row(ca.cos(X) * Y[0] - X - w, "link", "law")]
    left, reduced = solve_linear_blocks(*system(law, Y[:1]), slots)
    assert (len(left.z), reduced.merged) == (1, {})
