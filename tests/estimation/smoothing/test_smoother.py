"""The whole-horizon smoother on recordings from an independent simulation."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import truths
from examples import COULOMB, HARDENING, LAG, OFFSET, WIDTH, D, K, M, compiled, lagged, oscillator, shaken, stiffening
from scipy.linalg import expm

from backsight.estimation import Free, Known, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.smoothing.smoother import Settings
from backsight.estimation.smoothing.until import Until
from backsight.models.errors import InputError, OutOfTime
from backsight.models.mechanics.translational import ConstantForce
from backsight.models.plants import actuator
from backsight.ocp import Options

PLANT = truths.Plant(m=M, d=D, k=K, offset=OFFSET)
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}
OSCILLATOR = compiled(oscillator())
STD, FORCE_STD, START = 1e-3, 0.1, np.array([0.02, -0.1])


@dataclass(frozen=True)
class Run:
    """A recording and the states behind it."""

    recording: Recording
    states: np.ndarray


def drive(n: int, dt: float, seed: int) -> np.ndarray:
    """Strokes and random steps of ten samples."""
    rng = np.random.default_rng([seed, 1])
    return 20 * np.sign(np.sin(2 * np.pi * np.arange(n) * dt / 1.3 + seed)) + 10 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]


def operate(
    seed: int,
    *,
    n: int = 300,
    dt: float = 0.01,
    force_std: float = FORCE_STD,
    std: float = STD,
    given: bool = True,
    clock: float = 0.0,
    jitter: float = 0.0,
    missing: float = 0.0,
    name: str = "run",
    hold: str = "zero",
    smooth_drive: bool = False,
    start: np.ndarray = START,
) -> Run:
    rng = np.random.default_rng(seed)
    time = dt * (np.arange(n) + jitter * rng.uniform(-0.5, 0.5, n))
    u = 25 * np.sin(3 * time + 2 * np.sin(time)) if smooth_drive else drive(n, dt, seed)
    x = truths.linearly_driven(PLANT, time, u, start) if hold == "linear" else truths.disturbed(PLANT, time, u, start, force_std, rng)
    y = x[:, 0] + std * rng.normal(size=n)
    y[rng.uniform(size=n) < missing] = np.nan
    recording = Recording(
        name=name,
        time=time + clock,
        inputs={"F": u},
        outputs={"x": y},
        output_std={"x": std} if given else {},
        hold=hold,
    )
    return Run(recording, x)


def fit(runs: list[Run], free: dict | None = None, *, W: float | None = FORCE_STD, settings: Settings = Settings(), **more) -> Smoothing:  # noqa: B008
    weights = Weights(W={} if W is None else {"mass": W})
    recordings = [run.recording for run in runs]
    return smooth(
        Problem(model=OSCILLATOR, recordings=recordings, parameters=FREE if free is None else free, weights=weights, **more),
        settings=settings,
    )


def scores(s: Smoothing) -> np.ndarray:
    assert s.solver.converged, s.solver.status
    return np.array([(s.parameters[n].value - v) / s.parameters[n].std for n, v in TRUE.items()])


def covered(s: Smoothing, run: Run) -> np.ndarray:
    """Share of the samples where the 95 % band of each state holds the truth."""
    table = s.estimates[run.recording.name]
    return np.array([np.mean(np.abs(table[q] - run.states[:, i]) < 1.96 * table[f"{q}.std"]) for i, q in enumerate(("mass.s", "mass.v"))])


CONDITIONS = {
    "even": {},
    "jitter": {"jitter": 0.8},
    "missing": {"missing": 0.3},
    "clock": {"clock": 1.7e9},
    "jitter and missing": {"jitter": 0.8, "missing": 0.3},
}


@pytest.mark.parametrize("condition", CONDITIONS)
def test_parameters_and_states_are_found_within_their_deviations(condition):
    run = operate(5, **CONDITIONS[condition])
    s = fit([run])
    assert np.all(np.abs(scores(s)) < 3), scores(s)
    assert np.all(covered(s, run) > 0.85)
    table = s.estimates["run"]
    assert np.array_equal(table["t_s"], run.recording.time)
    assert np.all(np.isfinite(table.drop(columns="x.measured").to_numpy()))
    assert s.fit["run"]["x"].rms == pytest.approx(STD, rel=0.25)


@pytest.mark.parametrize("settings", [Settings(degree=3), Settings(method="collocation", degree=3)], ids=lambda s: f"{s.method} {s.degree}")
def test_method_and_degree_do_not_matter(settings):
    run = operate(5)
    base, other = fit([run]), fit([run], settings=settings)
    for name in TRUE:
        one, two = base.parameters[name], other.parameters[name]
        assert abs(one.value - two.value) < 0.05 * one.std
        assert two.std == pytest.approx(one.std, rel=0.02)
    for column in ("mass.s", "mass.v"):
        a, b = base.estimates["run"], other.estimates["run"]
        assert np.max(np.abs(a[column] - b[column]) / a[f"{column}.std"]) < 0.3


@pytest.mark.slow
def test_over_twenty_seeds_scores_are_centred_and_of_unit_size_and_bands_hold_what_they_promise():
    z, bands = [], []
    for seed in range(20):
        run = operate(seed)
        s = fit([run])
        z.append(scores(s))
        bands.append(covered(s, run))
    z = np.array(z)
    # twenty scores: their mean is known to 0.22, their deviation to 16 %; the joint mode is allowed a bias of half a deviation
    assert np.all(np.abs(z.mean(axis=0)) < 0.5 + 3 * 0.22), z.mean(axis=0)
    assert np.all((z.std(axis=0) > 0.5) & (z.std(axis=0) < 1.5)), z.std(axis=0)
    assert np.all(np.abs(np.mean(bands, axis=0) - 0.95) < 0.03), np.mean(bands, axis=0)


def test_two_recordings_share_the_parameters_and_keep_their_own_states():
    a, b = operate(1, name="a"), operate(2, name="b", n=200, start=np.array([-0.1, 0.3]))
    both, one, other = fit([a, b]), fit([a]), fit([b])
    assert np.all(np.abs(scores(both)) < 3)
    for name in TRUE:
        information = [1 / s.parameters[name].std ** 2 for s in (one, other)]
        assert 1 / both.parameters[name].std ** 2 > 0.9 * sum(information)
    assert np.all(covered(both, a) > 0.8)
    assert np.all(covered(both, b) > 0.8)
    assert both.estimates["b"]["mass.s"].iloc[0] == pytest.approx(-0.1, abs=5 * STD)


def test_a_known_start_is_kept_and_sharpens_what_is_known_of_the_rest():
    run = operate(5)
    free, known = fit([run]), fit([run], initial={"mass.s": START[0], "mass.v": START[1]})
    first = known.estimates["run"].iloc[0]
    assert (first["mass.s"], first["mass.v"]) == pytest.approx(tuple(START), abs=1e-10)
    assert (first["mass.s.std"], first["mass.v.std"]) == pytest.approx((0.0, 0.0), abs=1e-10)
    assert all(known.parameters[n].std <= free.parameters[n].std * 1.001 for n in TRUE)
    assert np.all(np.abs(scores(known)) < 3)


@pytest.mark.parametrize("std", [1e-9, 1e-13, 1e-18])
def test_what_is_known_all_but_exactly_is_as_good_as_known_exactly(std):
    run, wrong = operate(5), np.array([0.07, 0.0])
    exact = fit([run], {**FREE, "mass.m": 2.1}, initial={"mass.s": wrong[0], "mass.v": wrong[1]})
    nearly = fit(
        [run],
        {**FREE, "mass.m": Free(2.1, std=std)},
        initial={name: Known(v, std) for name, v in zip(("mass.s", "mass.v"), wrong, strict=True)},
    )
    assert nearly.solver.converged
    assert nearly.solver.iterations < exact.solver.iterations + 5
    assert nearly.estimates["run"].iloc[0][["mass.s.std", "mass.v.std"]].to_numpy() == pytest.approx([std, std])
    for name in ("spring.k", "damper.d", "offset.f"):
        one, two = exact.parameters[name], nearly.parameters[name]
        assert abs(one.value - two.value) < 1e-3 * one.std
        assert two.std == pytest.approx(one.std, rel=1e-6)


def test_a_sharp_prior_holds_a_parameter_and_a_vague_one_does_not():
    run = operate(5)
    base = fit([run])
    wrong = base.parameters["mass.m"].value + 1.0
    held = fit([run], {**FREE, "mass.m": Free(wrong, std=1e-5)})
    assert held.parameters["mass.m"].value == pytest.approx(wrong, abs=1e-3)
    assert held.parameters["mass.m"].std == pytest.approx(1e-5, rel=1e-2)
    assert fit([run], {**FREE, "mass.m": Free(wrong, std=1e3)}).parameters["mass.m"].value == pytest.approx(
        base.parameters["mass.m"].value, rel=1e-5
    )
    # one prior as sharp as the data: the estimate is the mean of the two, weighted (nearly linear here)
    std = base.parameters["mass.m"].std
    between = fit([run], {**FREE, "mass.m": Free(base.parameters["mass.m"].value + 2 * std, std=std)})
    assert between.parameters["mass.m"].value == pytest.approx(base.parameters["mass.m"].value + std, abs=0.1 * std)
    assert between.parameters["mass.m"].std == pytest.approx(std / np.sqrt(2), rel=0.05)


def test_of_two_offsets_that_only_act_together_the_priors_tell_the_correlation():
    """Two forces f + g of which the samples tell the sum to a variance c: the precision is diag(1/a^2, 1/b^2) + 1/c in all four places."""
    model = oscillator().insert("mass", ConstantForce(f=0.0), name="second")
    a, b, run = 0.03, 0.08, operate(5)

    def smoothed(**offsets: Free | float) -> Smoothing:
        given = {"mass.m": Free(3.0), "offset.f": offsets["f"], "second.f": offsets["g"]}
        return smooth(Problem(model=model, recordings=[run.recording], parameters=given, weights=Weights(W={"mass": FORCE_STD})))

    alone = smoothed(f=Free(0.0), g=0.0)
    c = alone.parameters["offset.f"].std ** 2
    covariance = np.linalg.inv(np.diag([a**-2, b**-2]) + 1 / c)
    both = smoothed(f=Free(0.4, std=a), g=Free(0.3, std=b))
    assert list(both.correlation) == list(both.correlation.index) == ["mass.m", "offset.f", "second.f"]
    matrix = both.correlation.to_numpy()
    assert np.diag(matrix) == pytest.approx(np.ones(3))
    assert matrix[1, 2] == matrix[2, 1] == pytest.approx(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), abs=1e-4)


def test_a_bound_that_excludes_the_truth_is_reached_and_not_passed():
    s = fit([operate(5)], {**FREE, "spring.k": Free(40.0, min=35.0, max=45.0)})
    assert s.solver.converged
    assert s.parameters["spring.k"].value == pytest.approx(45.0, rel=1e-4)
    assert s.parameters["spring.k"].value <= 45.0 * (1 + 1e-7)


def test_inputs_that_run_straight_between_the_samples_are_taken_as_such():
    run = operate(3, dt=0.05, n=120, hold="linear", smooth_drive=True)
    s = fit([run], W=0.02)
    assert np.all(np.abs(scores(s)) < 3), scores(s)
    assert s.fit["run"]["x"].rms == pytest.approx(STD, rel=0.25)


def test_steps_of_the_input_inside_an_interval_act_with_their_full_impulse():
    """A mesh of eight samples an interval, while the force steps at every sample."""
    rng, n = np.random.default_rng(0), 400
    time, u = np.arange(n) * 5e-3, 60 * rng.normal(size=n)
    x = truths.motion(PLANT, time, u, START)
    y = x[:, 0] + STD * rng.normal(size=n)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    s = fit([Run(recording, x)], W=0.05, settings=Settings(step=0.04))
    assert np.all(np.abs(scores(s)) < 3.5), scores(s)
    table = s.estimates["run"]
    assert np.max(np.abs(table["mass.s"] - x[:, 0])) < 1.5 * STD


def with_accelerometer(force_std: float, std: float, n: int = 300) -> Run:
    """The force steps at every sample; the accelerometer reads what acts at the instant of the sample."""
    rng = np.random.default_rng(0)
    time, u = np.arange(n) * 0.01, 60 * rng.normal(size=n)
    x = truths.disturbed(PLANT, time, u, START, force_std, rng)
    a = (u - D * x[:, 1] - K * x[:, 0] - OFFSET) / M + std * rng.normal(size=n)
    y = x[:, 0] + STD * rng.normal(size=n)
    return Run(Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y, "a": a}, output_std={"x": STD, "a": std}), x)


@pytest.mark.parametrize("W", [0.05, 2.0])
def test_a_white_force_that_an_accelerometer_reads_is_estimated_as_by_a_dense_gaussian(W):
    # truth: the force on a grid 20 times finer, reading = acceleration at the sample with the mean force of the interval that begins there
    n, dt, fine, noise = 60, 0.01, 20, np.array([1e-4, 0.3])
    A, _, G = truths.Plant(m=M, d=D, k=K, offset=0.0).matrices
    A, G = A[:2, :2], G[:2, 0]
    big = expm(np.block([[A, G[:, None]], [np.zeros((1, 3))]]) * dt / fine)
    F, g, cells = big[:2, :2], big[:2, 2], n * fine
    x, rows, states = np.zeros((2, 2 + cells)), [], []
    x[:, :2] = np.eye(2)
    for k in range(cells):
        if k % fine == 0:
            mean = np.zeros(2 + cells)
            mean[2 + k : 2 + k + fine] = 1.0 / fine
            rows += [x[0].copy(), A[1] @ x + G[1] * mean]
            states.append(x.copy())
        x = F @ x
        x[:, 2 + k] += g
    rng = np.random.default_rng(0)
    H, std = np.array(rows)[:-1], np.tile(noise, n)[:-1]  # the last reading sees a force that nothing else shows
    prior = np.concatenate([[1e3, 1e3], np.full(cells, W / np.sqrt(dt / fine))])
    drawn = prior * rng.standard_normal(2 + cells)
    drawn[:2] = [0.01, 0.1]
    y = H @ drawn + std * rng.standard_normal(2 * n - 1)
    whole = np.vstack([H / std[:, None] * prior, np.eye(2 + cells)])
    C = np.linalg.inv(whole.T @ whole)
    mean, root = prior * (C @ whole[: 2 * n - 1].T @ (y / std)), np.linalg.cholesky(C) * prior[:, None]
    r = smooth(
        Problem(
            model=compiled(shaken()),
            recordings=[
                Recording(
                    name="r",
                    time=np.arange(n) * dt,
                    inputs={"F": np.zeros(n)},
                    outputs={"x": y[::2], "a": np.append(y[1::2], 9.0)},
                    output_std=dict(zip("xa", noise, strict=True)),
                )
            ],
            parameters={"offset.f": 0.0},
            weights=Weights(W={"mass": W}),
        )
    ).estimates["r"]
    for i, name in enumerate(("mass.s", "mass.v")):
        truth = np.array([s[i] @ mean for s in states])
        spread = np.array([np.linalg.norm(s[i] @ root) for s in states])
        np.testing.assert_allclose(r[f"{name}.std"], spread, rtol=2e-3)
        assert np.max(np.abs(r[name] - truth) / spread) < 0.02


def test_an_accelerometer_slower_than_the_rows_tells_what_it_tells_in_rows_of_its_own():
    """Under a white force; the rows between its samples hold nothing but an input that stays as it is."""
    rng, per, n, h, force, noise = np.random.default_rng(1), 50, 200, 2e-4, 0.3, 0.05
    A, B, _ = PLANT.matrices
    phi, gamma = truths.discrete(A, B, h)
    u, w = np.repeat(drive(n, 0.01, 3), per), force / np.sqrt(h) * rng.normal(size=n * per)
    x, states = np.zeros(2), np.empty((n * per, 2))
    for k in range(n * per):
        states[k] = x
        x = phi @ x + gamma @ [u[k] + w[k], 1.0]
    pushed = w.reshape(n, per).mean(axis=1)
    read = (u[::per] - OFFSET - D * states[::per, 1] - K * states[::per, 0] + pushed) / M + noise * rng.normal(size=n)
    position = states[::per, 0] + STD * rng.normal(size=n)
    found = []
    for every in (per, per // 10):
        rows, share = np.arange(0, (n - 1) * per + 1, every), per // every
        y = {"x": np.full(len(rows), np.nan), "a": np.full(len(rows), np.nan)}
        y["x"][::share], y["a"][::share] = position, read
        recording = Recording(name="run", time=h * rows, inputs={"F": u[rows]}, outputs=y, output_std={"x": STD, "a": noise})
        free = {"mass.m": Free(M), "spring.k": Free(K), "damper.d": Free(D), "offset.f": OFFSET}
        found.append(smooth(Problem(model=compiled(shaken()), recordings=[recording], parameters=free, weights=Weights(W={"mass": force}))))
    for own, between in zip(*([p for p in s.parameters.values() if not p.fixed] for s in found), strict=True):
        assert between.value == pytest.approx(own.value, abs=0.02 * own.std), own.name
        assert between.std == pytest.approx(own.std, rel=0.01), own.name
    assert found[1].fit["run"]["a"].prediction_rms == pytest.approx(1.0, abs=4 / np.sqrt(2 * n))


def test_an_accelerometer_sees_the_steps_of_the_input_at_once_and_weighs_the_mass_whatever_its_guess():
    run = with_accelerometer(0.0, 0.05)
    problem = Problem(
        model=compiled(shaken()), recordings=[run.recording], parameters={"mass.m": Free(4.0)}, weights=Weights(W={"mass": 1e-4})
    )
    s = smooth(problem)
    assert abs(s.parameters["mass.m"].value - M) < 3.5 * s.parameters["mass.m"].std < 0.01 * M
    assert s.fit["run"]["a"].rms == pytest.approx(0.05, rel=0.15)


def test_a_nonlinear_plant_with_an_algebraic_variable_and_an_exact_equation_is_found():
    rng, n = np.random.default_rng(4), 250
    time = np.arange(n) * 0.01
    u = drive(n, 0.01, 4)
    plant = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG)
    x = truths.stiffening_motion(plant, HARDENING, COULOMB, WIDTH, time, u, np.array([0.0, 0.02, 0.0]))
    y = x[:, 1:] + np.array([1e-3, 1e-2]) * rng.normal(size=(n, 2))
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y[:, 0], "v": y[:, 1]}, output_std={"x": 1e-3, "v": 1e-2})
    free = {"mass.m": Free(3.0), "spring.k": Free(40.0), "friction.f_c": Free(0.4), "friction.width": WIDTH}
    s = smooth(Problem(model=stiffening(), recordings=[recording], parameters=free, weights=Weights(W={"mass": 0.02})))
    assert s.solver.converged
    for name, true in (("mass.m", M), ("spring.k", K), ("friction.f_c", COULOMB)):
        p = s.parameters[name]
        assert p.value == pytest.approx(true, rel=0.05), name
        assert p.std is not None, f"{name} is determined, but no deviation is given"
        assert abs(p.value - true) < 3.5 * p.std, name


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"mass.s": START[0], "mass.v": START[1]}], ids=["free start", "known start"])
@pytest.mark.parametrize("n", [300, 4000], ids=["3 s", "40 s"])
def test_a_rigid_balance_gives_estimates_with_deviations_however_long_the_record(given, n):
    s = fit([operate(0, force_std=0.0, n=n)], W=1e-9, initial=given)
    assert s.solver.converged
    assert all(s.parameters[name].std is not None for name in TRUE), s.notes
    assert np.all(np.abs(scores(s)) < 3.5)


@pytest.mark.parametrize("seconds", [1.0, 10.0])
def test_an_exact_lag_leaves_the_deviations_alone_however_long_the_record(seconds):
    """The lag's state is forgotten after 0.2 s: far less than the record."""
    rng, n = np.random.default_rng(2), int(seconds / 0.01)
    plant, time, u = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG), np.arange(n) * 0.01, drive(n, 0.01, 2)
    x = truths.disturbed(plant, time, u, np.array([0.0, *START]), FORCE_STD, rng)
    y = x[:, 1:] + np.array([1e-3, 1e-2]) * rng.normal(size=(n, 2))
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y[:, 0], "v": y[:, 1]}, output_std={"x": 1e-3, "v": 1e-2})
    free = {"spring.k": Free(40.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}
    s = smooth(Problem(model=lagged(), recordings=[recording], parameters=free, weights=Weights(W={"mass": FORCE_STD})))
    for name in free:
        p = s.parameters[name]
        assert p.std is not None, s.notes
        assert abs(p.value - TRUE[name]) < 3.5 * p.std


def test_a_fixed_parameter_keeps_its_value_and_has_no_deviation():
    s = fit([operate(5)], {**FREE, "mass.m": 2.0})
    assert (s.parameters["mass.m"].value, s.parameters["mass.m"].std, s.parameters["mass.m"].fixed) == (2.0, None, True)


def test_a_parameter_that_the_record_cannot_show_is_not_called_identified():
    """At rest neither mass nor damper is felt."""
    n, rng = 200, np.random.default_rng(0)
    y = -OFFSET / K + STD * rng.normal(size=n)
    recording = Recording(name="run", time=np.arange(n) * 0.01, inputs={"F": np.zeros(n)}, outputs={"x": y}, output_std={"x": STD})
    s = fit([Run(recording, np.zeros((n, 2)))], {"mass.m": Free(3.0), "damper.d": Free(1.0)})
    for name in ("mass.m", "damper.d"):
        assert not s.parameters[name].identifiable


def test_the_same_recording_gives_the_same_bits():
    run = operate(5)
    one, two = fit([run], W=None), fit([run], W=None)
    assert all(one.parameters[n].value == two.parameters[n].value and one.parameters[n].std == two.parameters[n].std for n in TRUE)
    assert one.estimates["run"].equals(two.estimates["run"])
    assert one.weights == two.weights


def test_a_solve_stopped_at_its_limit_says_so_and_is_finite():
    s = fit([operate(5)], settings=Settings(options=Options(gauss_newton_iterations=1, max_iterations=0, tolerance=1e-14)))
    assert not s.solver.converged
    assert "limit of iterations" in s.solver.status
    assert np.all(np.isfinite(s.estimates["run"][["mass.s", "mass.v", "x"]].to_numpy()))
    assert all(np.isfinite(p.value) for p in s.parameters.values())


@pytest.mark.slow
def test_the_recorded_axis_gives_its_published_parameters():
    """Janot, Gautier, Brunot 2019: 95.11 kg, 203.5 N.s/m, 20.39 N, -3.165 N."""
    folder = os.environ.get("BACKSIGHT_DATA")
    if not folder or not (Path(folder) / "emps" / "emps_estimation.csv").is_file():
        pytest.skip("needs emps/emps_estimation.csv in the folder that BACKSIGHT_DATA names")
    import pandas as pd

    table = pd.read_csv(Path(folder) / "emps" / "emps_estimation.csv", nrows=8000)
    force = next(c for c in table.columns if "F" in c.upper().split("_") or "FORCE" in c.upper())
    time, position = table.columns[0], next(c for c in table.columns if c.lower().startswith("q"))
    recording = Recording(
        name="emps",
        time=table[time],
        inputs={"F": table[force]},
        outputs={"x": table[position]},
        output_std={"x": 2e-6},
    )
    free = {"carriage.m": Free(80.0), "friction.d": Free(150.0), "friction.f_c": Free(15.0), "offset.f": Free(0.0)}
    s = smooth(Problem(model=actuator(), recordings=[recording], parameters=free))
    assert s.solver.converged
    assert s.parameters["carriage.m"].value == pytest.approx(95.1, rel=0.03)


def test_a_smoothing_that_may_take_no_time_says_so():
    with pytest.raises(OutOfTime, match="limit of time"):
        fit([operate(3)], settings=Settings(seconds=0.0))


def test_a_limit_of_time_is_kept_in_the_midst_of_a_solve(monkeypatch):
    """Lines of progress come between solves alone: here the clock runs out at the third evaluation of Ipopt."""
    late = iter([False, False, True])
    monkeypatch.setattr(Until, "__call__", lambda self, line: self.say(line))
    monkeypatch.setattr(Until, "check", lambda _: raised() if next(late) else None)

    def raised() -> None:
        raise OutOfTime("Stopped at its limit of time.")

    with pytest.raises(OutOfTime, match="limit of time"):
        fit([operate(3)], settings=Settings(seconds=1e3))
    assert next(late, None) is None


def test_without_weighing_forces_keep_the_share_of_the_start_and_with_it_they_are_as_the_data_say():
    made = operate(3, n=600)
    held = fit([made], W=None, settings=Settings(check_mesh=False, weigh=False))
    weighed = fit([made], W=None, settings=Settings(check_mesh=False))
    assert held.solver.converged
    assert weighed.weights.W["mass"] == pytest.approx(FORCE_STD, rel=0.5)
    force = np.sqrt(np.mean(made.recording.inputs["F"] ** 2))
    # some percent of forces of the size of the input, over intervals of one to five samples
    assert 0.003 * force < held.weights.W["mass"] / np.sqrt(0.03) < 0.1 * force
    assert held.weights.W["mass"] != pytest.approx(weighed.weights.W["mass"], rel=0.2)


def test_settings_leave_out_no_check_of_what_was_recorded():
    still = Recording(name="stuck", time=0.01 * np.arange(50.0), inputs={"F": np.ones(50)}, outputs={"x": np.full(50, 0.25)})
    with pytest.raises(InputError, match="in all its samples"):
        smooth(Problem(model=compiled(oscillator()), recordings=[still], parameters={"mass.m": Free(1.0)}), settings=Settings())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"method": "radau"}, "method='radau'"),
        ({"degree": 1}, "degree=1.*whole number from 2 to 5"),
        ({"degree": 2.5, "method": "collocation"}, "degree=2.5.*from 1 to 5"),
        ({"step": 0.0}, "step=0.0.*more than 0"),
        ({"seconds": "10"}, "seconds = '10' is a str"),
        ({"check_mesh": 3}, "check_mesh=3.*True or False"),
    ],
)
def test_settings_that_are_none_are_refused(given, said):
    with pytest.raises(InputError, match=said):
        Settings(**given)
