"""Figures of merit of a fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from backsight.estimation.fit import ljung_box, output_fit


def test_rms_and_percent_by_hand():
    fit = output_fit(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0, 6.0]))
    assert fit.rms == pytest.approx(1.0)
    assert fit.fit_percent == pytest.approx(100 * (1 - 2 / np.sqrt(5)))
    assert fit.whiteness_p is None


def test_missing_samples_are_left_out():
    whole = output_fit(np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.5, 4.0]))
    holed = output_fit(np.array([1.0, np.nan, 2.0, 4.0]), np.array([1.0, 77.0, 2.5, 4.0]))
    assert whole == holed


def test_a_constant_or_empty_measurement_has_no_percent():
    assert output_fit(np.full(5, 2.0), np.full(5, 2.1)).fit_percent is None
    empty = output_fit(np.full(5, np.nan), np.zeros(5))
    assert np.isnan(empty.rms)
    assert (empty.fit_percent, empty.whiteness_p) == (None, None)


def test_a_perfect_fit_is_a_hundred_percent():
    y = np.sin(np.arange(100.0))
    assert (output_fit(y, y).rms, output_fit(y, y).fit_percent) == (0.0, 100.0)


def test_p_values_of_white_noise_are_uniform():
    p = [ljung_box(np.random.default_rng(s).normal(size=400)) for s in range(300)]
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_a_coloured_residual_is_not_called_white():
    rng = np.random.default_rng(0)
    e = np.zeros(500)
    for k in range(1, 500):
        e[k] = 0.4 * e[k - 1] + rng.normal()
    assert ljung_box(e) < 1e-6


def test_the_statistic_is_that_of_the_formula_for_an_alternating_signal():
    n = 60
    e = np.tile([1.0, -1.0], n // 2)
    r = np.array([(-1.0) ** k * (n - k) / n for k in range(1, 21)])
    q = n * (n + 2) * np.sum(r**2 / (n - np.arange(1, 21)))
    assert ljung_box(e) == pytest.approx(stats.chi2.sf(q, 20), rel=1e-9)


@pytest.mark.parametrize("e", [np.ones(49), np.zeros(100), np.full(100, 3.0), np.empty(0)])
def test_too_few_values_or_none_that_differ_give_no_p_value(e):
    assert ljung_box(e) is None
