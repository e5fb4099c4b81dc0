"""Figures of merit of a fit."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.results import Trimmed
from backsight.estimation.validation.fit import output_fit


def test_rms_and_percent_by_hand():
    fit = output_fit(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0, 6.0]))
    assert fit.rms == pytest.approx(1.0)
    assert fit.fit_percent == pytest.approx(100 * (1 - 2 / np.sqrt(5)))
    assert (fit.whiteness_p, fit.normality_p, fit.effective_samples, fit.prediction_rms) == (None, None, None, None)
    assert fit.samples == 4


def test_missing_samples_are_left_out():
    whole = output_fit(np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.5, 4.0]))
    holed = output_fit(np.array([1.0, np.nan, 2.0, 4.0]), np.array([1.0, 77.0, 2.5, 4.0]))
    assert whole == holed


def test_what_a_loss_found_far_off_is_counted_and_left_out_beside_the_fit_of_all():
    y, smoothed = np.array([1.0, 2.0, 90.0, 3.0, np.nan, 4.0]), np.array([1.0, 2.0, 3.0, 3.0, 3.0, 6.0])
    fit = output_fit(y, smoothed, far=np.array([False, False, True, False, True, False]))
    assert fit.rms == pytest.approx(np.sqrt((87.0**2 + 2.0**2) / 5))
    assert fit.ordinary == Trimmed(rms=pytest.approx(1.0), fit_percent=pytest.approx(100 * (1 - 2 / np.sqrt(5))), outliers=1)
    none = output_fit(y, smoothed, far=np.zeros(6, dtype=bool))
    assert (none.trimmed, none.ordinary) == (None, none)


def test_a_constant_or_empty_measurement_has_no_percent():
    assert output_fit(np.full(5, 2.0), np.full(5, 2.1)).fit_percent is None
    empty = output_fit(np.full(5, np.nan), np.zeros(5))
    assert np.isnan(empty.rms)
    assert (empty.fit_percent, empty.whiteness_p, empty.samples) == (None, None, 0)


def test_a_perfect_fit_is_a_hundred_percent():
    y = np.sin(np.arange(100.0))
    assert (output_fit(y, y).rms, output_fit(y, y).fit_percent) == (0.0, 100.0)


def test_prediction_errors_are_tested_in_place_of_the_differences_where_there_are_some():
    rng = np.random.default_rng(0)
    y, errors = np.cumsum(rng.normal(size=500)), 2.0 * rng.normal(size=500)
    errors[:5] = np.nan
    walk, smoothed = output_fit(y, np.zeros(500)), output_fit(y, np.zeros(500), errors)
    assert walk.whiteness_p is not None
    assert walk.whiteness_p < 1e-9
    assert smoothed.whiteness_p is not None
    assert smoothed.whiteness_p > 1e-3
    assert smoothed.prediction_rms == pytest.approx(2.0, rel=0.1)
    assert smoothed.rms == walk.rms
