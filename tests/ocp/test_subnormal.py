"""Numbers that are too small to be normal are nothing where that is asked for, and there alone."""

from __future__ import annotations

import platform
import sys

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from backsight.ocp.subnormal import flushed

pytestmark = pytest.mark.skipif(sys.platform != "linux" or platform.machine() != "x86_64", reason="nothing is done there")

SMALL = np.full(4, 1e-310)


def test_they_are_nothing_inside_and_as_ever_outside() -> None:
    with flushed():
        assert not np.any(SMALL * 1.0)
        assert not np.any(np.full(4, 1e-200) * 1e-110)
        assert np.all(np.full(4, 1e-200) * 1e-100 > 0)
        with flushed():
            assert not np.any(SMALL * 1.0)
        assert not np.any(SMALL * 1.0)
    assert np.all(SMALL * 1.0 > 0)


def test_it_ends_with_an_error() -> None:
    with pytest.raises(ZeroDivisionError), flushed():
        raise ZeroDivisionError
    assert np.all(SMALL * 1.0 > 0)


def test_a_factor_whose_entries_shrink_along_time_solves_the_same() -> None:
    """x_(k+1) = x_k / 2, from a start that is forgotten after a thousand steps."""
    n = 200_000
    A = splu(sp.csc_matrix(sp.eye(n) - sp.diags([np.full(n - 1, 0.5)], [-1])), permc_spec="NATURAL")
    start = np.zeros((n, 16))
    start[0] = np.arange(1.0, 17.0)
    start[1020::1000] = 1e-305  # what falls below them again and again
    plain = A.solve(start)
    with flushed():
        small = A.solve(start)
    least = np.finfo(float).tiny
    assert np.any((plain != 0) & (np.abs(plain) < least))
    assert not np.any((small != 0) & (np.abs(small) < least))
    np.testing.assert_allclose(small, plain, rtol=0.0, atol=1e-307)
