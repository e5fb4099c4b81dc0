"""Covariances against the dense inverse of the whole KKT matrix."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal, localcontext
from typing import Literal

import numpy as np
import pytest
import scipy.sparse as sp
import truths
from examples import (
    OFFSET,
    D,
    K,
    M,
    compiled,
    lagged,
    near_the_swing,
    number,
    oscillator,
    pendulum,
    random_horizon,
    stiffening,
    swung,
)
from linear_runs import ALL_FREE, STD, STEP, many, problem

from backsight.estimation import Free, Weights
from backsight.estimation.smoothing.program import Settings
from backsight.ocp import Horizon, Mesh, ParameterPrior, Solution, Solver, Status, Transcription, transcribe
from backsight.ocp.bordered import arrange
from backsight.ocp.curvature import Curvature, curvature, determined_variance
from backsight.ocp.solved import Solved

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
    values = solution.values
    upper, J = (m.toarray() for m in solution.solver.hessian(solution.solved.decisions, values))
    H, size = upper + np.triu(upper, 1).T, t.nlp.size
    known = np.concatenate([start[h.initial_std == 0] for start, h in zip(t.starts, t.horizons, strict=True)])
    unknown = np.setdiff1d(np.arange(size), known)
    null = np.linalg.svd(J[:, unknown])[2][np.linalg.matrix_rank(J[:, unknown]) :].T if len(J) else np.eye(len(unknown))
    reduced = null.T @ H[np.ix_(unknown, unknown)] @ null
    out = np.zeros((size, size))
    out[np.ix_(unknown, unknown)] = null @ np.linalg.inv(reduced) @ null.T
    return out * np.outer(values.unit, values.unit), int(np.sum(np.linalg.eigvalsh(reduced) <= 0))


def at_a_point(t: Transcription, free: tuple[float, ...] = (1.5, 0.5)) -> Solution:
    """A solution that was never sought: curvature is a property of the point."""
    rng, solver = np.random.default_rng(5), Solver(t.nlp)
    decisions = rng.normal(size=t.nlp.size) * 0.2
    decisions[t.nlp.trajectory_size :] = free
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
    upper, J = (m.toarray() for m in solution.solver.hessian(solution.solved.decisions, solution.values))
    kkt = np.block([[upper + np.triu(upper, 1).T, J.T], [J, np.zeros((len(J), len(J)))]])
    assert found(solution).log_determinant == pytest.approx(np.linalg.slogdet(kkt)[1], rel=1e-9)


def found(solution: Solution) -> Curvature:
    assert solution.curvature is not None
    return solution.curvature


def even(name: str, horizons: int) -> list[Horizon]:
    """Intervals of one length: beside very short ones a dense inverse is no truth."""
    made = [random_horizon(MODELS[name], 3 + k) for k in range(horizons)]
    return [replace(h, mesh=Mesh(np.linspace(h.time[0], h.time[-1], h.mesh.count + 1))) for h in made]


def quiet(horizons: int) -> list[Horizon]:
    """A mass at rest without any force."""
    made = even("oscillator", horizons)
    return [replace(h, inputs=0 * h.inputs, target=0 * h.target, initial_std=np.full(2, VAGUE)) for h in made]


def adrift(horizons: int) -> list[Horizon]:
    """Only the velocity is measured, and of the start nothing is known."""
    made = even("lagged", horizons)
    return [replace(h, target=np.where([True, False], np.nan, h.target)) for h in made]


# model, samples, what is free and what is fixed, and how many directions the data leave open in one horizon and in two
OPEN = {
    "two forces of which only the sum acts": ("oscillator", quiet, ("damper.d", "offset.f", "spring.s_rel0"), {}, (1, 1)),
    "a length that no force knows": ("oscillator", quiet, ("offset.f", "spring.s_rel0"), {"spring.k": 0.0}, (1, 1)),
    "a free position": ("lagged", adrift, ("offset.f", "mass.m"), {"spring.k": 0.0}, (1, 2)),
}


@pytest.mark.parametrize("method", ["spline", "collocation"])
@pytest.mark.parametrize("soft", [True, False], ids=["soft", "hard"])
@pytest.mark.parametrize("horizons", [1, 2])
@pytest.mark.parametrize("case", OPEN)
def test_what_the_data_leave_open_is_named_and_all_else_has_the_variance_of_the_dense_pseudo_inverse(case, horizons, soft, method):
    name, made, free, fixed, dimensions = OPEN[case]
    dae = MODELS[name]
    nothing = ParameterPrior(mean=np.zeros(len(free)), std=np.full(len(free), np.inf))
    force_std = {0: 0.5} if soft else {}
    t = transcribe(dae, made(horizons), free=number(dae, *free), prior=nothing, force_std=force_std, method=method)
    rng, n = np.random.default_rng(5), t.nlp.trajectory_size
    decisions = np.concatenate([rng.normal(size=n) * 0.2, 0.5 + np.arange(len(free))])
    parameters = np.array([fixed.get(p.name, p.value) for p in dae.parameters])
    values = replace(t.nlp.values(parameters), unit=rng.uniform(0.5, 2.0, t.nlp.size))
    solved = Solved(
        decisions=decisions, cost=0.0, multipliers=np.zeros(t.nlp.constraint_count), status=Status.SOLVED, iterations=0, seconds=0.0
    )
    solution = Solution(transcription=t, solver=Solver(t.nlp), values=values, solved=solved)

    upper, J = (m.toarray() for m in solution.solver.hessian(decisions, values))
    basis = np.linalg.svd(J)[2][np.linalg.matrix_rank(J) :].T if len(J) else np.eye(t.nlp.size)
    H = basis.T @ (upper + np.triu(upper, 1).T) @ basis
    size = 1 / np.sqrt(np.maximum(np.diag(H), 1e-12))
    e, Q = np.linalg.eigh(H * np.outer(size, size))
    lost = e < 1e-13
    assert np.sum(lost) == dimensions[horizons - 1], e
    seen = basis @ (size[:, None] * Q[:, ~lost])
    expected = np.einsum("ij,j,ij->i", seen, 1 / e[~lost], seen) * values.unit**2
    null = np.linalg.norm(basis @ (size[:, None] * Q[:, lost]), axis=1) * values.unit
    is_open = null > 1e-4 * null.max()

    assert not solution.determined
    c = found(solution)
    assert len(c.null) == dimensions[horizons - 1]
    np.testing.assert_array_equal(np.isinf(c.parameter_variance), is_open[n:])
    np.testing.assert_allclose(c.parameter_variance[~is_open[n:]], expected[n:][~is_open[n:]], rtol=1e-4)
    for i in range(len(t.nlp.steps)):
        here = t.nlp.index[:, i]
        variance = determined_variance(np.diag(c.interval_covariance[i])[: len(here)], c.interval_null[i][: len(here)])
        np.testing.assert_array_equal(np.isinf(variance), is_open[here])
        size_here = expected[here].max()
        np.testing.assert_allclose(variance[~is_open[here]], expected[here][~is_open[here]], rtol=1e-3, atol=1e-8 * size_here)


def left_open(
    case: str, *, horizons: int = 1, force_std: dict[int, float], method: Literal["spline", "collocation"] = "spline", degree: int
) -> Solution:
    """A case of `OPEN` at a point."""
    name, made, free, fixed, _ = OPEN[case]
    dae = MODELS[name]
    nothing = ParameterPrior(mean=np.zeros(len(free)), std=np.full(len(free), np.inf))
    t = transcribe(dae, made(horizons), free=number(dae, *free), prior=nothing, force_std=force_std, method=method, degree=degree)
    solution = at_a_point(t, tuple(0.5 + np.arange(len(free))))
    parameters = np.array([fixed.get(p.name, p.value) for p in dae.parameters])
    return replace(solution, values=replace(solution.values, parameters=parameters))


def in_units(solution: Solution, decades: float) -> Curvature:
    """The curvature at the same point, computed in units that differ by so many decades to either side."""
    unit = 10 ** np.random.default_rng(8).uniform(-decades, decades, solution.values.unit.size)
    return found(replace(solution, values=replace(solution.values, unit=unit)))


@pytest.mark.parametrize("soft", [True, False], ids=["soft", "hard"])
@pytest.mark.parametrize(("method", "degree"), [("spline", 2), ("spline", 3), ("spline", 4), ("collocation", 3)])
@pytest.mark.parametrize("name", MODELS)
def test_what_is_determined_is_so_in_all_units(name, method, degree, soft):
    t = program(name, method, degree=degree, soft=soft, horizons=2)
    solution = at_a_point(t)
    n = t.nlp.trajectory_size
    expected = dense(t, solution)[0][n:, n:]
    size = np.sqrt(np.diag(expected))
    for decades in (2, 6):
        c = in_units(solution, decades)
        assert not len(c.null)
        np.testing.assert_allclose(c.parameter_covariance / np.outer(size, size), expected / np.outer(size, size), atol=1e-5)


@pytest.mark.parametrize(("method", "degree"), [("spline", 2), ("spline", 3), ("collocation", 2), ("collocation", 3)])
@pytest.mark.parametrize("soft", [True, False], ids=["soft", "hard"])
@pytest.mark.parametrize("horizons", [1, 2])
@pytest.mark.parametrize("case", OPEN)
def test_what_the_data_leave_open_is_found_in_all_units(case, horizons, soft, method, degree):
    """Free directions are counted by hand (`OPEN`), and the parameters that move along one are known with them."""
    free, dimensions = OPEN[case][2], OPEN[case][4]
    solution = left_open(case, horizons=horizons, force_std={0: 0.5} if soft else {}, method=method, degree=degree)
    t = solution.transcription
    are_open = [(p != "damper.d" and case == "two forces of which only the sum acts") or p == "spring.s_rel0" for p in free]
    determined = []
    for decades in (0, 4, 6):
        c = in_units(solution, decades)
        assert len(c.null) == dimensions[horizons - 1]
        names = [t.dae.parameters[i].name for i in t.nlp.free]
        np.testing.assert_array_equal(np.isinf(c.parameter_variance), [are_open[free.index(p)] for p in names])
        determined.append(c.parameter_variance[np.isfinite(c.parameter_variance)])
    np.testing.assert_allclose(determined[1:], [determined[0]] * 2, rtol=1e-6)


def exact(t: Transcription, solution: Solution) -> np.ndarray:
    """Covariance of the parameters from the KKT matrix as it is in memory, inverted in 60 digits."""
    upper, J, softness = solution.solver.kkt(solution.solved.decisions, solution.values)
    H, J, n = upper.toarray(), J.toarray(), t.nlp.size
    K = np.block([[H + np.triu(H, 1).T, J.T], [J, -np.diag(softness)]])
    with localcontext(prec=60):
        A = np.vectorize(Decimal, otypes=[object])(np.hstack([K, np.eye(len(K))]))
        for k in range(len(K)):
            best = k + int(np.argmax(np.abs(A[k:, k])))
            A[[k, best]] = A[[best, k]]
            A[k] = A[k] / A[k, k]
            others = np.arange(len(K)) != k
            A[others] -= A[others, k][:, None] * A[k]
        inverse = A[:, len(K) :].astype(float)
    own = slice(t.nlp.trajectory_size, n)
    return inverse[own, own] * np.outer(solution.values.unit[own], solution.values.unit[own])


def nearly_steady(uneven: float, *free: str) -> Solution:
    """The oscillator at a velocity that varies by so much."""
    dae = MODELS["oscillator"]
    (horizon,) = even("oscillator", 1)
    nothing = ParameterPrior(mean=np.zeros(len(free)), std=np.full(len(free), np.inf))
    t = transcribe(dae, [horizon], free=number(dae, *free), prior=nothing, force_std={0: 0.5}, degree=3)
    decisions = uneven * np.random.default_rng(1).normal(size=t.nlp.size)
    for place, there in ((0, horizon.mesh.knots), (1, np.ones(len(horizon.mesh.knots)))):
        decisions[t.nlp.index[place]] += there[:-1]
        decisions[t.nlp.index[-2 + place, -1]] += there[-1]
    solution = at_a_point(t, tuple(0.0 for _ in free))
    values = replace(solution.values, unit=np.ones(t.nlp.size))
    return replace(solution, solved=replace(solution.solved, decisions=decisions), values=values)


@pytest.mark.parametrize("uneven", [1e-4, 1e-6, 1e-7, 1e-8, 1e-9])
def test_what_hardly_tells_two_forces_apart_still_does(uneven):
    """Friction and a constant force, at a velocity that varies by so much: the square of that is their information."""
    solution = nearly_steady(uneven, "damper.d", "offset.f")
    expected = exact(solution.transcription, solution)
    assert expected[0, 0] > 0.1 / uneven**2
    c = found(solution)
    assert not len(c.null)
    np.testing.assert_allclose(c.parameter_covariance, expected, rtol=1e-6)


@pytest.mark.parametrize("force_std", [1e-5, 1e-6, 1e-7, 1e-8])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("case", OPEN)
def test_what_the_data_leave_open_is_so_where_balances_are_nearly_exact(case, degree, seed, force_std):
    """What adds up in a balance is rounded, and the heavier that is the more its square."""
    solution = left_open(case, force_std={0: force_std}, degree=degree)
    unit = np.random.default_rng(seed).uniform(0.5, 2.0, solution.transcription.nlp.size)
    solution = replace(solution, values=replace(solution.values, unit=unit))
    assert len(found(solution).null) == OPEN[case][4][0]
    assert np.isinf(found(solution).parameter_variance).any() == (case != "a free position")


@pytest.mark.parametrize("uneven", [1e-4, 1e-7, 1e-8])
def test_what_is_open_is_so_beside_what_is_hardly_told(uneven):
    """A rest length that no one can tell from the constant force, which is hardly told from the friction."""
    solution = nearly_steady(uneven, "damper.d", "offset.f", "spring.s_rel0")
    c = found(solution)
    assert len(c.null) == 1
    names = [solution.transcription.dae.parameters[i].name for i in solution.transcription.nlp.free]
    assert [name for name, v in zip(names, c.parameter_variance, strict=True) if np.isinf(v)] == ["offset.f", "spring.s_rel0"]


def coloured(kind: str, y: np.ndarray, offset_std: float) -> np.ndarray:
    """Variances (n, 2) of position and velocity by a Kalman smoother; the coloured force and the offset are states of it.

    Start deviations of all states are VAGUE there, so that force and offset are counted in the units in which that is theirs.
    """
    rms, tau, plant = 0.3, 0.1, truths.Plant(m=M, d=D, k=K, offset=OFFSET)
    rate = {"ou": 1 / tau, "matern": np.sqrt(3) / tau}[kind]
    A = plant.matrices[0]
    shape = np.array([[-rate]]) if kind == "ou" else np.array([[0, 1], [-(rate**2), -2 * rate]])
    size = np.array([rms]) if kind == "ou" else np.array([rms, rms * rate])
    n = 2 + len(shape) + 1
    whole, G = np.zeros((n, n)), np.zeros((n, 1))
    whole[:2, :2], whole[2:-1, 2:-1] = A, shape
    whole[1, 2], whole[1, -1] = 1 / M, -1 / M
    G[n - 2] = rms * (np.sqrt(2 * rate) if kind == "ou" else 2 * rate**1.5)
    unit = np.concatenate([np.ones(2), size / VAGUE, [offset_std / VAGUE]])
    whole, G = whole * unit / unit[:, None], G / unit[:, None]
    time, C, inputs = STEP * np.arange(len(y)), np.eye(1, n), np.zeros((n, 1))
    found = truths.smoothed(
        whole, inputs, G, C, time=time, u=np.zeros((len(y), 1)), y=y[:, None], std=np.full((len(y), 1), STD), density=1.0, vague=VAGUE
    )
    return np.diagonal(found[1], axis1=1, axis2=2)[:, :2]


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("kind", ["ou", "matern"])
@pytest.mark.parametrize("free", [{}, {"offset.f": Free(OFFSET, std=0.1)}, ALL_FREE], ids=["start-alone", "prior", "all-free"])
def test_exact_balances_with_an_interval_to_every_sample_leave_nothing_open(free, kind, degree):
    """The force is a state of its own, so that every balance is a constraint, and bubbles move far for what they are seen by."""
    rng = np.random.default_rng(4)
    y = many(120, 1, rng)[0] + STD * rng.normal(size=120)
    weights = Weights(W={"mass": 0.3}, tau={"mass": 0.1}, kind={"mass": kind})
    _, solution = problem(y, settings=Settings(step=STEP, degree=degree), parameters=free, weights=weights)
    assert solution.determined
    assert np.isfinite(found(solution).parameter_variance).all()
    if free is not ALL_FREE:
        expected = coloured(kind, y, 0.1 if free else 1e-9)
        np.testing.assert_allclose(solution.sampled(0).states_std[:, :2] ** 2, expected, rtol=0.05)


def test_a_null_direction_is_the_combination_that_changes_nothing():
    """A spring's rest length and a constant force: k s_rel0 = 50 N/m * s_rel0 pushes one way, the offset the other."""
    dae = MODELS["oscillator"]
    nothing = ParameterPrior(mean=np.zeros(2), std=np.full(2, np.inf))
    t = transcribe(dae, [random_horizon(dae, 3)], free=number(dae, "offset.f", "spring.s_rel0"), prior=nothing, force_std={0: 0.5})
    (direction,) = found(at_a_point(t)).null
    free = [dae.parameters[i].name for i in t.nlp.free]
    along = dict(zip(free, direction[2:], strict=True))
    assert along["offset.f"] / along["spring.s_rel0"] == pytest.approx(K, rel=1e-6)
    assert np.abs(direction[:2]).max() < 1e-9 * np.abs(direction).max()


def test_outputs_and_states_that_the_data_show_keep_their_bands_where_another_state_is_adrift():
    dae = MODELS["lagged"]
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    t = transcribe(dae, adrift(1), free=(), prior=nothing, force_std={0: 0.5})
    solution = at_a_point(t, ())
    parameters = solution.values.parameters.copy()
    parameters[number(dae, "spring.k")[0]] = 0.0
    s = replace(solution, values=replace(solution.values, parameters=parameters)).sampled(0)
    position = [q.name for q in dae.states].index("mass.s")
    assert np.isinf(s.states_std[:, position]).all()
    assert np.isinf(s.outputs_std[:, 0]).all()
    assert np.isfinite(np.delete(s.states_std, position, axis=1)).all()
    assert np.isfinite(s.outputs_std[:, 1]).all()
    assert np.isfinite(s.forces_std).all()


@pytest.mark.parametrize("apart", [1e-2, 1e-5, 1e-7])
def test_what_must_hold_at_the_start_may_be_said_in_nearly_the_same_words_twice(apart):
    """Of two conditions the second one said as the first and a little of itself: the same set, and multipliers that go to and fro."""
    dae = compiled(pendulum())
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    t = transcribe(dae, [swung(dae, noise=1e-3)], free=(), prior=nothing, force_std={0: 0.5, 1: 0.5}, method="collocation")
    solver, values = Solver(t.nlp), t.nlp.values(np.array([p.value for p in dae.parameters]))
    anywhere = np.full(t.nlp.size, np.inf)
    solved = solver.solve(near_the_swing(dae, t.nlp.index, t.nlp.size), values, lower=-anywhere, upper=anywhere)
    H, J, d = solver.kkt(solved.decisions, values)
    first, second = np.flatnonzero(arrange(t.nlp).block[t.nlp.size :] < 0)
    said = sp.lil_matrix(sp.eye(J.shape[0]))
    said[second, second], said[second, first] = apart, 1.0
    plain, twice = (curvature(t.nlp, H, rows, d, values.unit, np.empty(0, dtype=np.int64)) for rows in (J, sp.csc_matrix(said @ J)))
    assert twice.definite
    assert not len(twice.null)
    unit = np.sqrt(np.maximum(np.einsum("kii->ki", plain.interval_covariance), 1e-12))
    scale = unit[:, :, None] * unit[:, None, :]
    np.testing.assert_allclose(twice.interval_covariance / scale, plain.interval_covariance / scale, atol=1e-6)


def test_an_index_three_model_with_invariants_has_the_dense_covariance():
    dae = compiled(pendulum())
    assert dae.invariants.shape[0] > 0
    h = swung(dae, noise=1e-3)
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    for force_std in ({0: 0.5, 1: 0.5}, {}):
        t = transcribe(dae, [h], free=(), prior=nothing, force_std=force_std, method="collocation")
        solver = Solver(t.nlp)
        values = t.nlp.values(np.array([p.value for p in dae.parameters]))
        start = near_the_swing(dae, t.nlp.index, t.nlp.size)
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
    kkt = solution.solver.kkt(solution.solved.decisions, solution.values)
    c = curvature(t.nlp, *kkt, solution.values.unit, t.starts[0][:2])
    assert np.all(c.interval_covariance[0][:2] == 0.0)
    assert np.all(c.interval_covariance[0][:, :2] == 0.0)
    assert c.interval_covariance[0][2, 2] > 0
