"""Parameters of most marginal likelihood against that of a Kalman filter by hand, which integrates the trajectories out exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, K, M, compiled, on_mass, oscillator
from scipy.optimize import minimize
from studies import coverage

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.smoothing import work
from backsight.estimation.smoothing.marginal import UNMOVED, WORTH, Moved, at, intervals_apart
from backsight.estimation.smoothing.profile import profile
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.smoothing.robust import RobustSolution
from backsight.models.mechanics.translational import Damper, Force, Spring
from backsight.ocp.marginal import Marginal

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

STEP, STD, LIGHT, STRONG = 0.01, 1e-3, 0.15, 1.5
TRUE = truths.Plant(m=M, d=LIGHT, k=K, offset=OFFSET)
NAMES = ("mass.m", "damper.d", "spring.k", "offset.f")
GUESSES = {"mass.m": Free(3.0), "damper.d": Free(0.5), "spring.k": Free(30.0), "offset.f": Free(0.0)}


def run(n: int, seed: int, force_std: float = STRONG) -> tuple[Array, Array, Array]:
    """Times, held input and noisy positions of the lightly damped plant under strong white forces."""
    rng = np.random.default_rng(seed)
    time, u = STEP * np.arange(n), 3.0 * np.repeat(rng.normal(size=n // 20 + 1), 20)[:n]
    x = truths.disturbed(TRUE, time, u, np.zeros(2), force_std, rng)
    return time, u, x[:, 0] + STD * rng.standard_normal(n)


def negative_log_likelihood(theta: Array, u: Array, y: Array, acceleration_std: float) -> float:
    """-log p(y | theta, x_0) of x' = A x + B (u, 1) + G w at its best x_0, but for a constant: the innovations are linear in that.

    The accelerations' density stays as theta moves: how large forces are said to be is no measurement of a mass.
    """
    m, d, k, offset = theta
    A, B, G = truths.Plant(m=m, d=d, k=k, offset=offset).matrices
    (phi, gamma), Q = truths.discrete(A, B, STEP), truths.noise_covariance(A, G, (acceleration_std * m) ** 2, STEP)
    # the mean, and how it hangs on x_0
    x, P, logs, rows = np.hstack([np.zeros((2, 1)), np.eye(2)]), np.zeros((2, 2)), 0.0, []
    for push, measured in zip(u, y, strict=True):
        S = P[0, 0] + STD**2
        error = np.array([measured, 0.0, 0.0]) - x[0]
        logs, _ = logs + 0.5 * np.log(S), rows.append(error / np.sqrt(S))
        x, P = x + np.outer(P[:, 0] / S, error), P - np.outer(P[:, 0] / S, P[0])
        x, P = phi @ x, phi @ P @ phi.T + Q
        x[:, 0] += gamma @ [push, 1.0]
    e = np.array(rows)
    best = np.linalg.lstsq(e[:, 1:], -e[:, 0], rcond=None)[0]
    return float(logs + 0.5 * np.sum((e[:, 0] + e[:, 1:] @ best) ** 2))


def smoothed(u: Array, y: Array, *, marginal: bool = True, force_std: float = STRONG, **given: object) -> Smoothing:
    recording = Recording(
        name="run",
        time=STEP * np.arange(len(y)),
        inputs={"F": u},
        outputs={"x": y},
        output_std={"x": STD},
        output_loss=given.pop("loss", {}),
    )
    asked = {"parameters": GUESSES, "weights": Weights(W={"mass": force_std})} | given
    settings = replace(asked.pop("settings", Settings()), marginal=marginal)
    result = smooth(Problem(model=compiled(oscillator()), recordings=[recording], **asked), settings=settings)
    assert result.solver.converged
    return result


def values(result: Smoothing) -> Array:
    return np.array([result.parameters[name].value for name in NAMES])


def test_the_parameters_are_those_of_the_exact_likelihood_and_the_most_probable_with_a_trajectory_are_not():
    _, u, y = run(2000, 3)
    result, joint = smoothed(u, y), smoothed(u, y, marginal=False)
    std = np.array([result.parameters[name].std for name in NAMES])
    start = values(result)

    def cost(e: Array) -> float:
        return negative_log_likelihood(start + e * std, u, y, STRONG / start[0])

    # from where the truth is
    best = minimize(
        cost, (np.array([M, LIGHT, K, OFFSET]) - start) / std, method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-4, "maxfev": 600}
    )
    assert np.max(np.abs(best.x)) < WORTH
    assert (values(joint)[1] - start[1]) / std[1] < -1.0
    # the deviations are those of that likelihood's parabola
    h, one = 0.1, np.eye(4)
    bend = [[cost(h * (i + j)) - cost(h * (i - j)) - cost(h * (j - i)) + cost(-h * (i + j)) for i in one] for j in one]
    exact = np.sqrt(np.diag(np.linalg.inv(np.array(bend) / (4 * h * h))))
    assert exact == pytest.approx(np.ones(4), rel=0.05)


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_its_slope_is_that_of_the_exact_likelihood(method):
    _, u, y = run(600, 5)
    result = smoothed(u, y, marginal=False, settings=Settings(method=method, check_mesh=False))
    solution = result.solution
    assert solution is not None
    found = at(solution)
    order = [NAMES.index(solution.transcription.dae.parameters[i].name) for i in solution.transcription.nlp.free]
    theta, std = values(result), found.std[np.argsort(order)]

    def likelihood(e: Array) -> float:
        return negative_log_likelihood(theta + e * std, u, y, STRONG / theta[0])

    exact = -np.array([(likelihood(0.005 * e) - likelihood(-0.005 * e)) / 0.01 for e in np.eye(4)])
    assert (found.slope * found.std)[np.argsort(order)] == pytest.approx(exact, abs=2e-3)
    assert np.max(np.abs(exact)) > 0.5


def test_a_damping_that_was_driven_to_its_bound_comes_off_it():
    _, u, y = run(2000, 3, force_std=5.0)
    joint, result = (smoothed(u, y, marginal=marginal, force_std=5.0) for marginal in (False, True))
    assert joint.parameters["damper.d"].on_bound
    damping = result.parameters["damper.d"]
    assert not damping.on_bound
    assert damping.std is not None
    assert abs(damping.value - LIGHT) < 3 * damping.std


def test_with_hubers_loss_outliers_change_little():
    _, u, y = run(2000, 3)
    rng = np.random.default_rng(0)
    spoiled = y.copy()
    spoiled[rng.choice(len(y), 20, replace=False)] += 100 * STD
    clean, robust = smoothed(u, y), smoothed(u, spoiled, loss={"x": "huber"})
    joint = smoothed(u, spoiled, loss={"x": "huber"}, marginal=False)
    std = np.array([clean.parameters[name].std for name in NAMES])
    assert np.max(np.abs(values(robust) - values(clean)) / std) < 0.5
    assert (values(joint)[1] - values(robust)[1]) / std[1] < -0.5


def test_the_answer_lies_on_a_bound_that_it_meets():
    _, u, y = run(2000, 3)
    free = smoothed(u, y).parameters["damper.d"]
    joint = smoothed(u, y, marginal=False).parameters["damper.d"]
    most = 0.5 * (free.value + joint.value)
    held = smoothed(u, y, parameters={**GUESSES, "damper.d": Free(0.5 * most, max=most)}).parameters["damper.d"]
    assert held.on_bound
    assert held.value == most


def test_profiles_are_those_of_the_exact_likelihood():
    time, u, y = run(2000, 3)
    result = smoothed(u, y)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    posed = Problem(model=compiled(oscillator()), recordings=[recording], parameters=GUESSES, weights=Weights(W={"mass": STRONG}))
    found = profile(posed, result, ["damper.d"], points=3)["damper.d"]
    start, scale = values(result), np.array([result.parameters[name].std for name in NAMES])
    others = [0, 2, 3]

    def cost(damping: float) -> float:
        def at(e: Array) -> float:
            theta = start.copy()
            theta[others] += e * scale[others]
            theta[1] = damping
            return negative_log_likelihood(theta, u, y, STRONG / start[0])

        return float(minimize(at, np.zeros(3), method="Nelder-Mead", options={"xatol": 0.02, "fatol": 1e-3}).fun)

    least = cost(found.estimate)
    assert found.estimate == pytest.approx(start[1], abs=1e-3 * scale[1])
    assert [cost(value) - least for value in found.values] == pytest.approx(found.cost, rel=0.08, abs=0.01)
    assert found.limited == ("lower",)
    assert found.cost[-1] == pytest.approx(1.92, abs=1e-2)


def test_rests_are_left_out_of_the_determinants():
    """Three drives that stop and turn: with their rests the parabola of a rounded sign would move a friction by most of a deviation."""
    result = smooth(coverage.pose("xy_table", 2)[0])
    solution = result.solution
    assert solution is not None
    apart, t = intervals_apart(solution), solution.transcription
    assert 0.2 < np.mean(apart) < 0.5
    shifts = []
    for intervals in (np.zeros_like(apart), apart):
        found = Marginal(solution=solution, values=solution.values, apart=intervals)
        shifts.append(np.abs(found.covariance @ found.determinants) / found.std)
    friction = [t.dae.parameters[i].name for i in t.nlp.free].index("friction_3.tau_c")
    assert shifts[0][friction] > 0.3
    assert np.max(shifts[1]) < 0.02


@pytest.mark.parametrize("seed", [3, 5])
def test_what_the_data_do_not_tell_apart_keeps_no_other_parameter_from_its_place(seed):
    """An offset beside a second spring's rest length; and two dampers side by side, of which one is on its bound."""
    time, u, y = run(2000, seed)
    plain = smoothed(u, y).parameters["damper.d"]
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    offset, damper = {"other.k": 1.0, "other.s_rel0": Free(0.0)}, {"other.d": Free(0.1)}
    for part, own in ((Spring(k=1.0), offset), (Damper(d=0.0), damper)):
        model = compiled(on_mass("o", Force(), Spring(k=K), {"x": "sensor.s"}, {"other": part}))
        result = smooth(Problem(model=model, recordings=[recording], parameters=GUESSES | own, weights=Weights(W={"mass": STRONG})))
        dampers = [result.parameters[name].value for name in ("damper.d", "other.d") if name in result.parameters]
        assert plain.std is not None
        assert sum(dampers) == pytest.approx(plain.value, abs=2 * WORTH * plain.std)
        assert any(note.startswith("Parameters are those of most marginal likelihood: ") for note in result.notes)


def test_of_hubers_loss_the_cost_has_no_slope_at_its_own_optimum_whatever_the_prior():
    _, u, y = run(600, 5)
    rng = np.random.default_rng(0)
    spoiled = y + np.where(rng.random(len(y)) < 0.1, 20 * STD * rng.standard_normal(len(y)), 0.0)
    free = smoothed(u, spoiled, loss={"x": "huber"}, marginal=False).parameters["mass.m"]
    assert free.std is not None
    pulled = GUESSES | {"mass.m": Free(free.value + 6 * free.std, std=free.std)}
    solution = smoothed(u, spoiled, loss={"x": "huber"}, marginal=False, parameters=pulled).solution
    assert isinstance(solution, RobustSolution)
    assert np.max(np.abs(solution.gain - 1.0)) > 0.1
    found = at(solution)
    inside = ~np.isin(solution.transcription.nlp.trajectory_size + found.moving, solution.solved.on_bound)
    assert np.max(np.abs(found.pull * found.std)[inside]) < 0.02
    # with what the deviations lack it would have one
    assert np.max(np.abs(replace(found, values=solution.values).pull * found.std)[inside]) > 0.05


def test_steps_that_lead_nowhere_at_the_weights_in_force_are_told(monkeypatch):
    _, u, y = run(2000, 3)
    steps, calls = work.marginal, list[Moved]()

    def failing(*arguments) -> Moved:
        calls.append(steps(*arguments) if not calls else Moved(solution=arguments[1], said=(UNMOVED,)))
        return calls[-1]

    monkeypatch.setattr(work, "marginal", failing)
    result = smoothed(u, y, weights=Weights())
    assert len(calls) > 1
    assert UNMOVED in result.notes


def test_weights_from_the_data_are_those_at_the_parameters_of_most_marginal_likelihood():
    _, u, y = run(2000, 3)
    result = smoothed(u, y, weights=Weights())
    there = {name: result.parameters[name].value for name in NAMES}
    held = smoothed(u, y, weights=Weights(), parameters=there)
    assert any(note.startswith("Parameters are those of most marginal likelihood: ") for note in result.notes)
    assert result.weights.W["mass"] == pytest.approx(held.weights.W["mass"], rel=0.005)
    damping, given = result.parameters["damper.d"], smoothed(u, y).parameters["damper.d"]
    assert given.std is not None
    assert damping.value == pytest.approx(given.value, abs=0.3 * given.std)
