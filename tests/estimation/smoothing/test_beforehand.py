"""Priors and starts that the data contradict are named; those that they do not are not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from linear_runs import ALL_FREE, OFFSET, STD, K, M, many, problem

from backsight.estimation import Free
from backsight.estimation.problem import Known

MISLEADS = "that contradicts the data, or the model lacks something. Values and deviations mislead."


def record(seed: int, n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return many(n, 1, rng)[0] + STD * rng.normal(size=n)


def said(result) -> list[str]:
    return [note for note in result.notes if note.endswith(MISLEADS)]


def test_a_prior_far_from_what_the_data_say_is_named_with_its_distance():
    y = record(1)
    free = problem(y)[0].parameters["spring.k"]
    result, _ = problem(y, parameters=ALL_FREE | {"spring.k": Free(2 * K, std=0.05 * K)})
    (note,) = said(result)
    assert note.startswith("spring.k = 100 ± 2.5 N/m was known beforehand, and the estimate ")
    # of a linear estimate: N(m, s^2) and N(p0, sigma0^2) are N(0, s^2 + sigma0^2) apart
    assert free.std is not None
    expected = (2 * K - free.value) / np.hypot(0.05 * K, free.std)
    assert float(re.search(r"is ([\d.]+) times", note)[1]) == pytest.approx(expected, rel=0.15)


def test_a_start_that_is_held_is_compared_with_where_the_data_put_it():
    y = record(2)
    free = problem(y)[1]
    at, std = (getattr(free.sampled(0), name)[0, 0] for name in ("states", "states_std"))
    result, _ = problem(y, initial={"mass.s": 0.02})
    (note,) = said(result)
    found = re.fullmatch(
        rf"mass\.s = 0\.02 m was given for the start, and without that it would be (\S+) ± (\S+): {re.escape(MISLEADS)}", note
    )
    assert found is not None
    # by one step from where the parameters have bent to the wrong start
    assert float(found[1]) == pytest.approx(at, abs=3 * std)
    assert float(found[2]) == pytest.approx(std, rel=0.2)


def test_an_uncertain_start_far_off_is_named():
    (note,) = said(problem(record(3), initial={"mass.s": Known(0.02, std=1e-3)})[0])
    assert note.startswith("mass.s = 0.02 ± 0.001 m was known of the start, and the estimate ")


@pytest.mark.parametrize("seed", range(8))
def test_what_is_right_is_not_contradicted(seed):
    rng = np.random.default_rng([seed, 5])
    priors = {"mass.m": Free(M + 0.1 * rng.normal(), std=0.1), "offset.f": Free(OFFSET + 0.5 * rng.normal(), std=0.5)}
    start = {"mass.s": 0.0, "mass.v": Known(0.01 * rng.normal(), std=0.01)}
    assert said(problem(record(seed), parameters=ALL_FREE | priors, initial=start)[0]) == []
