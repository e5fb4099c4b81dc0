"""Errors of a clock are told from those of a sensor."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from examples import oscillator

from backsight.estimation import Problem, Recording
from backsight.estimation.smoothing.clock import clock_notes

N, STD, OFF, STEP = 3000, 1e-5, 4e-4, 2e-4


def motion(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, what moves, and what a sensor makes of it."""
    rng, t = np.random.default_rng(4), 2e-3 * np.arange(N)
    x = 0.1 * np.sin(5.0 * t) + 0.03 * np.sin(17.0 * t)
    v = 0.5 * np.cos(5.0 * t) + 0.51 * np.cos(17.0 * t)
    made = {
        "noise": x + STD * rng.normal(size=N),
        "clock": x + v * OFF * rng.normal(size=N) + STD * rng.normal(size=N),
        "encoder": STEP * np.round(x / STEP),
        "outliers": x + STD * rng.standard_t(2, size=N),
        "gain": x * (1 + 5e-3 * rng.normal(size=N)),
    }
    return t, x, made[kind]


@pytest.mark.parametrize("kind", ["noise", "clock", "encoder", "outliers", "gain"])
def test_only_errors_that_grow_with_the_rate_are_a_clocks(kind):
    t, x, y = motion(kind)
    problem = Problem(model=oscillator(), recordings=[Recording(name="run", time=t, inputs={"F": 0 * t}, outputs={"x": y})])
    notes = clock_notes(problem, {"run": pd.DataFrame({"t_s": t, "x": x, "x.measured": y})})
    if kind != "clock":
        assert notes == []
        return
    (note,) = notes
    found = re.search(r"off by about (\S+) s", note)
    assert found is not None
    assert float(found[1]) == pytest.approx(OFF, rel=0.15)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_an_encoder_that_rests_is_no_clock(share):
    t, x, _ = motion("noise")
    rests = t < share * t[-1]
    x = np.where(rests, x[np.argmin(rests)], x)
    problem = Problem(model=oscillator(), recordings=[Recording(name="run", time=t, inputs={"F": 0 * t}, outputs={"x": x})])
    table = pd.DataFrame({"t_s": t, "x": x, "x.measured": STEP * np.round(x / STEP)})
    assert clock_notes(problem, {"run": table}) == []
