"""Autocorrelation of series with gaps."""

import numpy as np
import pytest
from scipy.signal import lfilter

from backsight.estimation.validation.autocorrelation import autocorrelation, memory


def test_the_autocorrelation_is_the_sum_of_the_textbook() -> None:
    e = np.random.default_rng(0).standard_normal(300)
    e[[5, 77, 78, 250]] = np.nan
    seen = e - np.nanmean(e)
    direct = [np.nanmean(seen[: seen.size - k] * seen[k:]) for k in range(21)]
    assert autocorrelation(e, 20) == pytest.approx(np.array(direct) / direct[0], abs=1e-12)


def test_a_constant_or_empty_series_has_no_autocorrelation() -> None:
    assert np.isnan(autocorrelation(np.ones(50), 3)).all()
    assert np.isnan(autocorrelation(np.full(50, np.nan), 3)).all()


@pytest.mark.parametrize(("step", "tau"), [(0.01, 0.1), (0.002, 0.1), (0.5, 10.0)])
def test_the_memory_is_that_of_a_filtered_noise_whatever_the_sampling_and_the_noise_upon_it(step, tau) -> None:
    """A first-order filter of rms 3, 20 000 correlation times long; differences of white noise as large have no spectrum at zero: 5 %."""
    rng, n = np.random.default_rng(3), int(20_000 * tau / step)
    a = np.exp(-step / tau)
    e = 3 * np.sqrt(1 - a * a) * lfilter([1], [1, -a], rng.standard_normal(n))
    for values in (e, e + np.diff(3 * rng.standard_normal(n + 1))):
        found = memory(step * np.arange(n), values)
        assert (found.tau, found.rms) == pytest.approx((tau, 3.0), rel=0.05)


def test_what_does_not_differ_or_is_white_remembers_nothing() -> None:
    assert memory(np.arange(50.0), np.ones(50)) is None
    assert memory(np.arange(1000.0), np.random.default_rng(0).standard_normal(1000)) is None
