"""A moving window of stages against an independent Kalman filter, the whole-horizon program, and dense linear algebra."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
import truths
from examples import COULOMB, HARDENING, LAG, OFFSET, WIDTH, D, K, M, compiled, lagged, number, oscillator, shaken, stiffening

from backsight.models import Dae
from backsight.ocp import Horizon, Mesh, ParameterPrior, Solver, transcribe
from backsight.ocp.moving.elimination import back_substituted, best_determined, triangular
from backsight.ocp.moving.stage import Stage
from backsight.ocp.moving.trajectory import Known, Trajectory
from backsight.ocp.moving.window import SQUARES, Update, Window
from backsight.ocp.scaling import scaled

DT, FORCE_STD = 0.002, 0.5


def window(
    dae: Dae, names: list[str], length: int, known: Known, std: np.ndarray, *, degree: int = 2, update: Update = "smoothing", **more
) -> Window:
    parameters = np.array([p.value for p in dae.parameters])
    stage = Stage(dae, number(dae, *names), parameters, tuple(range(dae.w.shape[0])), degree)
    nu, ny = dae.u.shape[0], len(std)
    typical = np.concatenate([[DT, 0.0], np.ones(2 * nu), np.zeros(ny), np.full(dae.w.shape[0], 1 / FORCE_STD), 1 / std])
    open_ = np.full(dae.x.shape[0], np.inf)
    low, high = more.pop("bounds", (np.full(len(names), -np.inf), np.full(len(names), np.inf)))
    bounds = np.concatenate([-open_, low]), np.concatenate([open_, high])
    return Window(stage, length, known, typical, bounds, more.pop("corner", np.full(ny, SQUARES)), update)


def run(
    w: Window, time: np.ndarray, u: np.ndarray, y: np.ndarray, std: np.ndarray, tolerance: float = 1e-6, limit: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    """Newest state and parameters after every sample, and their standard deviations."""
    mean, spread, forces = [], [], np.full(len(w.stage.soft), 1 / FORCE_STD)
    scale = np.where(np.isfinite(y), 1 / std, 0.0)
    y = np.where(np.isfinite(y), y, 0.0)
    for k in range(len(time)):
        if k:
            step, held = time[k] - time[k - 1], u[k - 1 : k]
            w.push(np.concatenate([[step, time[k - 1]], held, held, y[k - 1], forces, scale[k - 1]]))
        w.newest[:] = np.concatenate([[time[k]], u[k : k + 1], y[k], scale[k]])
        assert w.solve(limit, tolerance).converged or limit == 1
        mean.append(np.concatenate([w.here.x[:, -1], w.here.p]))
        spread.append(np.sqrt(np.diag(w.covariance())))
    return np.array(mean), np.array(spread)


def filtered(plant: truths.Plant, C: np.ndarray, time: np.ndarray, u: np.ndarray, y: np.ndarray, std: np.ndarray, prior: np.ndarray):
    """Kalman filter with the offset as a constant state, from zero with deviations `prior`."""
    A, B, G = plant.matrices
    nx, mean, spread = len(A), [], []
    x, P = np.zeros(nx + 1), np.diag(prior**2)
    for k in range(len(time)):
        if k:
            h = time[k] - time[k - 1]
            phi, gamma = truths.discrete(A, np.column_stack([B[:, 0], -G[:, 0]]), h)
            F = np.eye(nx + 1)
            F[:nx, :nx], F[:nx, nx] = phi, gamma[:, 1]
            x, P = F @ x, F @ P @ F.T
            x[:nx] += gamma[:, 0] * u[k - 1]
            P[:nx, :nx] += truths.noise_covariance(A, G, FORCE_STD**2, h)
        there = np.isfinite(y[k])
        H = np.column_stack([C, np.zeros(len(C))])[there]
        S = H @ P @ H.T + np.diag(std[there] ** 2)
        gain = np.linalg.solve(S, H @ P).T
        x = x + gain @ (y[k][there] - H @ x)
        keep = np.eye(nx + 1) - gain @ H
        P = keep @ P @ keep.T + gain @ np.diag(std[there] ** 2) @ gain.T
        mean.append(x)
        spread.append(np.sqrt(np.diag(P)))
    return np.array(mean), np.array(spread)


@pytest.mark.parametrize("update", ["smoothing", "filtering"])
@pytest.mark.parametrize("length", [2, 5, 50, 500])
@pytest.mark.parametrize("model", ["oscillator", "lagged"])
def test_on_a_linear_model_the_window_is_the_kalman_filter_however_short(model, length, update):
    plant = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG if model == "lagged" else 0.0)
    dae = compiled(lagged() if model == "lagged" else oscillator())
    rng, n, nx = np.random.default_rng(0), 120, len(plant.matrices[0])
    time = np.cumsum(rng.uniform(0.5 * DT, 1.5 * DT, n))
    u = 20 * np.sign(np.sin(9 * time))
    C = np.eye(nx)[1:] if model == "lagged" else np.eye(nx)[:1]
    std = np.full(len(C), 1e-4)
    x = truths.disturbed(plant, time, u, np.zeros(nx), FORCE_STD, rng)
    y = x @ C.T + std * rng.normal(size=(n, len(C)))
    y[rng.random(y.shape) < 0.1] = np.nan
    prior = np.concatenate([np.full(nx, 0.5), [3.0]])
    if model == "lagged":
        wanted = [q.name for q in dae.states]
        assert len(wanted) == nx
    known = Known(Rd=np.column_stack([np.diag(1 / prior), np.zeros(nx + 1)]), reference=np.zeros(nx + 1))
    mean, spread = run(window(dae, ["offset.f"], length, known, std, degree=4, update=update), time, u, y, std)
    truth, deviation = filtered(plant, C, time, u, y, std, prior)
    assert np.max(np.abs(mean - truth) / deviation) < 1e-8
    assert np.max(np.abs(spread / deviation - 1)) < 1e-8
    if length == 5:  # one step is all that it takes
        once, _ = run(window(dae, ["offset.f"], length, known, std, degree=4, update=update), time, u, y, std, limit=1)
        assert np.max(np.abs(once - truth) / deviation) < 1e-8


def test_what_nothing_is_known_of_has_an_infinite_deviation_until_the_samples_tell_it():
    dae, rng, n = compiled(oscillator()), np.random.default_rng(1), 40
    plant = truths.Plant(m=M, d=D, k=K, offset=OFFSET)
    time, std = DT * np.arange(n), np.array([1e-4])
    y = truths.disturbed(plant, time, np.zeros(n), np.array([0.02, 0.1]), FORCE_STD, rng)[:, :1] + 1e-4 * rng.normal(size=(n, 1))
    known = Known(Rd=np.zeros((3, 4)), reference=np.zeros(3))
    mean, spread = run(window(dae, ["offset.f"], 20, known, std), time, np.zeros(n), y, std)
    assert spread[0, 0] == pytest.approx(1e-4)
    assert np.all(np.isinf(spread[0, 1:]))
    assert np.all(np.isfinite(spread[3:]))
    flat = np.array([1e3, 1e3, 1e5])  # beside what 40 samples tell, as good as nothing
    truth, deviation = filtered(plant, np.eye(2)[:1], time, np.zeros(n), y, std, flat)
    np.testing.assert_allclose(spread[10:], deviation[10:], rtol=2e-3)
    assert np.max(np.abs(mean - truth)[10:] / deviation[10:]) < 2e-3


def nonlinear(n: int = 60) -> tuple[Dae, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A lag, a stiffening spring and rounded friction: time, u, y, std."""
    plant, time, rng = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG), 0.01 * np.arange(n), np.random.default_rng(3)
    u = 10 * np.sin(4 * time)
    x = truths.stiffening_motion(plant, HARDENING, COULOMB, WIDTH, time, u, np.zeros(3))
    std = np.array([1e-3, 1e-2])
    return compiled(stiffening()), time, u, x[:, 1:3] + std * rng.normal(size=(n, 2)), std


def test_a_window_over_all_samples_is_the_whole_horizon_program():
    dae, time, u, y, std = nonlinear()
    nx, parameters, free = dae.x.shape[0], np.array([p.value for p in dae.parameters]), number(dae, "mass.m", "spring.k")
    horizon = Horizon(
        mesh=Mesh(time),
        time=time,
        inputs=u[:, None],
        target=y,
        target_std=np.broadcast_to(std, y.shape),
        initial=np.zeros(nx),
        initial_std=np.full(nx, 0.3),
    )
    prior = ParameterPrior(mean=parameters[list(free)], std=np.array([0.5, 20.0]))
    t = transcribe(dae, [horizon], free=free, prior=prior, force_std=dict.fromkeys(range(dae.w.shape[0]), FORCE_STD))
    solver, start = Solver(t.nlp), np.concatenate([np.full(t.nlp.trajectory_size, 0.01), parameters[list(free)]])
    unbounded = np.full(t.nlp.size, np.inf)
    solved = solver.solve(start, scaled(solver, start, t.nlp.values(parameters)), lower=-unbounded, upper=unbounded)
    assert solved.status.converged
    reference = np.concatenate([np.zeros(nx), parameters[list(free)]])
    deviations = np.concatenate([np.full(nx, 0.3), prior.std])
    known = Known(Rd=np.column_stack([np.diag(1 / deviations), np.zeros(nx + 2)]), reference=reference)
    mean, spread = run(window(dae, ["mass.m", "spring.k"], 100, known, std), time, u, y, std, tolerance=1e-7)
    n = t.nlp.trajectory_size
    found = np.concatenate([solved.decisions[n - nx : n], solved.decisions[n:]])
    # the program refers inertias to parameters near its end, the window to those of its last step
    assert np.max(np.abs(mean[-1] - found) / spread[-1]) < 0.01


def test_a_parameter_beyond_its_bound_stays_on_it_and_all_else_goes_with_it():
    dae, time, u, y, std = nonlinear()
    nx = dae.x.shape[0]
    deviations = np.concatenate([np.full(nx, 0.3), [5.0, 200.0]])
    known = Known(Rd=np.column_stack([np.diag(1 / deviations), np.zeros(nx + 2)]), reference=np.concatenate([np.zeros(nx), [3.5, K]]))
    bounds = np.array([3.0, 1.0]), np.array([10.0, 1e3])
    bounded, _ = run(window(dae, ["mass.m", "spring.k"], 20, known, std, bounds=bounds), time, u, y, std)
    assert np.all(bounded[:, nx] >= 3.0)
    assert bounded[-1, nx] == 3.0  # the truth is 2
    held = window(dae, ["mass.m", "spring.k"], 20, known, std, bounds=(np.array([3.0, 1.0]), np.array([3.0 + 1e-12, 1e3])))
    held.here.p[0] = 3.0
    fixed, spread = run(held, time, u, y, std)
    assert np.max(np.abs(bounded[-1] - fixed[-1])[[*range(nx), nx + 1]] / spread[-1][[*range(nx), nx + 1]]) < 0.2


def test_a_gross_outlier_hardly_moves_what_huber_estimates():
    dae, time, u, y, std = nonlinear()
    nx, wild = dae.x.shape[0], y.copy()
    wild[30, 0] += 1.0  # a thousand deviations
    known = Known(Rd=np.zeros((nx, nx + 1)), reference=np.zeros(nx))
    clean, spread = run(window(dae, [], 20, known, std), time, u, y, std)
    robust, _ = run(window(dae, [], 20, known, std, corner=np.full(2, 1.345)), time, u, wild, std)
    squares, _ = run(window(dae, [], 20, known, std), time, u, wild, std)
    assert np.max(np.abs(squares - clean)[30] / spread[30]) > 100
    assert np.max(np.abs(robust - clean)[30:] / spread[30:]) < 3


def test_a_reading_that_a_force_enters_at_once_counts_when_its_interval_is_over():
    dae = compiled(shaken())
    stage = Stage(dae, (), np.array([p.value for p in dae.parameters]), (0,), 2)
    assert [dae.outputs[i].name for i in stage.prompt] == ["x"]
    # m a = w - offset at rest, where w is the mean force: the reading of a stage with moments m_0 and m_1 does not see m_1
    h, b = 0.1, 0.3
    y = np.array([0.0, 0.0, b * h**3 / 6, b * h**2 / 2])  # a = b t: no force at the start, and b h/2 of a mean
    d = np.concatenate([[h, 0.0], [OFFSET, OFFSET], [0.0, 0.0], [1.0], [1.0, 1.0]])
    e = np.asarray(stage.rows(y, np.empty(0), d)[0]).ravel()
    springs = (K * b * h**4 / 24 + D * b * h**3 / 6) / h  # means of k s and d v over the interval
    assert e[-1] == pytest.approx(b * h / 2 + springs / M, rel=1e-6)


def test_reflections_are_those_of_dense_linear_algebra():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(7, 5)) * (rng.random((7, 5)) < 0.7)
    symbols = ca.SX.sym("a", int((A != 0).sum()))
    pattern = ca.sparsify(ca.DM(A)).sparsity()
    f = ca.Function("f", [symbols], [ca.densify(triangular(ca.SX(pattern, symbols), 4))])
    found = np.array(f(ca.sparsify(ca.DM(A)).nonzeros()))
    np.testing.assert_allclose(np.abs(found[:4, :4]), np.abs(np.linalg.qr(A)[1][:4, :4]), atol=1e-12)
    np.testing.assert_allclose(found.T @ found, A.T @ A, atol=1e-12)
    solved = np.array(ca.DM(back_substituted(ca.SX(ca.DM(found)), 4)))
    np.testing.assert_allclose(solved[:, 0], np.linalg.lstsq(A[:, :4], A[:, 4], rcond=None)[0], atol=1e-10)


def test_columns_that_equations_determine_best_come_from_the_first_group_as_far_as_it_goes():
    J = np.array([[1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 0.0]])
    assert best_determined(J, [[0, 1], [2, 3]]) == (0, 2)
    with pytest.raises(np.linalg.LinAlgError, match="1 of the equations"):
        best_determined(J, [[0, 1], [3]])


@pytest.mark.parametrize("bend", [0.9, 1.4, 1.9, 1.99, 60.0])
def test_a_step_that_lands_as_high_on_the_other_side_of_a_bend_is_shortened_to_the_bottom(bend):
    """Along the step the cost is c - 2 a t + a bend t^2, least at 1 / bend; Gauss-Newton says bend = 1."""
    c, a, tried = 100.0, 3.0, []

    class Along(Window):
        def __init__(self):
            self.here = Trajectory(np.zeros((1, 1)), np.empty((0, 0)), np.empty(0))

        def _errors(self, at, _):
            tried.append(at.x[0, 0])
            return at.x, at.x[0], 0.0

        def _rolled(self, step, length):
            return self.here.moved(step, length)  # this cost has no balances to keep

        def _cost(self, at, *_):
            t = at.x[0, 0]
            return c - 2 * a * t + a * bend * t**2

    step, nothing = Trajectory(np.ones((1, 1)), np.empty((0, 0)), np.empty(0)), np.empty(0)
    length, cost, there, e, _ = Along()._searched(step, a, c, 0.0, (nothing, nothing), False)
    wanted = 1.0 if bend < 1.5 else 1 / bend
    assert length == there.x[0, 0] == e[0, 0]
    assert abs(length / wanted - 1) < 1e-9
    assert cost == pytest.approx(c - 2 * a * length + a * bend * length**2)
    assert len(set(tried)) <= 3
