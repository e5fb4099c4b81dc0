"""Units that make the program's numbers of order one without changing the problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import compiled, lagged, number, random_horizon

from backsight.ocp import Mesh, ParameterPrior, Solver, transcribe
from backsight.ocp.scaling import scaled

DAE = compiled(lagged())
PARAMETERS = np.array([p.value for p in DAE.parameters])


def program(method: str, degree: int, free: str = "mass.m"):
    h = random_horizon(DAE, 0, intervals=6, samples=7)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([np.inf]))
    h = replace(h, mesh=Mesh(h.time))  # samples on the knots: inner unknowns are seen by nothing but rounding
    t = transcribe(
        DAE,
        [replace(h, target_std=1e-5 * h.target_std)],
        free=number(DAE, free),
        prior=prior,
        force_std={0: 0.3},
        method=method,
        degree=degree,
    )
    return t, Solver(t.nlp)


@pytest.mark.parametrize("start", [0.0, 1.0], ids=["from zero", "from a motion"])
@pytest.mark.parametrize(("method", "degree"), [("spline", 2), ("spline", 3), ("collocation", 2), ("collocation", 3), ("collocation", 4)])
def test_units_are_positive_finite_and_not_made_of_rounding(method, degree, start):
    t, solver = program(method, degree)
    x = start * np.random.default_rng(0).normal(size=t.nlp.size)
    x[-1] = 2.0
    values = scaled(solver, x, t.nlp.values(PARAMETERS))
    assert np.all(np.isfinite(values.unit) & (values.unit > 0))
    assert values.unit.max() < 1e6, values.unit.max()
    assert all(np.all(np.isfinite(s)) for s in values.scale)


class Rounding(Solver):
    """What rounding leaves of a weight that is zero: larger programs have such ones."""

    def weights(self, decisions, values):
        return super().weights(decisions, values) + 1e-23


@pytest.mark.parametrize(("free", "own"), [("motor.T", True), ("mass.m", False)])
def test_a_parameter_of_constraints_alone_has_its_own_size_for_a_unit(free, own):
    """The time constant of a lag, in no balance that has a residual force, seen by no more than rounding; the mass is in one."""
    t, _ = program("spline", 2, free)
    solver = Rounding(t.nlp)
    x = np.random.default_rng(0).normal(size=t.nlp.size)
    x[-1] = 0.05
    assert bool(scaled(solver, x, t.nlp.values(PARAMETERS)).unit[-1] == 0.05) is own


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_cost_and_rows_do_not_depend_on_the_units(method):
    t, solver = program(method, 2)
    plain = t.nlp.values(PARAMETERS)
    x = np.random.default_rng(1).normal(size=t.nlp.size)
    x[-1] = 2.0
    better = scaled(solver, x, plain)
    cost = [t.nlp.evaluated.cost(v.scaled(x), v) for v in (plain, better)]
    assert cost[0] == pytest.approx(cost[1], rel=1e-12)


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_units_that_are_there_already_change_nothing(method):
    t, solver = program(method, 2)
    x = np.random.default_rng(1).normal(size=t.nlp.size)
    x[-1] = 2.0
    once = scaled(solver, x, t.nlp.values(PARAMETERS))
    again = scaled(solver, x, once)
    assert again.unit == pytest.approx(once.unit, rel=1e-12)


def test_rows_of_the_constraints_jacobian_are_of_order_one():
    t, solver = program("collocation", 2)
    x = np.random.default_rng(1).normal(size=t.nlp.size)
    x[-1] = 2.0
    _, J = solver.hessian(x, scaled(solver, x, t.nlp.values(PARAMETERS)))
    largest = abs(J).max(axis=1).toarray().ravel()
    assert 0.1 < np.median(largest) < 10.0
