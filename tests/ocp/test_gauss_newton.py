"""Least squares within bounds: the truth is a dense trust-region solver's, on the same rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from examples import number, random_horizon

from backsight.models import compile_model
from backsight.models.plants import actuator
from backsight.ocp import ParameterPrior, Solver, transcribe
from backsight.ocp.gauss_newton import descend, knots_and_interiors

DAE = compile_model(actuator())
PARAMETERS = np.array([0.0 if p.name == "friction.f_c" else p.value for p in DAE.parameters])  # without a sign: one minimum


def program(horizons: int = 2) -> tuple[Solver, np.ndarray]:
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    parts = [random_horizon(DAE, seed, intervals=3) for seed in range(horizons)]
    t = transcribe(DAE, parts, free=number(DAE, "carriage.m"), prior=prior, force_std={0: 2.0})
    start = np.full(t.nlp.size, 0.1)
    start[-1] = 1.0
    return Solver(t.nlp), start


def reference(solver: Solver, start: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> scipy.optimize.OptimizeResult:
    values = solver.nlp.about(solver.nlp.values(PARAMETERS), start)

    def rows(X: np.ndarray) -> np.ndarray:
        return np.concatenate([r.ravel() for r in solver.nlp.evaluated.rows(X, values)])

    bounds = (lower - start, upper - start)
    return scipy.optimize.least_squares(rows, np.clip(0.0, *bounds), bounds=bounds, jac="3-point", xtol=1e-14, ftol=1e-14, gtol=1e-10)


@pytest.mark.parametrize("bounded", [False, True])
def test_the_least_squares_are_those_of_a_dense_solver_with_and_without_bounds(bounded: bool) -> None:
    solver, start = program()
    lower, upper = np.full(start.shape, -np.inf), np.full(start.shape, np.inf)
    lower[-1] = 0.1
    values = solver.nlp.about(solver.nlp.values(PARAMETERS), start)
    if bounded:
        free = start + descend(solver.nlp, values, lower - start, upper - start, 1e-9, 50).X
        upper[-1], upper[3], lower[5] = 0.8 * free[-1], free[3] - 0.05, free[5] + 0.05
        start = np.clip(start, lower, upper)
        values = solver.nlp.about(solver.nlp.values(PARAMETERS), start)
    found = descend(solver.nlp, values, lower - start, upper - start, 1e-9, 50)
    dense = reference(solver, start, lower, upper)
    assert found.solved or found.acceptable
    assert found.cost == pytest.approx(dense.cost, rel=1e-8)
    assert pytest.approx(dense.x, abs=1e-4 * np.abs(dense.x).max()) == found.X
    if bounded:
        assert start[3] + found.X[3] == upper[3]


def test_steps_that_may_take_no_time_leave_off_where_they_began() -> None:
    solver, start = program()
    wide = np.full(start.shape, np.inf)
    values = solver.nlp.about(solver.nlp.values(PARAMETERS), start)
    found = descend(solver.nlp, values, -wide, wide, 1e-9, 50, seconds=-1.0)
    assert (found.iterations, found.solved, found.acceptable) == (0, False, False)
    assert np.array_equal(found.X, np.zeros_like(start))


def test_the_blocks_of_several_horizons_add_up_to_the_whole_matrix() -> None:
    solver, start = program(3)
    values = solver.nlp.about(solver.nlp.values(PARAMETERS), start)
    evaluated, n = solver.nlp.evaluated, solver.nlp.trajectory_size
    parts = [evaluated.linearised(k, np.zeros(solver.nlp.size), values) for k in range(len(solver.nlp.terms))]
    J = evaluated.jacobian(parts).toarray()
    at = knots_and_interiors(solver.nlp)
    diagonal, lower, border, corner = at.arranged(evaluated.squares(parts))
    rng = np.random.default_rng(0)
    x, q = rng.normal(size=n), rng.normal(size=1)
    X = at.of(x, 0.0)
    along = np.einsum("kij,kj->ki", diagonal, X) + np.einsum("kij,j->ki", border, q)
    along[1:] += np.einsum("kij,kj->ki", lower, X[:-1])
    along[:-1] += np.einsum("kji,kj->ki", lower, X[1:])
    whole = J.T @ (J @ np.concatenate([x, q]))
    assert at.back(along) == pytest.approx(whole[:n], rel=1e-10, abs=1e-10 * np.abs(whole).max())
    assert np.einsum("kij,ki->j", border, X) + corner @ q == pytest.approx(whole[n:], rel=1e-10)
    assert evaluated.upper(evaluated.squares(parts)).toarray() == pytest.approx(np.triu(J.T @ J), abs=1e-10 * np.abs(J.T @ J).max())
    assert evaluated.diagonal(parts) == pytest.approx(np.sum(J**2, axis=0), rel=1e-12)


def test_numbers_that_are_not_finite_end_it_without_an_exception() -> None:
    solver, start = program(1)
    values = solver.nlp.about(solver.nlp.values(PARAMETERS), start)
    broken = replace(values, target=tuple(np.full_like(y, np.nan) for y in values.target))
    found = descend(solver.nlp, broken, np.full(start.shape, -np.inf), np.full(start.shape, np.inf), 1e-6, 5)
    assert not found.finite
    assert not found.solved
