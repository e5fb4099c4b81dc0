"""Covariances against the dense inverse of the whole KKT matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import compiled, lagged, number, oscillator, random_horizon, stiffening

from backsight.models import Model, compile_model
from backsight.models.mechanics.planar import PlanarFixed, PointMass, Rod
from backsight.ocp import Horizon, ParameterPrior, Solution, Solver, Status, Transcription, transcribe
from backsight.ocp.curvature import Curvature, curvature
from backsight.ocp.ipopt import Solved

MODELS = {"oscillator": compiled(oscillator()), "lagged": compiled(lagged()), "stiffening": compiled(stiffening())}
VAGUE = 10.0


def program(name: str, method: str, *, horizons: int = 1, known: bool = False, soft: bool = True, degree: int = 2) -> Transcription:
    """A program in which everything is determined: every state has a vague prior at the start unless it is known exactly."""
    dae = MODELS[name]
    made = []
    for k in range(horizons):
        h = random_horizon(dae, 20 + k, intervals=4 + k)
        std = np.full(len(dae.states), VAGUE)
        if known:
            std[:] = 0.0
            std[-1] = 0.5 if known == "partly" else 0.0
        made.append(replace(h, initial_std=std, initial=0.1 * np.ones(len(std))))
    free = number(dae, "mass.m", "offset.f")
    prior = ParameterPrior(mean=np.array([2.0, 0.7]), std=np.array([np.inf, 3.0]))
    return transcribe(dae, made, free=free, prior=prior, force_std={0: 0.5} if soft else {}, method=method, degree=degree)


def dense(t: Transcription, solution: Solution) -> tuple[np.ndarray, int]:
    """Covariance of all unknowns from the dense KKT matrix, known ones taken out, and the number of its negative eigenvalues."""
    values = replace(solution.values, gamma=0.0)
    upper, J = (m.toarray() for m in solution.solver.hessian(solution.solved.decisions, values))
    H, size = upper + np.triu(upper, 1).T, t.nlp.size
    known = np.concatenate([start[h.initial_std == 0] for start, h in zip(t.starts, t.horizons, strict=True)])
    unknown = np.setdiff1d(np.arange(size), known)
    null = np.linalg.svd(J[:, unknown])[2][np.linalg.matrix_rank(J[:, unknown]) :].T if len(J) else np.eye(len(unknown))
    reduced = null.T @ H[np.ix_(unknown, unknown)] @ null
    out = np.zeros((size, size))
    out[np.ix_(unknown, unknown)] = null @ np.linalg.inv(reduced) @ null.T
    return out * np.outer(values.unit, values.unit), int(np.sum(np.linalg.eigvalsh(reduced) <= 0))


def at_a_point(t: Transcription) -> Solution:
    """A solution that was never sought: curvature is a property of the point."""
    rng, solver = np.random.default_rng(5), Solver(t.nlp)
    decisions = rng.normal(size=t.nlp.size) * 0.2
    decisions[t.nlp.trajectory_size :] = 1.5, 0.5
    values = replace(t.nlp.values(np.array([p.value for p in t.dae.parameters])), unit=rng.uniform(0.5, 2.0, t.nlp.size))
    solved = Solved(
        decisions=decisions, cost=0.0, multipliers=np.zeros(t.nlp.constraint_count), status=Status.SOLVED, iterations=0, seconds=0.0
    )
    return Solution(transcription=t, solver=solver, values=values, solved=solved)


@pytest.mark.parametrize("known", [False, "partly", True], ids=["vague-start", "partly-known-start", "known-start"])
@pytest.mark.parametrize("soft", [True, False], ids=["soft", "hard"])
@pytest.mark.parametrize("horizons", [1, 2])
@pytest.mark.parametrize("method", ["spline", "collocation"])
@pytest.mark.parametrize("name", MODELS)
def test_covariances_are_blocks_of_the_dense_inverse(name, method, horizons, soft, known):
    t = program(name, method, horizons=horizons, soft=soft, known=known)
    solution = at_a_point(t)
    expected, negative = dense(t, solution)
    assert negative == 0
    found = solution.curvature
    assert found is not None, "the program is determined, yet no curvature was found"
    assert found.definite
    assert solution.determined
    n = t.nlp.trajectory_size
    # what a known start determines through an exact equation has no variance but rounding
    variance = np.diag(expected)
    size = np.sqrt(np.maximum(variance, 1e-8 * variance.max()))
    np.testing.assert_allclose(
        found.parameter_covariance / np.outer(size[n:], size[n:]), expected[n:, n:] / np.outer(size[n:], size[n:]), atol=1e-6
    )
    for i in range(len(t.nlp.steps)):
        where = np.concatenate([t.nlp.index[:, i], np.arange(n, t.nlp.size)])
        unit = np.outer(size[where], size[where])
        np.testing.assert_allclose(found.interval_covariance[i] / unit, expected[np.ix_(where, where)] / unit, atol=2e-5)


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_the_log_determinant_is_that_of_the_kkt_matrix(method):
    t = program("lagged", method)
    solution = at_a_point(t)
    upper, J = (m.toarray() for m in solution.solver.hessian(solution.solved.decisions, replace(solution.values, gamma=0.0)))
    kkt = np.block([[upper + np.triu(upper, 1).T, J.T], [J, np.zeros((len(J), len(J)))]])
    assert found(solution).log_determinant == pytest.approx(np.linalg.slogdet(kkt)[1], rel=1e-9)


def found(solution: Solution) -> Curvature:
    assert solution.curvature is not None
    return solution.curvature


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_a_parameter_that_nothing_depends_on_is_not_determined(method):
    dae = MODELS["oscillator"]
    h = random_horizon(dae, 3)
    quiet = replace(h, inputs=np.zeros_like(h.inputs), target=np.zeros_like(h.target), initial_std=np.full(2, VAGUE))
    nothing = ParameterPrior(mean=np.array([0.0, 0.0]), std=np.full(2, np.inf))
    # a spring's stiffness and its rest length: at rest and with the rest length at zero only their product is seen
    t = transcribe(dae, [quiet], free=number(dae, "offset.f", "spring.s_rel0"), prior=nothing, force_std={0: 0.5}, method=method)
    solution = replace(at_a_point(t), solved=replace(at_a_point(t).solved, decisions=np.zeros(t.nlp.size)))
    covariance = None if solution.curvature is None else np.diag(solution.curvature.parameter_covariance)
    assert not solution.determined or covariance.max() > 1e8
    if not solution.determined:
        assert np.isnan(solution.interval_covariance).all()


def test_an_index_three_model_with_invariants_has_the_dense_covariance():
    pendulum = Model(
        name="pendulum",
        components={"bob": PointMass(), "rod": Rod(), "pivot": PlanarFixed()},
        connections=[("bob.point", "rod.point_a"), ("rod.point_b", "pivot.point")],
        outputs={"x": "bob.x", "y": "bob.y"},
    )
    dae = compile_model(pendulum)
    assert dae.invariants.shape[0] > 0
    rng, time = np.random.default_rng(0), np.linspace(0.0, 0.2, 9)
    angle = 0.5 + 0.1 * np.sin(6 * time)
    y = np.column_stack([np.sin(angle), -np.cos(angle)]) + 1e-3 * rng.normal(size=(9, 2))
    from backsight.ocp import Mesh

    h = Horizon(
        mesh=Mesh(time[::2]),
        time=time,
        inputs=np.empty((9, 0)),
        target=y,
        target_std=np.full(y.shape, 1e-2),
        initial=np.zeros(len(dae.states)),
        initial_std=np.full(len(dae.states), np.inf),
    )
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    for force_std in ({0: 0.5, 1: 0.5}, {}):
        t = transcribe(dae, [h], free=(), prior=nothing, force_std=force_std, method="collocation")
        solver = Solver(t.nlp)
        values = t.nlp.values(np.array([p.value for p in dae.parameters]))
        start = np.zeros(t.nlp.size)
        for i, q in enumerate(dae.states):
            start[t.nlp.index[i]] = {"bob.x": 0.48, "bob.y": -0.87}.get(q.name, 0.1)
        low = np.full(t.nlp.size, -np.inf)
        solved = solver.solve(start, values, lower=low, upper=-low)
        assert solved.status.converged
        solution = Solution(transcription=t, solver=solver, values=values, solved=solved)
        expected, _ = dense(t, solution)
        assert solution.determined
        for i in range(len(t.nlp.steps)):
            where = t.nlp.index[:, i]
            size = np.sqrt(np.diag(expected)[where]) + 1e-9
            np.testing.assert_allclose(
                found(solution).interval_covariance[i] / np.outer(size, size),
                expected[np.ix_(where, where)] / np.outer(size, size),
                atol=1e-5,
            )


def test_known_decisions_have_no_variance():
    t = program("lagged", "spline", known="partly")
    solution = at_a_point(t)
    hessian, jacobian = solution.solver.hessian(solution.solved.decisions, replace(solution.values, gamma=0.0))
    c = curvature(t.nlp, hessian, jacobian, solution.values.unit, t.starts[0][:2])
    assert np.all(c.interval_covariance[0][:2] == 0.0)
    assert np.all(c.interval_covariance[0][:, :2] == 0.0)
    assert c.interval_covariance[0][2, 2] > 0
