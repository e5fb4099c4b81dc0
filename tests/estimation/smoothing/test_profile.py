"""Profile likelihood against Gaussian intervals where they are right, and against the truth where they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linear_runs import ALL_FREE, MODEL, PLANT, STD, again, drive, many, problem

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.smoothing.profile import profile
from backsight.estimation.smoothing.program import decision_bounds
from backsight.models import Dae, Model, compile_model
from backsight.models.errors import InputError
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, PositionSensor

FIXED = {"mass.m": PLANT.m, "spring.k": PLANT.k, "damper.d": PLANT.d, "offset.f": PLANT.offset}
Q95 = 1.9599639845


def linear(parameters: dict[str, Free | float], n: int = 200) -> tuple[Problem, Smoothing]:
    y = many(n, 1, np.random.default_rng(0))[0] + STD * np.random.default_rng(1).normal(size=n)
    time, u = drive(n)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    posed = Problem(model=MODEL, recordings=[recording], parameters=parameters, weights=Weights(W={"mass": 0.3}))
    return posed, smooth(posed)


def test_of_a_linear_model_it_is_the_parabola_of_value_and_deviation():
    posed, result = linear({**FIXED, "offset.f": Free(0.0)})
    p = profile(posed, result, ["offset.f"])["offset.f"]
    assert p.estimate == pytest.approx(result.parameters["offset.f"].value, rel=1e-6)
    assert p.upper - p.estimate == pytest.approx(Q95 * p.std, rel=1e-3)
    assert p.estimate - p.lower == pytest.approx(Q95 * p.std, rel=1e-3)
    assert p.asymmetry == pytest.approx(1.0, abs=1e-3)
    assert p.cost == pytest.approx(((p.values - p.estimate) / p.std) ** 2 / 2, abs=1e-4)
    assert np.all(np.diff(p.values) > 0)
    assert p.limited == ()


def test_every_point_is_the_least_cost_with_the_parameter_held():
    """Solved anew from the guesses with the parameter fixed; the mass is fixed too, so that no cost needs a reference."""
    free = {**ALL_FREE, "mass.m": PLANT.m}
    posed, result = linear(free)
    p = profile(posed, result, ["spring.k"], points=2)["spring.k"]
    mesh = result.solution.transcription.horizons[0].mesh
    for value, cost in list(zip(p.values, p.cost, strict=True))[:: max(1, len(p.values) // 3)]:
        other, solution = problem(posed.recordings[0].outputs["x"], parameters={**free, "spring.k": float(value)})
        assert np.array_equal(solution.transcription.horizons[0].mesh.knots, mesh.knots)
        assert solution.solved.cost - result.solution.solved.cost == pytest.approx(cost, abs=2e-3)
        assert other.solver.converged


def test_without_a_result_the_problem_is_smoothed_first():
    posed, result = linear({**FIXED, "offset.f": Free(0.0)}, n=100)
    first, second = profile(posed, None, ["offset.f"], points=2), profile(posed, result, ["offset.f"], points=2)
    assert first["offset.f"].upper == pytest.approx(second["offset.f"].upper, rel=1e-9)


@pytest.mark.parametrize("away", [0.5, -0.5])
def test_a_bound_inside_the_interval_leaves_it_open_there(away):
    """A bound half a deviation beyond the estimate, or before it, so that the estimate ends on it."""
    open_one = linear({**FIXED, "offset.f": Free(0.0)})[1].parameters["offset.f"]
    bound = open_one.value + away * open_one.std
    posed, result = linear({**FIXED, "offset.f": Free(0.0, max=bound)})
    p = profile(posed, result, ["offset.f"])["offset.f"]
    assert (p.upper, p.limited, p.asymmetry) == (None, ("upper",), None)
    assert p.values[-1] == pytest.approx(bound, rel=1e-6)
    assert np.all(np.diff(p.values) > 0)
    # below, the parabola of the free estimate goes on, from the cost at the bound
    start = min(away, 0.0)
    assert p.lower == pytest.approx(open_one.value - np.sqrt(Q95**2 + start**2) * open_one.std, rel=1e-3)


@pytest.mark.parametrize("name", ["spring.k", "spring.kk"])
def test_what_was_not_estimated_is_refused_by_its_name(name):
    posed, result = linear({**FIXED, "offset.f": Free(0.0)}, n=60)
    with pytest.raises(InputError, match=rf'"{name}" is not estimated'):
        profile(posed, result, [name])
    with pytest.raises(InputError, match="at least 2 points"):
        profile(posed, result, ["offset.f"], points=1)


def coasting() -> Dae:
    """A damped mass that coasts: x(t) = x_0 + v_0 m/d (1 - exp(-d t/m)), strongly nonlinear in d where it is small beside the noise."""
    return compile_model(
        Model(
            name="coasting",
            components={"push": Force(), "mass": Mass(m=1.0), "damper": Damper(d=1.0), "sensor": PositionSensor(), "ground": Fixed()},
            connections=[
                ("push.flange", "mass.flange"),
                ("sensor.flange", "mass.flange"),
                ("mass.flange", "damper.flange_a"),
                ("damper.flange_b", "ground.flange"),
            ],
            inputs={"F": "push.f"},
            outputs={"x": "sensor.s"},
        )
    )


def coasted(model: Dae, d: float, noise: np.ndarray, v_0: float = 1.0) -> Problem:
    time = np.linspace(0.0, 6.0, len(noise))
    x = v_0 / d * (1.0 - np.exp(-d * time)) + noise
    recording = Recording(name="run", time=time, inputs={"F": 0 * time}, outputs={"x": x}, output_std={"x": 0.4})
    return Problem(
        model=model,
        recordings=[recording],
        parameters={"damper.d": Free(1.0, min=1e-3)},
        weights=Weights(W={"mass": 1e-6}),
        initial={"mass.s": 0.0},
    )


def profiled_by_hand(posed: Problem) -> np.ndarray:
    """Ends of the interval: for every d the best v_0 is linear; the level is sought on a dense grid."""
    recording = posed.recordings[0]
    d = np.linspace(1e-3, 30.0, 60_001)[:, None]
    shape = (1.0 - np.exp(-d * recording.time)) / d
    y = recording.outputs["x"]
    v = shape @ y / np.sum(shape**2, axis=1)
    cost = np.sum((y - v[:, None] * shape) ** 2, axis=1) / 0.4**2 / 2
    inside = np.flatnonzero(cost - cost.min() <= Q95**2 / 2)
    return d[[inside[0], inside[-1]], 0]


def test_a_lopsided_interval_is_that_of_the_likelihood_itself():
    model = coasting()
    posed = coasted(model, 1.0, 0.4 * np.random.default_rng(2).normal(size=60))
    result = smooth(posed)
    p = profile(posed, result, ["damper.d"])["damper.d"]
    low, high = profiled_by_hand(posed)
    assert p.lower == pytest.approx(low, abs=2e-3)
    assert p.upper == pytest.approx(high, abs=2e-3)
    assert p.asymmetry > 1.2


@pytest.mark.slow
@pytest.mark.long
def test_the_interval_of_a_strongly_nonlinear_model_holds_the_truth_as_often_as_it_says():
    """60 records: 95 % of them between 51 and 60, half of them below the median of chi-square; both missed with a chance below 1 %."""
    rng, d = np.random.default_rng(3), 1.0
    posed = coasted(coasting(), d, 0.4 * rng.normal(size=60))
    result, held, inner = smooth(posed), 0, 0
    clean = coasted(posed.model, d, np.zeros(60)).recordings[0].outputs["x"]
    for _ in range(60):
        solution = again(result.solution, clean + 0.4 * rng.normal(size=60), *decision_bounds(posed, result.solution.transcription))
        p = profile(posed, replace(result, solution=solution), ["damper.d"], points=2)["damper.d"]
        held += (p.lower is None or p.lower <= d) and (p.upper is None or p.upper >= d)
        root = np.sign(p.values - p.estimate) * np.sqrt(2 * p.cost)
        inner += abs(np.interp(d, p.values, root)) < 0.6745
    assert 51 <= held <= 60
    assert abs(inner - 30) <= 10
