"""Residual forces against what the smoother makes of white ones."""

from __future__ import annotations

import numpy as np
import pytest
from linear_runs import ALL_FREE, FORCE_STD, PLANT, STD, STEP, again, many, problem
from scipy import stats
from scipy.signal import lfilter

from backsight.estimation.smoothing.program import Settings
from backsight.estimation.validation.forces import force_whiteness, smoothed_noises
from backsight.estimation.validation.innovations import innovations

FREE = {**ALL_FREE, "mass.m": PLANT.m}  # a free mass is measured with the density of a reference, two percent off at most


def record(seed: int, n: int = 400, force: np.ndarray | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return many(n, 1, rng, None if force is None else force[None])[0] + STD * rng.normal(size=n)


@pytest.mark.parametrize("method", ["spline", "collocation"])
def test_the_map_from_prediction_errors_to_smoothed_noises_is_that_of_the_solver(method):
    _, solution = problem(record(0), settings=Settings(method=method), parameters=FREE)
    run = innovations(solution).horizons[0]
    left = run.u - run.E @ np.linalg.lstsq(run.E, run.u, rcond=None)[0]
    rows = solution.rows[solution.term(solution.transcription.force_term)]
    assert pytest.approx(rows, abs=1e-3 * np.abs(rows).max()) == smoothed_noises(run, left[:, None])[:, :, 0].T


@pytest.mark.slow
def test_white_forces_are_rejected_as_often_as_the_level_says():
    """100 records; four binomial deviations, and uniform by Kolmogorov and Smirnov at 1e-3."""
    first, p = problem(record(0), parameters=FREE)[1], []
    for seed in range(100):
        solution = again(first, record(seed))
        p += force_whiteness(solution, innovations(solution)).values()
    assert len(p) == 100
    assert abs(np.mean(np.array(p) < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 100)
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_a_force_with_a_memory_is_rejected():
    """Of 0.2 s and five times the white one's size over that time."""
    a, rms = np.exp(-STEP / 0.2), 5 * FORCE_STD / np.sqrt(0.2)
    for seed in range(3):
        slow = rms * np.sqrt(1 - a * a) * lfilter([1], [1, -a], np.random.default_rng(seed).normal(size=900))[500:]
        _, solution = problem(record(seed, force=slow), parameters=FREE)
        assert force_whiteness(solution, innovations(solution))[0] < 1e-3


@pytest.mark.parametrize("count", [4, 20])
def test_a_memory_is_seen_however_many_recordings_there_are(count):
    """Forces with one in each of them; their sums of all recordings are those of random ones where the forces are white."""
    a, rms = np.exp(-STEP / 0.2), 5 * FORCE_STD / np.sqrt(0.2)
    p = {}
    for size in (0.0, rms):
        runs = []
        for seed in range(count):
            slow = size * np.sqrt(1 - a * a) * lfilter([1], [1, -a], np.random.default_rng(seed).normal(size=900))[500:]
            runs.append(record(seed, force=slow if size else None))
        _, solution = problem(*runs, parameters=FREE)
        p[size] = force_whiteness(solution, innovations(solution))[0]
    assert p[rms] < 1e-6
    assert p[0.0] > 1e-3
