"""Equations that carry no force, with one for a while: the same equations where it is nothing, and no constraints left."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from backsight.estimation import Problem, Recording
from backsight.estimation.smoothing.softened import softened
from backsight.models.plants import PLANTS


def posed(plant: str) -> Problem:
    model, t = PLANTS[plant](), np.linspace(0.0, 1.0, 11)
    recording = Recording(
        name="still", time=t, inputs=dict.fromkeys(model.inputs, 0 * t), outputs=dict.fromkeys(model.outputs, 0 * t),
        output_std=dict.fromkeys(model.outputs, 1.0),
    )  # fmt: skip
    return Problem(model=model, recordings=[recording])


def test_the_attitude_of_a_quadrotor_gets_a_residual_of_its_own():
    problem = posed("quadrotor")
    before, after = problem.dae, softened(problem).dae
    added = after.places[len(before.places) :]
    assert after.places[: len(before.places)] == before.places
    assert [p.unit for p in added] == [""] * 6
    rows = [r for r, e in enumerate(after.equations) if before.equations[r].place is None and e.place is not None]
    assert len(rows) == 6
    names = ("dx", "x", "z", "u", "p", "w", "t")
    rng = np.random.default_rng(0)
    values = [rng.standard_normal(getattr(after, n).shape[0]) for n in names]
    told = [ca.Function("F", [getattr(d, n) for n in names], [d.residual]) for d in (before, after)]
    own = len(before.places)
    old = np.asarray(told[0](*values[:5], values[5][:own], values[6])).ravel()
    new = np.asarray(told[1](*values)).ravel()
    expected = old.copy()
    expected[rows] += values[5][own:]
    assert new == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("plant", ["actuator", "xy_table", "drillstring"])
def test_where_every_such_equation_is_linear_nothing_changes(plant: str):
    problem = posed(plant)
    assert softened(problem) is problem
