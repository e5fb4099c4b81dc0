"""Starts from the data alone."""

from __future__ import annotations

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.smoothing.horizons import make_horizon, output_stds
from backsight.estimation.smoothing.initial_guess import balance, start_decisions
from backsight.ocp import ParameterPrior, transcribe
from backsight.ocp.follow import Followed, follow

PLANT, MODEL = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator())
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}


def followed(free: dict, std: float = 1e-4, step: float = 0.02) -> tuple[Problem, Followed, np.ndarray]:
    rng, n = np.random.default_rng(0), 401
    time = 0.01 * np.arange(n)
    u = 20 * np.sin(3 * time) + 10 * np.sin(11 * time)
    x = truths.linearly_driven(PLANT, time, u, np.array([0.1, 0.0]))
    y = x[:, 0] + std * rng.normal(size=n)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": std}, hold="linear")
    problem = Problem(model=MODEL, recordings=[recording], parameters=free)
    stds, _ = output_stds(problem)
    return problem, follow(MODEL, [make_horizon(MODEL, recording, stds[0], {}, step)], problem.values), x


def test_the_followed_motion_is_the_true_one_within_a_few_deviations():
    _, f, x = followed({})
    _, found, _ = f.at(0, f.horizons[0].time)
    assert f.mean_square < 2.0
    assert np.sqrt(np.mean((found[0] - x[:, 0]) ** 2)) < 3e-4
    assert np.sqrt(np.mean((found[1] - x[:, 1]) ** 2)) < 0.1 * np.std(x[:, 1])


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_a_model_linear_in_its_parameters_is_balanced_from_any_guess(factor):
    problem, f, _ = followed({name: Free(factor * v) for name, v in TRUE.items()})
    found = dict(zip([p.name for p in MODEL.parameters], balance(problem, f, problem.values).parameters, strict=True))
    for name in ("mass.m", "spring.k"):
        assert found[name] == pytest.approx(TRUE[name], rel=0.1)
    for name in ("damper.d", "offset.f"):
        assert found[name] == pytest.approx(TRUE[name], abs=0.5)


def test_bounds_are_kept():
    problem, f, _ = followed({"spring.k": Free(20.0, min=10.0, max=30.0)})
    found = dict(zip([p.name for p in MODEL.parameters], balance(problem, f, problem.values).parameters, strict=True))
    assert 10.0 <= found["spring.k"] <= 30.0


def test_narrow_bounds_are_kept_too():
    problem, f, _ = followed({"spring.k": Free(20.0, min=19.999, max=20.001)})
    found = dict(zip([p.name for p in MODEL.parameters], balance(problem, f, problem.values).parameters, strict=True))
    assert 19.999 <= found["spring.k"] <= 20.001


@pytest.mark.parametrize(("method", "degree"), [("spline", 2), ("spline", 3), ("collocation", 3)])
def test_the_start_of_a_program_follows_the_samples(method, degree):
    problem, f, x = followed({"mass.m": Free(3.0)})
    prior = ParameterPrior(mean=np.ones(1), std=np.full(1, np.inf))
    t = transcribe(MODEL, f.horizons, free=problem.free, prior=prior, force_std={0: 1.0}, method=method, degree=degree)
    start = start_decisions(t, f, problem.values)
    assert start[-1] == 3.0
    knots = f.horizons[0].mesh.knots
    positions = np.append(start[t.nlp.index[0]], start[t.nlp.index[-2, -1]])
    np.testing.assert_allclose(positions, np.interp(knots, f.horizons[0].time, x[:, 0]), atol=1e-3)
