"""Sensors of different rates, missing samples and uneven time stamps, against the exact smoother of the continuous plant."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import truths
from examples import LAG, OFFSET, D, K, M, compiled, lagged, oscillator

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.smoothing.smoother import Settings

PLANT = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG)
START, FORCE_STD, STD = np.array([0.5, 0.05, -0.1]), 0.5, (2e-3, 2e-2)


def sampled(case: str, n: int = 240) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, held inputs and samples (n, 2) of position and speed, NaN where there are none."""
    rng = np.random.default_rng(11)
    time = 0.01 * np.arange(n) + (rng.uniform(-4e-3, 4e-3, n) * (np.arange(n) % (n - 1) > 0) if case == "uneven" else 0.0)
    u = 5 * np.repeat(rng.normal(size=n // 6), 6)
    x = truths.disturbed(PLANT, time, u, START, FORCE_STD, rng)
    y = x[:, 1:] + np.array(STD) * rng.normal(size=(n, 2))
    if case == "two rates":
        y[np.arange(n) % 5 > 0, 0] = np.nan
        y[np.arange(n) % 3 > 0, 1] = np.nan
    else:
        y[rng.uniform(size=y.shape) < 0.4] = np.nan
        y[100:140, 0] = np.nan
    return time, u, y


@pytest.mark.parametrize("case", ["two rates", "missing", "uneven"])
def test_states_and_deviations_are_those_of_the_exact_smoother(case):
    time, u, y = sampled(case)
    recording = Recording(
        name="run", time=time, inputs={"F": u}, outputs={"x": y[:, 0], "v": y[:, 1]}, output_std={"x": STD[0], "v": STD[1]}
    )
    s = smooth(
        Problem(model=compiled(lagged()), recordings=[recording], weights=Weights(W={"mass": FORCE_STD})), settings=Settings(step=0.01)
    )
    assert s.solver.converged
    A, B, G = PLANT.matrices
    means, covariances = truths.smoothed(
        A, B, G, np.eye(3)[1:], time=time, u=np.column_stack([u, np.ones(len(u))]), y=y, std=np.tile(STD, (len(u), 1)),
        density=FORCE_STD**2, vague=30.0,
    )  # fmt: skip
    table = s.estimates["run"]
    # the actuator's force is forgotten within 0.3 s of the start, and its deviation falls to nothing: from there on only its value counts
    for i, name in ((1, "mass.s"), (2, "mass.v")):
        std = np.sqrt(covariances[:, i, i])
        assert np.max(np.abs(table[name] - means[:, i]) / std) < 0.03
        np.testing.assert_allclose(table[f"{name}.std"], std, rtol=0.03)
    assert np.max(np.abs(table["motor.f"] - means[:, 0])[time > 0.5]) < 1e-2


def test_an_input_that_changes_between_the_kept_rows_acts_in_full(tmp_path):
    rng, n, step = np.random.default_rng(0), 6000, 0.001
    plant = truths.Plant(m=M, d=D, k=K, offset=OFFSET)
    t, u = step * np.arange(n), np.repeat(5.0 * rng.choice([-1.0, 1.0], size=n // 7 + 1), 7)[:n]
    x = truths.motion(plant, t, u, np.zeros(2))[:, 0] + 1e-5 * rng.normal(size=n)
    pd.DataFrame({"t": t, "u": u, "x": x}).to_csv(tmp_path / "run.csv", index=False)
    r = Recording.read(tmp_path / "run.csv", time="t", inputs={"F": "u"}, outputs={"x": "x"}, std={"x": 1e-5}, every=10)
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": Free(1.0), "offset.f": Free(0.5)}
    s = smooth(Problem(model=compiled(oscillator()), recordings=[r], parameters=free, weights=Weights(W={"mass": 1e-3})))
    assert s.solver.converged
    assert len(s.estimates["run.csv"]) == n // 10
    for name, true in (("mass.m", M), ("spring.k", K), ("damper.d", D), ("offset.f", OFFSET)):
        p = s.parameters[name]
        assert abs(p.value - true) < 3.5 * p.std < 0.02 * abs(true)
