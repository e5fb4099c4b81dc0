"""What a weight from the data says of itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from backsight.estimation.weighing.components import Component


@pytest.mark.parametrize("n", [200, 5000])
@pytest.mark.parametrize("left", [1e-3, 1e-6])
def test_where_there_may_be_none_the_interval_ends_where_the_likelihood_has_fallen(n, left):
    """White readings of variance r^2 = 4, just as large as their noise: of a variance s^2 beside it, by its own likelihood

    2 (l(0) - l(s^2)) = n (log(1 + s^2/r^2) + 1/(1 + s^2/r^2) - 1) = 1.645^2,

    whatever small s the search has stopped at; the information on log s is 2 n (s^2 / (r^2 + s^2))^2.
    """
    r2, s2 = 4.0, 4.0 * left
    log_std = (r2 + s2) / (s2 * np.sqrt(2 * n))
    low, high = Component(std=float(np.sqrt(s2)), log_std=float(log_std), unit="N", p_zero=1.0).interval
    limit = brentq(lambda u: n * (np.log1p(u) + 1 / (1 + u) - 1) - 1.644854**2, 1e-6, 10.0)
    assert low == 0.0
    assert high**2 / r2 == pytest.approx(limit, rel=3.5 / np.sqrt(n))
