"""Whiteness, normality and effective samples of series whose truth is known.

Of many series from a fixed seed: the share rejected at 5 % lies within four binomial deviations of it (plus what the chi-square leaves
in short series), and the p-values are uniform by Kolmogorov and Smirnov at 1e-3.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from backsight.estimation.validation.whiteness import bands, effective_samples, normality, whiteness


def first_order(rng: np.random.Generator, a: float, n: int) -> np.ndarray:
    """Stationary, of variance one."""
    return lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=n + 2000))[2000:]


@pytest.mark.parametrize("n", [100, 1000])
def test_white_noise_is_rejected_as_often_as_the_level_says(n):
    rng = np.random.default_rng(0)
    p = np.array([whiteness(rng.normal(size=n)) for _ in range(1000)])
    assert abs(np.mean(p < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 1000)
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_gaps_change_nothing_of_that():
    rng = np.random.default_rng(1)
    e = rng.normal(size=(1000, 400))
    e[:, 100:180] = np.nan
    e[rng.uniform(size=e.shape) < 0.2] = np.nan
    p = np.array([whiteness(row) for row in e])
    assert abs(np.mean(p < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 1000)
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_a_coloured_series_is_not_called_white():
    assert whiteness(first_order(np.random.default_rng(0), 0.4, 500)) < 1e-6


def test_a_slow_memory_far_below_the_noise_is_seen():
    """A 1.5 % share of the power over a hundred samples: each of the first lags has r = 0.015, and twenty of them alone say little."""
    rng = np.random.default_rng(2)
    p = [whiteness(rng.normal(size=10_000) + 0.12 * first_order(rng, 0.99, 10_000)) for _ in range(20)]
    assert np.mean(np.array(p) < 0.01) > 0.9


def test_an_offset_is_structure():
    rng = np.random.default_rng(3)
    assert whiteness(rng.normal(size=1000) + 0.3) < 1e-6


def test_single_lags_give_the_statistic_of_ljung_and_box():
    """Up to eight lags no band gathers two; without the mean, n (n + 2) sum r_k^2 / (n - k)."""
    e = np.random.default_rng(4).normal(size=51)
    edges = bands(10)
    r = np.array([e[:-k] @ e[k:] for k in range(1, 11)]) / (e @ e)
    q, n = 0.0, 51
    for first, beyond in pairwise(edges.tolist()):
        lags = np.arange(first, beyond)
        q += n * (n + 2) * r[lags - 1].sum() ** 2 / np.sum(n - lags)
    assert edges.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 11]
    assert whiteness(e) == pytest.approx(stats.chi2.sf(q, 8), rel=1e-9)
    assert whiteness(e, 1) == pytest.approx(stats.chi2.sf(q, 7), rel=1e-9)


@pytest.mark.parametrize("e", [np.ones(49), np.zeros(100), np.full(100, np.nan), np.empty(0)])
def test_too_few_values_or_none_but_zeros_give_no_p_value(e):
    assert whiteness(e) is None
    assert normality(e) is None


@pytest.mark.parametrize("a", [0.0, 0.5, 0.9])
def test_effective_samples_of_a_first_order_series_are_those_of_theory(a):
    """n (1 - a)/(1 + a) (Priestley, Spectral Analysis and Time Series, section 5.3)."""
    rng, n = np.random.default_rng(5), 20_000
    found = [effective_samples(first_order(rng, a, n)) for _ in range(10)]
    assert np.mean(found) == pytest.approx(n * (1 - a) / (1 + a), rel=0.1)
    assert max(found) <= n


@pytest.mark.parametrize("every", [2, 10])
def test_a_sensor_slower_than_the_rows_is_worth_as_much_as_without_the_empty_ones(every):
    e = first_order(np.random.default_rng(8), 0.9, 2000)
    rows = np.full(every * len(e), np.nan)
    rows[::every] = e
    assert effective_samples(rows) == pytest.approx(effective_samples(e))
    assert whiteness(rows) == pytest.approx(whiteness(e))
    noise = np.random.default_rng(9).standard_normal((400, 200))
    p = []
    for own in noise:
        rows = np.full(every * len(own), np.nan)
        rows[::every] = own
        p.append(whiteness(rows))
    assert abs(np.mean(np.array(p) < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / len(noise))


@pytest.mark.parametrize("a", [0.0, 0.8])
def test_normal_series_are_rejected_as_often_as_the_level_says_coloured_or_not(a):
    rng = np.random.default_rng(6)
    p = np.array([normality(first_order(rng, a, 1000)) for _ in range(600)])
    assert abs(np.mean(p < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 600)


def test_heavy_tails_and_skewness_are_not_normal():
    rng = np.random.default_rng(7)
    assert normality(rng.laplace(size=1000)) < 1e-6
    assert normality(rng.exponential(size=300)) < 1e-6
