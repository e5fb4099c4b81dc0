"""Tests that are judged together."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from backsight.estimation.validation.together import largest_rejected


def closed(p: np.ndarray, level: float) -> np.ndarray:
    """Which hypotheses are rejected with every set of them that holds them, a set by Bonferroni's inequality (Marcus et al. 1976)."""
    numbers = range(len(p))
    sets = [s for size in range(1, len(p) + 1) for s in combinations(numbers, size)]
    return np.array([all(min(p[list(s)]) <= level / len(s) for s in sets if i in s) for i in numbers])


@pytest.mark.parametrize("seed", range(30))
def test_what_is_rejected_is_what_the_closure_of_bonferronis_tests_rejects(seed):
    rng = np.random.default_rng(seed)
    p = rng.uniform(size=7) ** 3
    p[rng.integers(7)] = p[rng.integers(7)]
    assert np.array_equal(p <= largest_rejected(p, 0.1), closed(p, 0.1))


def test_of_runs_in_which_all_is_right_one_in_a_hundred_is_doubted_however_many_tests_it_has():
    rng = np.random.default_rng(0)
    for m in (1, 12):
        doubted = np.mean([largest_rejected(p, 0.01) >= 0 for p in rng.uniform(size=(20_000, m))])
        assert doubted == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / 20_000))


def test_nothing_is_rejected_where_nothing_is_tested_or_a_test_has_no_value():
    assert largest_rejected([], 0.01) < 0
    assert largest_rejected([float("nan")], 0.01) < 0
    assert largest_rejected([0.0, 0.5], 0.01) == 0.0
