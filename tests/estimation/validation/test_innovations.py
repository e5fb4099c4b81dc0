"""Prediction errors against those of a dense Gaussian, and their distribution over many records."""

from __future__ import annotations

import numpy as np
import pytest
from linear_runs import ALL_FREE, PLANT, STEP, again, dense, many, problem
from scipy import stats
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

from backsight.estimation import Free
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.validation.innovations import innovations
from backsight.estimation.validation.whiteness import normality, whiteness

FIXED = dict.fromkeys(ALL_FREE, 0.0) | {"mass.m": PLANT.m, "spring.k": PLANT.k, "damper.d": PLANT.d, "offset.f": PLANT.offset}


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_they_are_the_whitened_samples_where_start_and_parameters_are_known(method):
    y = many(80, 1, np.random.default_rng(0))[0] + 1e-3 * np.random.default_rng(1).normal(size=80)
    fine = Settings(method=method, step=STEP, degree=3)
    _, solution = problem(y, settings=fine, parameters=FIXED, initial={"mass.s": 0.0, "mass.v": 0.0})
    mean, C, _ = dense(80)
    root = np.linalg.cholesky(C)
    whitened = solve_triangular(root, y - mean, lower=True)
    run = innovations(solution).horizons[0]
    assert run.errors[:, 0] == pytest.approx(whitened, abs=2e-3)
    # given those before, the k-th is normal with deviation L_kk
    of_rows = stats.norm.logpdf(y, y - np.diag(root) * whitened, np.diag(root))
    assert run.log_densities[:, 0] == pytest.approx(of_rows, abs=2e-3)


def test_what_is_unknown_of_start_and_offset_is_known_from_the_samples_before_only():
    y = many(80, 1, np.random.default_rng(2))[0] + 1e-3 * np.random.default_rng(3).normal(size=80)
    _, solution = problem(y, settings=Settings(step=STEP, degree=3), parameters={**FIXED, "offset.f": Free(0.0)})
    mean, C, effect = dense(80)
    run = innovations(solution).horizons[0]
    errors = run.errors[:, 0]
    told = np.isnan(errors)
    assert 3 <= np.sum(told) <= 8
    for k in np.flatnonzero(~told):
        # one step ahead by generalised least squares on all before
        L = np.linalg.cholesky(C[: k + 1, : k + 1])
        rows, seen = solve_triangular(L, effect[: k + 1], lower=True), solve_triangular(L, (y - mean)[: k + 1], lower=True)
        beta = np.linalg.lstsq(rows[:k], seen[:k], rcond=None)[0]
        spread = 1 + rows[k] @ np.linalg.inv(rows[:k].T @ rows[:k]) @ rows[k]
        assert errors[k] == pytest.approx((seen[k] - rows[k] @ beta) / np.sqrt(spread), abs=5e-3)
    # densities are those with all of it as it was estimated from the whole record
    L = np.linalg.cholesky(C)
    rows, seen = solve_triangular(L, effect, lower=True), solve_triangular(L, y - mean, lower=True)
    left = seen - rows @ np.linalg.lstsq(rows, seen, rcond=None)[0]
    assert run.log_densities[:, 0] == pytest.approx(stats.norm.logpdf(left) - np.log(np.diag(L)), abs=2e-2)


def test_missing_samples_and_their_squares_add_up_to_twice_the_cost():
    y = many(200, 1, np.random.default_rng(4))[0] + 1e-3 * np.random.default_rng(5).normal(size=200)
    y[40:70] = np.nan
    y[::7] = np.nan
    # with the mass among the unknowns the cost is taken with the density of its reference, which may be two percent off
    _, solution = problem(y, parameters={**ALL_FREE, "mass.m": PLANT.m})
    run = innovations(solution).horizons[0]
    assert len(run.u) == np.isfinite(y).sum()
    left = run.u - run.E @ np.linalg.lstsq(run.E, run.u, rcond=None)[0]
    assert left @ left == pytest.approx(2 * solution.solved.cost, rel=1e-6)
    assert not np.any(np.isfinite(run.errors[np.isnan(y)]))


def test_a_bound_that_is_active_takes_its_parameter_out():
    y = many(150, 1, np.random.default_rng(6))[0] + 1e-3 * np.random.default_rng(7).normal(size=150)
    _, solution = problem(y, parameters={**ALL_FREE, "offset.f": Free(5.0, min=4.0)})
    run = innovations(solution).horizons[0]
    assert run.E.shape[1] == 2 + 3


def p_values(count: int, force: np.ndarray | None = None, noise: np.ndarray | None = None, n: int = 300) -> np.ndarray:
    """(whiteness, normality, variance) of many records of the model itself, all parameters estimated in each."""
    rng = np.random.default_rng(8)
    records = many(n, count, rng, force) + (1e-3 * rng.normal(size=(count, n)) if noise is None else noise)
    first, found = problem(records[0])[1], []
    for y in records:
        e = innovations(again(first, y)).horizons[0].errors[:, 0]
        found.append([whiteness(e), normality(e), np.nanvar(e)])
    return np.array(found)


@pytest.mark.slow
def test_records_of_the_model_itself_are_rejected_as_often_as_the_level_says():
    """200 records, bounds of four binomial deviations; uniform by Kolmogorov and Smirnov at 1e-3; variance one within 1 %."""
    p = p_values(200)
    for k in (0, 1):
        assert abs(np.mean(p[:, k] < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 200)
        assert stats.kstest(p[:, k], "uniform").pvalue > 1e-3
    assert p[:, 2].mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 300 / 200))


def test_a_coloured_noise_is_rejected():
    rng = np.random.default_rng(9)
    noise = 1e-3 * np.sqrt(1 - 0.8**2) * lfilter([1], [1, -0.8], rng.normal(size=(10, 800)))[:, 500:]
    assert np.all(p_values(10, noise=noise)[:, 0] < 1e-3)


def test_a_coulomb_friction_that_the_model_lacks_is_rejected():
    """Held against the velocity of the plant without it, which is where it would act; 3 N beside a drive of 22 N rms."""
    velocity = np.gradient(many(300, 1, np.random.default_rng(10))[0], STEP)
    assert np.all(p_values(5, force=np.tile(-3.0 * np.sign(velocity), (5, 1)))[:, 0] < 1e-3)
