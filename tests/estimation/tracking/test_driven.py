"""Inputs between samples as a straight line with the same mean and first moment."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from backsight.estimation.tracking.driven import Driven


def held(times: list[float], values: list[float], t: float) -> float:
    return values[int(np.searchsorted(times, t, side="right")) - 1]


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_the_line_has_the_mean_and_the_first_moment_of_what_the_input_did(hold):
    times, values, rng = [0.0, 0.11, 0.35, 0.6, 1.0], [1.0, -2.0, 0.5, 3.0, 9.0], np.random.default_rng(0)
    driven = Driven(1, hold)
    for t, u in zip(times, values, strict=True):
        driven.put(t, np.array([u]))
    for _ in range(5):
        a, b = np.sort(rng.uniform(0, 1, 2))
        u = (lambda t: held(times, values, t)) if hold == "zero" else (lambda t: float(np.interp(t, times, values)))
        inside = [t for t in times if a < t < b]
        mean = quad(u, a, b, points=inside or None, epsabs=1e-12)[0] / (b - a)
        slope = quad(lambda t, u=u, a=a, b=b: u(t) * (2 * (t - a) / (b - a) - 1), a, b, points=inside or None, epsabs=1e-12)[0]
        first = slope / (b - a)
        start, end = driven.over(a, b)
        assert (start + end) / 2 == pytest.approx(mean, abs=1e-9)
        assert (end - start) / 2 / 3 == pytest.approx(first, abs=1e-9)  # int of c f^2 over the interval is c / 3


def test_a_missing_input_stays_what_it_was_and_what_is_forgotten_is_not_needed():
    driven = Driven(2, "zero")
    driven.put(0.0, np.array([1.0, 2.0]))
    driven.put(1.0, np.array([np.nan, 5.0]))
    np.testing.assert_allclose(driven.over(1.0, 2.0), [1, 5, 1, 5])
    driven.put(2.0, np.array([3.0, np.nan]))
    driven.forget(2.0)
    assert driven.times == [2.0]
    np.testing.assert_allclose(driven.over(2.0, 2.5), [3, 5, 3, 5])
