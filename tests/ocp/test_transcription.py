"""Two transcriptions of one problem: their orders of convergence, their agreement, and what they refuse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import COULOMB, HARDENING, LAG, OFFSET, WIDTH, D, K, M, compiled, lagged, number, random_horizon, stiffening

from backsight.ocp import Horizon, Mesh, ParameterPrior, Solution, Solver, transcribe
from backsight.ocp.scaling import scaled
from backsight.ocp.solved import Options

DAE = compiled(stiffening())
PLANT = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG)
START = np.array([1.0, 0.3, 0.4])
END = 0.4
NOTHING = ParameterPrior(mean=np.empty(0), std=np.empty(0))
PARAMETERS = np.array([p.value for p in DAE.parameters])
SMOOTH = 3.0  # rounding of the friction law in the tests of order: its poles in the complex plane must be far away


def from_known_start(knots: np.ndarray, u: np.ndarray, time: np.ndarray) -> Horizon:
    """No samples at all, a start that is known: an initial value problem."""
    n = len(time)
    return Horizon(
        mesh=Mesh(knots),
        time=time,
        inputs=u[:, None],
        target=np.full((n, 2), np.nan),
        target_std=np.ones((n, 2)),
        initial=START,
        initial_std=np.zeros(3),
    )


def integrated(method: str, degree: int, h: Horizon, force_std: dict[int, float], width: float = SMOOTH) -> np.ndarray:
    """States at the knots, (N + 1, 3)."""
    t = transcribe(DAE, [h], free=(), prior=NOTHING, force_std=force_std, method=method, degree=degree)  # type: ignore[arg-type]
    start, nx = np.zeros(t.nlp.size), 3
    index = t.nlp.index
    for rows in (index[:nx], index[-nx:]):
        start[rows] = START[:, None]
    parameters = PARAMETERS.copy()
    parameters[number(DAE, "friction.width")] = width
    solver = Solver(t.nlp, Options(tolerance=1e-8))
    values = scaled(solver, start, t.nlp.values(parameters))
    lower, upper = np.full(t.nlp.size, -np.inf), np.full(t.nlp.size, np.inf)
    lower[t.starts[0]] = upper[t.starts[0]] = START
    solved = solver.solve(start, values, lower=lower, upper=upper)
    assert solved.status.converged
    return np.vstack([solved.decisions[index[:nx]].T, solved.decisions[index[-nx:, -1]]])


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """The motion at 81 even times under a constant force."""
    time = np.linspace(0.0, END, 81)
    return truths.stiffening_motion(PLANT, HARDENING, COULOMB, SMOOTH, time, np.full(81, 5.0), START)


COARSEST = {1: 20, 2: 10, 3: 5, 4: 5}


@pytest.mark.parametrize(
    ("method", "degree", "soft"),
    [*(("spline", d, s) for d in (2, 3, 4) for s in (False, True)), *(("collocation", d, False) for d in (1, 2, 3, 4))],
)
def test_the_order_at_the_knots_is_2k_for_splines_and_2k_minus_1_for_radau(method, degree, soft, truth):
    errors = []
    for n in COARSEST[degree] * np.array([1, 2, 4]):
        time = np.array([0.0, END])
        states = integrated(method, degree, from_known_start(np.linspace(0, END, n + 1), np.full(2, 5.0), time), {0: 1e-4} if soft else {})
        errors.append(float(np.max(np.abs(states - truth[:: 80 // n]) / np.abs(truth).max(axis=0))))
    promised = 2 * degree if method == "spline" else 2 * degree - 1
    measured = truths.orders([e for e in errors if e > 1e-9])  # what the solver's tolerance lets through
    assert len(measured) > 0
    assert np.all(np.abs(measured - promised) < 0.6), (errors, measured)


def test_both_find_the_steps_of_an_input_inside_their_intervals():
    """The force changes 16 times an interval: only its moments are seen, and the error at the knots falls with them."""
    rng = np.random.default_rng(0)
    time = np.linspace(0.0, END, 161)
    u = 5.0 + 5.0 * rng.normal(size=161)
    exact = truths.stiffening_motion(PLANT, HARDENING, COULOMB, SMOOTH, time, u, START)
    for method, degree in (("spline", 2), ("spline", 3), ("collocation", 3)):
        states = integrated(method, degree, from_known_start(time[::16], u, time), {})
        seen = np.max(np.abs(states - exact[::16]) / np.abs(exact).max(axis=0), axis=0)
        assert np.all(seen < 5e-3), (method, degree, seen)


def smoothing(method: str, force_std: float, degree: int = 2) -> Solution:
    """A nonlinear plant with noisy samples and two free parameters."""
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 1.0, 101)
    u = 8 * np.sin(9 * time + 3 * np.sin(5 * time))
    x = truths.stiffening_motion(PLANT, HARDENING, COULOMB, WIDTH, time, u, START)
    y = x[:, 1:] + np.array([1e-3, 1e-2]) * rng.normal(size=(101, 2))
    h = Horizon(
        mesh=Mesh(time[::2]),
        time=time,
        inputs=u[:, None],
        target=y,
        target_std=np.tile([1e-3, 1e-2], (101, 1)),
        initial=START,
        initial_std=np.full(3, np.inf),
    )
    free = number(DAE, "mass.m", "spring.k")
    prior = ParameterPrior(mean=np.array([M, K]), std=np.full(2, np.inf))
    t = transcribe(DAE, [h], free=free, prior=prior, force_std={0: force_std}, method=method, degree=degree)  # type: ignore[arg-type]
    start = np.zeros(t.nlp.size)
    start[t.nlp.index[:3]], start[t.nlp.index[-3:]] = x[:-2:2].T, x[2::2].T
    if method == "collocation":
        start[t.nlp.index[3 : 3 * degree]] = np.tile(x[1::2].T, (degree - 1, 1))
    start[-2:] = 0.8 * M, 1.3 * K
    solver, free_bounds = Solver(t.nlp, Options(tolerance=1e-8)), np.full(t.nlp.size, np.inf)
    values = scaled(solver, start, t.nlp.values(PARAMETERS))
    return Solution(
        transcription=t, solver=solver, values=values, solved=solver.solve(start, values, lower=-free_bounds, upper=free_bounds)
    )


@pytest.mark.slow
def test_the_two_agree_as_the_residual_force_gets_stiff():
    differences = []
    for force_std in (0.3, 0.03, 0.003):
        # degree 3 for collocation: its own error is then below what is compared
        one, other = smoothing("spline", force_std), smoothing("collocation", force_std, degree=3)
        assert one.solved.status.converged
        assert other.solved.status.converged
        a, b = (s.solved.decisions[-2:] for s in (one, other))
        states = [s.sampled(0).states[:, 1:] for s in (one, other)]
        # parameters relative to their size, states to the noise of their samples
        differences.append([np.max(np.abs(a / b - 1)), np.max(np.abs(states[0] - states[1]) / [1e-3, 1e-2])])
    table = np.array(differences)
    assert np.all(np.diff(table[:, 0]) < 0), table
    assert np.all(table[-1] < [1e-6, 2e-3]), table


@pytest.mark.parametrize(
    ("method", "degree", "rule"),
    [("spline", 1, "2 .. 5"), ("spline", 6, "2 .. 5"), ("collocation", 0, "1 .. 5"), ("collocation", 6, "1 .. 5")],
)
def test_a_degree_that_the_method_does_not_have_is_refused(method, degree, rule):
    h = random_horizon(DAE, 0)
    with pytest.raises(ValueError, match=rf"transcribe\(degree=\.\.\.\) must be {rule} for method '{method}'; got {degree}\."):
        transcribe(DAE, [h], free=(), prior=NOTHING, force_std={}, method=method, degree=degree)


@pytest.mark.parametrize("std", [0.0, -1.0, np.nan, np.inf])
def test_a_force_std_that_is_no_deviation_is_refused_by_its_place(std):
    with pytest.raises(ValueError, match=r"transcribe\(force_std=\.\.\.\) needs finite, positive values; check mass\."):
        transcribe(DAE, [random_horizon(DAE, 0)], free=(), prior=NOTHING, force_std={0: std})


def test_only_terms_that_say_something_are_written():
    h = random_horizon(DAE, 0)

    def names(horizon: Horizon, prior: ParameterPrior, force_std: dict[int, float], method: str) -> list[str]:
        free = (1,) * len(prior.mean)
        t = transcribe(DAE, [horizon], free=free, prior=prior, force_std=force_std, method=method)  # type: ignore[arg-type]
        return [term.name for term in t.nlp.terms]

    vague = ParameterPrior(mean=np.ones(1), std=np.full(1, np.inf))
    assert names(h, vague, {0: 1.0}, "spline") == ["balances", "equations", "samples"]
    assert names(h, vague, {}, "spline") == ["equations", "samples"]
    assert names(h, vague, {0: 1.0}, "collocation") == ["equations", "residual forces", "samples"]
    assert names(replace(h, initial_std=np.zeros(3)), NOTHING, {}, "collocation") == ["equations", "samples"]
    told = names(replace(h, initial_std=np.array([0.0, 1.0, np.inf])), replace(vague, std=np.ones(1)), {0: 1.0}, "spline")
    assert told == ["balances", "equations", "samples", "initial state", "parameter prior"]


def test_the_force_std_in_force_follows_the_scale_of_its_rows():
    t = transcribe(compiled(lagged()), [random_horizon(compiled(lagged()), 0)], free=(), prior=NOTHING, force_std={0: 0.4})
    values = t.nlp.values(np.ones(6))
    assert t.force_std_at(values) == pytest.approx([0.4])
    scale = tuple(s / 3 if term.name == "balances" else s for term, s in zip(t.nlp.terms, values.scale, strict=True))
    assert t.force_std_at(replace(values, scale=scale)) == pytest.approx([1.2])
