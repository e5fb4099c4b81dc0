"""A residual force is held against the acceleration that it did not make itself."""

from __future__ import annotations

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.validation.rates import undriven_rates

PLANT, MODEL, STD, W = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator()), 1e-4, 0.3
RIGHT = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}


def smoothed(seed: int, *, force: float = W, begin: float = 0.0, **weights) -> tuple[Problem, Smoothing]:
    rng, n = np.random.default_rng(seed), 600
    time, u = 0.01 * np.arange(n), np.repeat(5 * rng.choice([-1.0, 1.0], size=61), 10)[:n]
    x = truths.disturbed(PLANT, time, u, np.zeros(2), force, rng)[:, 0]
    y = x + STD * rng.standard_normal(n)
    run = Recording(name="run", time=begin + time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    problem = Problem(
        model=MODEL, recordings=[run], parameters={**RIGHT, **weights.pop("wrong", {})}, weights=Weights(W={"mass": W}, **weights)
    )
    return problem, smooth(problem)


@pytest.mark.parametrize("colour", [{}, {"tau": {"mass": 0.2}}])
def test_the_rates_are_those_of_the_equation_of_motion_without_the_residual_force(colour):
    problem, s = smoothed(0, begin=1234.567, **colour)
    table, rates = s.estimates["run"], undriven_rates(s.solution, problem.fitted)["run"].reindex(s.estimates["run"]["t_s"])
    pull = problem.recordings[0].inputs["F"] - D * table["mass.v"] - K * table["mass.s"] - OFFSET
    inside = slice(5, -5)
    assert np.std(table["residual.mass"]) > 0.1 * np.std(pull)
    np.testing.assert_allclose(rates["mass.v"].to_numpy()[inside], pull[inside] / M, atol=2e-3 * np.std(pull) / M)


def test_a_right_model_is_not_told_that_its_inertia_is_wrong():
    """Six records: v' = (f + w)/m contains w, and its correlation with that is 0.3 and more."""
    for seed in range(6):
        assert smoothed(seed)[1].residual_places["mass"].follows is None


def test_a_wrong_inertia_is_still_named():
    for seed in range(3):
        follows = smoothed(seed, force=W / 5, wrong={"mass.m": 1.3 * M})[1].residual_places["mass"].follows
        assert follows is not None
        assert follows.what == "the rate of change of mass.v"
        assert follows.correlation > 0.7
