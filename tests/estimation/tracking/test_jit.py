"""Estimates with and without a C compiler."""

from __future__ import annotations

import numpy as np
import pytest
from friction_axis import FrictionAxis

from backsight.estimation.tracking import Estimator


@pytest.fixture(scope="module")
def axis():
    return FrictionAxis(count=200)


def test_with_and_without_a_compiler_the_estimates_are_the_same_and_it_is_said_that_there_is_none(axis, monkeypatch, tmp_path):
    said = []
    fast = Estimator(axis.problem, samples=20, progress=said.append)
    slow = Estimator(axis.problem, samples=20, tuning=fast.tuning, jit=False, progress=said.append)
    assert said.count("compiling the stages") == 1
    assert slow.notes == ()
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    none = Estimator(axis.problem, samples=20, tuning=fast.tuning)
    assert none.notes == (
        "The stages are evaluated without C code, more slowly: there is no C compiler (cc, gcc or clang, or as CC names it).",
    )
    for k in range(200):
        first, second, third = (one.update(axis.sample(k)) for one in (fast, slow, none))
        np.testing.assert_allclose(first.row(), second.row(), rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(second.row(), third.row())
        assert first.iterations == second.iterations
