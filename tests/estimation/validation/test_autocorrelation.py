"""Autocorrelation of series with gaps."""

import numpy as np
import pytest

from backsight.estimation.validation.autocorrelation import autocorrelation


def test_the_autocorrelation_is_the_sum_of_the_textbook() -> None:
    e = np.random.default_rng(0).standard_normal(300)
    e[[5, 77, 78, 250]] = np.nan
    seen = e - np.nanmean(e)
    direct = [np.nanmean(seen[: seen.size - k] * seen[k:]) for k in range(21)]
    assert autocorrelation(e, 20) == pytest.approx(np.array(direct) / direct[0], abs=1e-12)


def test_a_constant_or_empty_series_has_no_autocorrelation() -> None:
    assert np.isnan(autocorrelation(np.ones(50), 3)).all()
    assert np.isnan(autocorrelation(np.full(50, np.nan), 3)).all()
