"""What a solve gives, against dense Gaussians of the same discretisation and the Rauch-Tung-Striebel smoother of the exact one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import LAG, OFFSET, D, K, M, compiled, lagged, number, oscillator

from backsight.models import Dae
from backsight.ocp import Horizon, Mesh, ParameterPrior, Solution, Solver, transcribe
from backsight.ocp.scaling import scaled
from backsight.ocp.solved import Options

OSCILLATOR, LAGGED = compiled(oscillator()), compiled(lagged())
DENSE = {"spline": truths.splines, "collocation": truths.radau_collocation}


def task(
    *, lag: bool, degree: int = 2, seed: int = 0, intervals: int = 12, free_offset: bool = True, jitter: bool = True, n: int = 41
) -> truths.Task:
    """A linear task: random held input, jittered samples with missing ones, knots that need not be samples."""
    rng = np.random.default_rng([seed, degree, lag])
    plant = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG if lag else 0.0)
    time = np.linspace(0.0, 1.0, n) + (rng.uniform(-0.4, 0.4, n) * np.append(0, np.append(np.ones(n - 2), 0)) / n if jitter else 0.0)
    knots = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0.02, 0.98, intervals - 1)])) if jitter else time[::4]
    u = 5 * rng.normal(size=n)
    start = np.array([0.5, 0.05, -0.1] if lag else [0.05, -0.1])
    x = truths.disturbed(plant, time, u, start, 0.5, rng)
    std = np.tile([2e-3, 2e-2], (n, 1))
    y = x[:, -2:] + std * rng.normal(size=(n, 2))
    y[rng.uniform(size=y.shape) < 0.2] = np.nan
    if not lag:
        y[:, 1] = np.nan
    nothing = np.full(len(start), np.inf)
    return truths.Task(
        plant=plant,
        knots=knots,
        degree=degree,
        time=time,
        u=u,
        y=y,
        std=std,
        force_std=0.5,
        initial=start,
        initial_std=nothing,
        free_offset=free_offset,
    )


def horizon(t: truths.Task, dae: Dae) -> Horizon:
    ny = len(dae.outputs)
    return Horizon(
        mesh=Mesh(t.knots),
        time=t.time,
        inputs=t.u[:, None],
        target=t.y[:, :ny],
        target_std=t.std[:, :ny],
        initial=t.initial,
        initial_std=t.initial_std,
    )


def solve(tasks: list[truths.Task], method: str, options: Options = Options(tolerance=1e-9)) -> Solution:  # noqa: B008
    dae = LAGGED if tasks[0].plant.T else OSCILLATOR
    free = number(dae, "offset.f") if tasks[0].free_offset else ()
    nothing = ParameterPrior(mean=np.zeros(len(free)), std=np.full(len(free), np.inf))
    horizons = [horizon(t, dae) for t in tasks]
    t = transcribe(dae, horizons, free=free, prior=nothing, force_std={0: tasks[0].force_std}, method=method, degree=tasks[0].degree)  # type: ignore[arg-type]
    solver, start = Solver(t.nlp, options), np.zeros(t.nlp.size)
    values = scaled(solver, start, t.nlp.values(np.array([p.value for p in dae.parameters])))
    lower, upper = np.full(t.nlp.size, -np.inf), np.full(t.nlp.size, np.inf)
    for first, h in zip(t.starts, horizons, strict=True):
        known = h.initial_std == 0
        lower[first[known]] = upper[first[known]] = h.initial[known]
    return Solution(transcription=t, solver=solver, values=values, solved=solver.solve(start, values, lower=lower, upper=upper))


CASES = [
    *(("spline", d, lag) for d in (2, 3, 4) for lag in (False, True)),
    *(("collocation", d, lag) for d in (1, 2, 3, 4) for lag in (False, True)),
]


@pytest.mark.parametrize(("method", "degree", "lag"), CASES)
def test_a_linear_plant_is_smoothed_to_the_dense_gaussian_of_the_same_discretisation(method, degree, lag):
    t = task(lag=lag, degree=degree)
    truth, solution = DENSE[method](t), solve([t], method)
    assert solution.solved.status.converged
    knots_mean, knots_variance = truth.states(t.knots)
    found = solution.solved.decisions[: solution.transcription.nlp.trajectory_size]
    nx = knots_mean.shape[1]
    index = solution.transcription.nlp.index
    at_knots = np.vstack([found[index[:nx]].T, found[index[-nx:, -1]]])
    np.testing.assert_allclose(at_knots, knots_mean, atol=1e-8 * np.abs(knots_mean).max())
    variance = np.vstack(
        [np.einsum("nii->ni", solution.interval_covariance[:, :nx, :nx]), np.diag(solution.interval_covariance[-1])[None, -nx - 1 : -1]]
    )
    size = np.sqrt(knots_variance.max(axis=0))  # the actuator's state is forgotten: its variance falls by many decades
    np.testing.assert_allclose(np.sqrt(variance) / size, np.sqrt(knots_variance) / size, rtol=1e-6, atol=1e-8)
    assert solution.parameters[number(solution.transcription.dae, "offset.f")[0]] == pytest.approx(truth.mean[-1], rel=1e-8)
    assert np.sqrt(solution.curvature.parameter_covariance[0, 0]) == pytest.approx(np.sqrt(truth.covariance[-1, -1]), rel=1e-7)


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_a_state_known_exactly_or_vaguely_enters_as_it_should(method):
    t = replace(task(lag=False, degree=2), initial_std=np.array([0.0, 0.02]), free_offset=True)
    truth, solution = DENSE[method](t), solve([t], method)
    s = solution.sampled(0)
    mean, variance = truth.states(t.time[:1])
    assert s.states[0, 0] == pytest.approx(0.05, abs=1e-12)
    assert s.states_std[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert s.states[0, 1] == pytest.approx(mean[0, 1], rel=1e-8)
    assert s.states_std[0, 1] == pytest.approx(np.sqrt(variance[0, 1]), rel=1e-7)
    assert s.states[-1] == pytest.approx(truth.states(t.time[-1:])[0][0], rel=1e-7)


@pytest.mark.parametrize(("method", "degree"), [("spline", 2), ("spline", 3), ("collocation", 2)])
def test_between_the_knots_the_band_holds_the_motion_that_the_mesh_cannot_see(method, degree):
    """Means add the input's fine structure, variances the Brownian bridge that is left when the moments are known."""
    t = task(lag=False, degree=degree)
    truth, s = DENSE[method](t), solve([t], method).sampled(0)
    interval = np.clip(np.searchsorted(t.knots, t.time, side="right") - 1, 0, len(t.knots) - 2)
    h = np.diff(t.knots)[interval]
    spread = truths.bridge(degree, (t.time - t.knots[interval]) / h) * h * (t.force_std / M) ** 2
    _, variance = truth.states(t.time)
    np.testing.assert_allclose(s.states_std[:, 0], np.sqrt(variance[:, 0]), rtol=1e-6)
    np.testing.assert_allclose(s.states_std[:, 1], np.sqrt(variance[:, 1] + np.maximum(spread, 0.0)), rtol=1e-6)


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_two_horizons_share_the_parameter_as_the_dense_normal_equations_do(method):
    tasks = [task(lag=False, seed=k, intervals=8 + k) for k in (1, 2)]
    solution = solve(tasks, method)
    parts = [DENSE[method](t) for t in tasks]
    precision = [1 / p.covariance[-1, -1] for p in parts]
    mean = sum(p.mean[-1] * w for p, w in zip(parts, precision, strict=True)) / sum(precision)
    assert solution.parameters[number(OSCILLATOR, "offset.f")[0]] == pytest.approx(mean, rel=1e-8)
    assert solution.curvature.parameter_covariance[0, 0] == pytest.approx(1 / sum(precision), rel=1e-7)
    for k, (t, part) in enumerate(zip(tasks, parts, strict=True)):
        # given the shared offset, each horizon's mean moves along its own regression on it
        gain = part.covariance[:, -1] / part.covariance[-1, -1]
        expected = part.rows(t.knots) @ (part.mean + gain * (mean - part.mean[-1]))
        first = solution.transcription.offsets[k]
        index = solution.transcription.nlp.index[:2, first : first + len(t.knots) - 1]
        np.testing.assert_allclose(solution.solved.decisions[index].T, expected[:-1], atol=1e-8)


@pytest.mark.parametrize(("method", "degree"), [("spline", 2), ("collocation", 3)])
def test_on_a_fine_mesh_it_is_the_rauch_tung_striebel_smoother(method, degree):
    t = replace(task(lag=False, degree=degree, free_offset=False, jitter=False), free_offset=False)
    A, B, G = t.plant.matrices
    n, errors = len(t.time), []
    means, covariances = truths.smoothed(
        A,
        B,
        G,
        np.array([[1.0, 0.0]]),
        time=t.time,
        u=np.column_stack([t.u, np.ones(n)]),
        y=t.y[:, :1],
        std=t.std[:, :1],
        density=0.25,
        vague=10.0,
    )
    expected = np.sqrt(np.einsum("nii->ni", covariances))
    for halvings in (0, 1, 2):
        knots = np.interp(np.linspace(0, n - 1, (n - 1) // 4 * 2 ** (halvings + 1) + 1), np.arange(n), t.time)
        s = solve([replace(t, knots=knots)], method).sampled(0)
        errors.append([np.max(np.abs(s.states - means) / expected), np.max(np.abs(s.states_std / expected - 1))])
    assert np.all(np.array(errors[-1]) < [2e-3, 2e-3]), errors
    assert errors[2][0] < errors[1][0] < errors[0][0]


def test_what_is_reported_of_the_force_is_the_dense_estimate_of_its_moments():
    t = task(lag=False, degree=2)
    truth, solution = truths.splines(t), solve([t], "spline")
    plant, here = t.plant, np.array([3, 7])
    width = np.diff(t.knots)[here]
    x, weight = np.polynomial.legendre.leggauss(30)
    mean_force = []
    for i, h in zip(here, width, strict=True):
        # the mean of m v' + d v + k s + offset - u over the interval; v' integrates to the difference of v
        inside = np.concatenate([[t.knots[i]], t.time[(t.time > t.knots[i]) & (t.time < t.knots[i + 1])], [t.knots[i + 1]]])
        time = t.knots[i] + h * (x + 1) / 2
        states = truth.states(time)[0]
        ends = truth.states(t.knots[i : i + 2])[0]
        impulse = np.sum(np.diff(inside) * t.held(inside[:-1]))
        mean_force.append(
            plant.m * np.diff(ends[:, 1])[0] / h + (weight / 2) @ (states @ [plant.k, plant.d]) + truth.mean[-1] - impulse / h
        )
    at = solution.forces.at(np.repeat(here, 40), np.tile((np.arange(40) + 0.5) / 40, 2))[0]
    np.testing.assert_allclose(at.reshape(2, 40).mean(axis=1), mean_force, rtol=1e-6)


def test_a_solve_that_was_stopped_can_be_read_and_says_so():
    from backsight.ocp import Status

    t = task(lag=True)
    stopped = solve([t], "collocation", Options(gauss_newton_iterations=0, max_iterations=0))
    assert stopped.solved.status is Status.ITERATIONS
    assert not stopped.solved.status.converged
    s = stopped.sampled(0)
    for table in (s.states, s.outputs, s.forces):
        assert np.all(np.isfinite(table))


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_the_same_task_gives_the_same_bits(method):
    one, two = (solve([task(lag=True)], method).sampled(0) for _ in range(2))
    for name in ("states", "states_std", "outputs", "outputs_std", "forces", "forces_std"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
