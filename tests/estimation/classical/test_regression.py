"""Least squares and its deviations, against many repetitions and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from backsight.estimation.classical.regression import long_run, solve

NOTHING = np.zeros(2)


def columns(n: int, rng: np.random.Generator) -> np.ndarray:
    """A slow column and a constant, as filtered velocities and offsets are."""
    return np.column_stack([lfilter([0.1], [1, -0.9], rng.normal(size=n)), np.ones(n)])[:, None, :]


def test_deviations_hold_where_residuals_are_correlated_over_time():
    """300 repetitions, AR(1) residuals of 0.9: scatter over the stated deviation within 0.8 .. 1.25."""
    rng, estimates, stated, naive = np.random.default_rng(1), [], [], []
    for _ in range(300):
        X = columns(1500, rng)
        e = lfilter([1.0], [1, -0.9], rng.normal(size=1500))
        found = solve([X], [(X @ [2.0, -1.0]) + e[:, None]], NOTHING, NOTHING)
        estimates.append(found.theta)
        stated.append(found.std)
        naive.append(np.std(e) * np.sqrt(np.diag(np.linalg.inv(X[:, 0].T @ X[:, 0]))))
    ratio = np.std(estimates, axis=0) / np.mean(stated, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.25))
    assert np.all(np.std(estimates, axis=0) / np.mean(naive, axis=0) > 2)
    assert np.abs(np.mean(estimates, axis=0) - [2.0, -1.0]) == pytest.approx(np.zeros(2), abs=4 * np.max(np.std(estimates, axis=0)) / 17)


def test_white_scores_have_the_covariance_of_the_textbook():
    g = np.random.default_rng(2).normal(size=(20_000, 2)) * [1.0, 3.0]
    assert long_run(g) / 20_000 == pytest.approx(np.diag([1.0, 9.0]), abs=0.45)


def test_a_prior_counts_as_one_more_row():
    rng = np.random.default_rng(3)
    X, m, info = columns(50, rng), np.array([5.0, 1.0]), np.array([4.0, 0.0])
    d = X @ [2.0, -1.0] + rng.normal(size=(50, 1))
    rows, right = np.vstack([X[:, 0], [[2.0, 0.0]]]), np.concatenate([d[:, 0], [10.0]])
    assert solve([X], [d], m, info).theta == pytest.approx(np.linalg.lstsq(rows, right, rcond=None)[0], rel=1e-10)


def test_combinations_without_information_are_marked():
    X = np.ones((30, 1, 3)) * [1.0, 1.0, 0.0]
    X[:, 0, 2] = np.arange(30)
    found = solve([X], [np.arange(30.0)[:, None]], np.zeros(3), np.zeros(3))
    assert list(found.determined) == [False, False, True]
    assert found.theta[2] == pytest.approx(1.0)
