"""A start on linear constraints: the truth is the dense least-norm solution."""

from __future__ import annotations

import numpy as np
import pytest
from examples import number, random_horizon, stiffening

from backsight.models import Dae, compile_model
from backsight.models.plants import drillstring
from backsight.ocp import ParameterPrior, Solver, transcribe
from backsight.ocp.feasible import start_on_constraints

DRILL = compile_model(drillstring())


def program(dae: Dae, free: str, soft: tuple[int, ...], *, known: bool = False) -> tuple[Solver, np.ndarray]:
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    horizons = [random_horizon(dae, seed, intervals=3, known=known) for seed in range(2)]
    t = transcribe(dae, horizons, free=number(dae, free), prior=prior, force_std=dict.fromkeys(soft, 2.0))
    return Solver(t.nlp), np.random.default_rng(7).normal(size=t.nlp.size)


@pytest.mark.parametrize("held", [(), (0, 3, 11)])
def test_the_start_is_the_nearest_point_on_linear_constraints_that_leaves_what_is_fixed(held: tuple[int, ...]) -> None:
    solver, start = program(DRILL, "bha.J", (0, 1, 2))
    nlp, n = solver.nlp, solver.nlp.trajectory_size
    values = nlp.about(nlp.values(np.array([p.value for p in DRILL.parameters])), start)
    lower, upper = np.full(nlp.size, -np.inf), np.full(nlp.size, np.inf)
    lower[list(held)] = upper[list(held)] = 0.0
    X = start_on_constraints(nlp, values, lower, upper)
    c, J = nlp.evaluated.constraints(np.zeros(nlp.size), values), solver.jacobian(values.decisions(np.zeros(nlp.size)), values).toarray()
    movable = np.setdiff1d(np.arange(n), held)
    nearest = np.zeros(nlp.size)
    nearest[movable] = np.linalg.lstsq(J[:, movable], -c, rcond=None)[0]
    assert np.abs(c).max() > 0.1
    assert pytest.approx(nearest, abs=1e-8) == X
    assert np.abs(nlp.evaluated.constraints(X, values)).max() < 1e-8


def test_a_constraint_that_bends_leaves_the_start_as_it_is() -> None:
    dae = compile_model(stiffening())
    solver, start = program(dae, "mass.m", (0,))
    assert solver.nlp.constraint_count
    values = solver.nlp.about(solver.nlp.values(np.array([p.value for p in dae.parameters])), start)
    unbounded = np.full(solver.nlp.size, np.inf)
    assert not start_on_constraints(solver.nlp, values, -unbounded, unbounded).any()
