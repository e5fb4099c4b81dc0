"""Least squares on constraints: steps against the dense KKT system, answers against the conditions of optimality, dense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import compiled, lagged, near_the_swing, number, pendulum, random_horizon, stiffening, swung

from backsight.data.generators import drillstring
from backsight.models import compile_model
from backsight.models.plants import PLANTS
from backsight.ocp import Horizon, Mesh, ParameterPrior, Solver, Transcription, constrained, transcribe
from backsight.ocp.constrained import descend_on_constraints, supported
from backsight.ocp.nlp import Values
from backsight.ocp.passing import passing_through
from backsight.ocp.saddle_point import SaddlePoint

MODELS = {"lagged": compiled(lagged()), "stiffening": compiled(stiffening())}


def program(name: str, method: str = "spline", horizons: int = 1, known: bool = False) -> tuple[Transcription, Values]:
    """A program that is determined, and its numbers about a point that is not its solution."""
    dae, made = MODELS[name], []
    for k in range(horizons):
        h = random_horizon(dae, 20 + k, intervals=4 + k)
        std = np.full(len(dae.states), 10.0)
        if known:
            std[-1] = 0.0
        made.append(replace(h, initial_std=std, initial=0.1 * np.ones(len(std))))
    prior = ParameterPrior(mean=np.array([2.0, 0.7]), std=np.array([1.0, 3.0]))
    t = transcribe(dae, made, free=number(dae, "mass.m", "offset.f"), prior=prior, force_std={0: 0.5}, method=method, degree=2)
    start = np.random.default_rng(5).normal(size=t.nlp.size) * 0.2
    start[t.nlp.trajectory_size :] = 1.5, 0.5
    values = replace(t.nlp.values(np.array([p.value for p in dae.parameters])), unit=np.random.default_rng(6).uniform(0.5, 2.0, t.nlp.size))
    return t, t.nlp.about(values, start)


def bounds(t: Transcription, known: bool = False) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = np.full(t.nlp.size, -np.inf), np.full(t.nlp.size, np.inf)
    if known:
        for start in t.starts:
            lower[start[-1]] = upper[start[-1]] = 0.0
    return lower, upper


def dense(t: Transcription, values: Values, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows r and constraints c, each column by column, and their Jacobians as one matrix each."""
    rows: dict[bool, list[np.ndarray]] = {False: [], True: []}
    slopes: dict[bool, list[np.ndarray]] = {False: [], True: []}
    n = t.nlp.trajectory_size
    for k, term in enumerate(t.nlp.terms):
        part = t.nlp.evaluated.linearised(k, X, values)
        for column, interval in enumerate(term.interval):
            J = np.zeros((part.J.shape[1], t.nlp.size))
            J[:, t.nlp.index[:, interval]] = part.J[column, :, : len(t.nlp.index)]
            J[:, n:] = part.J[column, :, len(t.nlp.index) :]
            rows[term.equality].append(part.r[:, column])
            slopes[term.equality].append(J)
    return np.concatenate(rows[False]), np.vstack(slopes[False]), np.concatenate(rows[True]), np.vstack(slopes[True])


def factored(t: Transcription, values: Values, fixed: np.ndarray) -> SaddlePoint:
    evaluated, X = t.nlp.evaluated, np.zeros(t.nlp.size)
    parts = [evaluated.linearised(k, X, values) for k in range(len(t.nlp.terms))]
    squares = [p for p in parts if not t.nlp.terms[p.number].equality]
    return SaddlePoint(t.nlp, evaluated.squares(squares), [p for p in parts if t.nlp.terms[p.number].equality], fixed)


@pytest.mark.parametrize("known", [False, True], ids=["vague-start", "known-start"])
@pytest.mark.parametrize("horizons", [1, 2])
@pytest.mark.parametrize("method", ["spline", "collocation"])
@pytest.mark.parametrize("name", MODELS)
def test_a_step_and_its_multipliers_solve_the_dense_kkt_system(name, method, horizons, known):
    t, values = program(name, method, horizons, known)
    lower, upper = bounds(t, known)
    kkt = factored(t, values, lower == upper)
    r, J, c, A = dense(t, values, np.zeros(t.nlp.size))
    s, multipliers = kkt.step(J.T @ r, c, lower, upper)
    np.testing.assert_allclose(A @ s, -c, atol=1e-9 * np.abs(c).max())
    assert not s[lower == upper].any()
    left = (J.T @ (r + J @ s) + A.T @ multipliers)[lower != upper]
    assert np.abs(left).max() < 1e-9 * np.max(np.abs(J).T @ np.abs(r))


@pytest.mark.parametrize("bounded", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_the_answer_is_on_the_constraints_and_no_direction_there_is_downhill(name, bounded):
    t, values = program(name, horizons=2)
    lower, upper = bounds(t)
    if bounded:
        free = descend_on_constraints(t.nlp, values, lower, upper, 1e-7, 60).X[-2]
        lower[-2] = 0.5 * free + 0.1
        upper[-2] = lower[-2] + 1.0 if free < lower[-2] else lower[-2] + 0.05
    found = descend_on_constraints(t.nlp, values, lower, upper, 1e-7, 60)
    assert found.solved or found.acceptable
    r, J, c, A = dense(t, values, found.X)
    assert np.abs(c).max() < 1e-8
    assert found.cost == pytest.approx(r @ r / 2, rel=1e-12)
    left = J.T @ r + A.T @ found.multipliers
    low, high = lower == found.X, upper == found.X
    at = low | high
    assert at.any() == bounded
    assert np.abs(left[~at]).max() < 1e-6 * np.max(np.abs(J).T @ np.abs(r))
    assert np.all(left[low] > 0)
    assert np.all(left[high] < 0)
    # and it is no saddle: along what the constraints leave, the squares grow
    null = np.linalg.svd(A[:, ~at])[2][np.linalg.matrix_rank(A[:, ~at]) :].T
    assert np.linalg.eigvalsh(null.T @ (J.T @ J)[np.ix_(~at, ~at)] @ null).min() > 0


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_what_must_hold_at_the_start_alone_is_held_there(method):
    dae = compiled(pendulum())
    assert dae.invariants.shape[0] > 0
    h = swung(dae)
    prior = ParameterPrior(mean=np.array([1.0]), std=np.array([0.1]))
    t = transcribe(dae, [h], free=(0,), prior=prior, force_std={0: 0.5, 1: 0.5}, method=method, degree=2)
    start = near_the_swing(dae, t.nlp.index, t.nlp.size)
    lower, upper = bounds(t)
    numbers = t.nlp.values(np.array([p.value for p in dae.parameters]))
    start[-1] = numbers.parameters[0]
    near = Solver(t.nlp).solve(start, numbers, lower=lower, upper=upper).decisions
    values = t.nlp.about(numbers, near * np.random.default_rng(0).uniform(0.97, 1.03, len(near)))
    r, J, c, A = dense(t, values, np.zeros(t.nlp.size))
    s, multipliers = factored(t, values, lower == upper).step(J.T @ r, c, lower, upper)
    np.testing.assert_allclose(A @ s, -c, atol=1e-9 * np.abs(c).max())
    left = J.T @ (r + J @ s) + A.T @ multipliers
    assert np.abs(left).max() < 1e-9 * np.max(np.abs(J).T @ np.abs(r))


def test_bounds_of_a_trajectory_are_for_another_method_and_fixed_states_are_not():
    t, _ = program("lagged")
    lower, upper = bounds(t, known=True)
    lower[-1] = -1.0
    assert supported(t.nlp, lower, upper)
    lower[3] = -1.0
    assert not supported(t.nlp, lower, upper)


def test_where_no_part_of_a_step_leads_down_a_damped_one_does():
    dae = MODELS["stiffening"]
    h = random_horizon(dae, 4, intervals=40)
    h = replace(h, initial_std=np.full(len(dae.states), 10.0), initial=0.1 * np.ones(len(dae.states)))
    prior = ParameterPrior(mean=np.array([2.0, 0.7]), std=np.array([1.0, 3.0]))
    t = transcribe(dae, [h], free=number(dae, "mass.m", "offset.f"), prior=prior, force_std={0: 0.002}, method="spline", degree=2)
    parameters = np.array([p.value for p in dae.parameters])
    parameters[list(number(dae, "friction.f_c", "friction.width"))] = 8.0, 0.03  # a sign that plain steps overshoot
    start = np.random.default_rng(104).normal(size=t.nlp.size) * 0.2
    start[t.nlp.trajectory_size :] = 1.5, 0.5
    values = t.nlp.about(t.nlp.values(parameters), start)
    found = descend_on_constraints(t.nlp, values, *bounds(t), 1e-7, 100)
    r, J, c, A = dense(t, values, found.X)
    assert np.abs(c).max() < 1e-8
    kkt = np.block([[J.T @ J, A.T], [A, np.zeros((len(A), len(A)))]])
    s = np.linalg.lstsq(kkt, np.concatenate([-J.T @ r, -c]), rcond=None)[0][: t.nlp.size]
    assert -(J.T @ r) @ s < 0.1  # a plain step would save no more than that of the cost, to first order


def stuck_and_slipping(seed: int, off: list[float]) -> tuple[Transcription, Values, np.ndarray, np.ndarray]:
    """A recorded string with a bit that nobody sees, started where the bit goes that has other numbers: the model's times `off`."""
    run, dae, rows = drillstring.record(seed=seed), compile_model(PLANTS["drillstring"]()), slice(0, 1000)
    time = run.time[rows]
    h = Horizon(
        mesh=Mesh(time),
        time=time,
        inputs=np.column_stack([run.inputs[i.name] for i in dae.inputs])[rows],
        target=np.column_stack([run.outputs[o.name] for o in dae.outputs])[rows],
        target_std=np.tile([run.noise[o.name] for o in dae.outputs], (len(time), 1)),
        initial=np.zeros(len(dae.states)),
        initial_std=np.full(len(dae.states), np.inf),
    )
    free, parameters = number(dae, "string.k", "bha.J", "bit.tau_sl", "bit.tau_st"), np.array([p.value for p in dae.parameters])
    parameters[list(number(dae, "bit.width"))] = 0.06
    first = parameters[list(free)] * off
    prior = ParameterPrior(mean=first, std=np.full(len(free), 1e3))
    t = transcribe(dae, [h], free=free, prior=prior, force_std={0: 0.02, 1: 0.005, 2: 0.005})
    shown = {**run.truth, **bit_behind(time, run.truth["rotary_table.omega"], *first)}
    states = np.array([shown[q.name][rows] for q in dae.states])
    followed = passing_through(t, lambda _, times: (np.array([np.interp(times, time, x) for x in states]), np.zeros((0, len(times)))))
    start, values = np.concatenate([followed, first]), t.nlp.values(parameters)
    diagonal = Solver(t.nlp).weights(start, values)
    values = t.nlp.about(replace(values, unit=1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))), start)
    lower, upper = bounds(t)
    lower[t.nlp.trajectory_size :] = 1e-6
    return t, values, values.scaled(lower), values.scaled(upper)


def bit_behind(time: np.ndarray, table: np.ndarray, k: float, J: float, sliding: float, breakaway: float) -> dict[str, np.ndarray]:
    """Twist and speed of a bit on a string that the table winds, by small implicit steps of its own equations."""
    twist, speed, parts = np.zeros(len(time)), np.zeros(len(time)), 40
    for i, h in enumerate(np.diff(time) / parts):
        phi, v = twist[i], speed[i]
        for j in range(parts):
            phi_dot, x = table[i] + (table[i + 1] - table[i]) * j / parts - v, v
            level, torque = sliding + (breakaway - sliding) * np.exp(-abs(v)), k * phi - 0.001 * v
            for _ in range(6):
                rounded = np.tanh(x / 0.06)
                x -= (J * (x - v) / h - torque + level * rounded) / (J / h + level * (1.0 - rounded**2) / 0.06)
            phi, v = phi + h * phi_dot, x
        twist[i + 1], speed[i + 1] = phi, v
    return {"string.dphi": twist, "bha.omega": speed}


@pytest.mark.slow
@pytest.mark.long
def test_past_a_bit_that_sticks_parameters_leap_where_damped_steps_creep(monkeypatch):
    """How much further a leap leads hangs on a hair, as where the bit breaks away; never is where it leads worse than where steps creep."""
    ratios = []
    for seed, off in ((3, [1.2, 1.2, 1.6, 1.3]), (5, [1.2, 1.2, 1.5, 1.5])):
        t, values, lower, upper = stuck_and_slipping(seed, off)
        leapt = descend_on_constraints(t.nlp, values, lower, upper, 1e-2, 200)
        with monkeypatch.context() as patched:
            patched.setattr(constrained, "VAIN", 0)
            crept = descend_on_constraints(t.nlp, values, lower, upper, 1e-2, 200)
        ratios.append(leapt.cost / crept.cost)
        equality = [term.equality for term in t.nlp.terms].index(True)
        assert np.abs(t.nlp.evaluated.rows(leapt.X, values)[equality]).max() < 1e-6
    assert max(ratios) < 1.0
    assert min(ratios) < 0.7


def test_a_leap_that_has_not_paid_in_time_is_taken_back(monkeypatch):
    t, values, lower, upper = stuck_and_slipping(3, [1.2, 1.2, 1.6, 1.3])
    leap, restart, before, after = constrained._Way.leap, constrained._Way.restart, list[float](), list[float]()

    def leapt(way: constrained._Way) -> bool:
        cost = way.here.cost
        before.extend([cost] if (there := leap(way)) else [])
        return there

    def restarted(way: constrained._Way, there: constrained._Point) -> None:
        after.append(there.cost)
        restart(way, there)

    monkeypatch.setattr(constrained._Way, "leap", leapt)
    monkeypatch.setattr(constrained._Way, "restart", restarted)
    monkeypatch.setattr(constrained, "PATIENCE", 2)
    found = descend_on_constraints(t.nlp, values, lower, upper, 1e-2, 60)
    assert before
    assert after[0] > before[0]  # a leap costs at first,
    assert after[1] == before[0]  # and two steps later there was no less than without it
    assert found.cost < before[0]


def test_where_there_is_no_room_for_a_leap_to_pay_there_is_none(monkeypatch):
    t, values, lower, upper = stuck_and_slipping(3, [1.2, 1.2, 1.6, 1.3])
    short = descend_on_constraints(t.nlp, values, lower, upper, 1e-2, 40)
    monkeypatch.setattr(constrained, "VAIN", 0)
    assert descend_on_constraints(t.nlp, values, lower, upper, 1e-2, 40).cost == short.cost


@pytest.mark.parametrize("tolerance", [1e-7, 1e-2])
@pytest.mark.parametrize("name", list(MODELS))
def test_a_descent_does_not_end_while_parameters_stay_where_they_leapt(name, tolerance, monkeypatch):
    """Trajectories arrive in fewer steps than parameters stay for; a wrong leap, which none would ask for here."""
    t, values = program(name, horizons=2)
    plain = descend_on_constraints(t.nlp, values, *bounds(t), tolerance, 100)
    step, leapt = constrained._Way._stepped, list[int]()

    def stepped(way: constrained._Way, over: bool) -> bool:
        goes_on = step(way, over)
        if goes_on and not leapt:
            X = way.here.X.copy()
            X[t.nlp.trajectory_size :] += 0.3
            way.restart(constrained._at(t.nlp, X, values))
            way._staying = constrained.HOLD
            leapt.append(1)
        return goes_on

    monkeypatch.setattr(constrained._Way, "_stepped", stepped)
    found = descend_on_constraints(t.nlp, values, *bounds(t), tolerance, 100)
    assert leapt
    assert found.cost == pytest.approx(plain.cost, rel=1e-3)
    assert found.solved or found.acceptable
