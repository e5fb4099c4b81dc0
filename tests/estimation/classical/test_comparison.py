"""One table of the smoother and the classical methods, and what they predict of a recording that none has seen."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.classical import compare, filtered_least_squares, harmonic, prediction_error
from backsight.models.errors import InputError

OSCILLATOR = compiled(oscillator())
NOISE = 1e-3


def recorded(name: str, seed: int, role: str = "fit") -> Recording:
    rng, n = np.random.default_rng(seed), 800
    time, u = 0.01 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10), 10)
    x = truths.disturbed(truths.Plant(m=M, d=D, k=K, offset=OFFSET), time, u, np.array([0.02, -0.1]), 0.01, rng)
    y = x[:, 0] + NOISE * rng.normal(size=n)
    return Recording(name=name, time=time, inputs={"F": u, "unused": u}, outputs={"x": y}, output_std={"x": NOISE}, role=role)


def problem() -> Problem:
    free = {"mass.m": Free(2.5), "spring.k": Free(40.0), "damper.d": D, "offset.f": OFFSET}
    recordings = [recorded("a", 1), recorded("b", 2, "held_out")]
    return Problem(model=OSCILLATOR, recordings=recordings, parameters=free, weights=Weights(W={"mass": 0.01}))


@pytest.fixture(scope="module")
def table():
    wrong = partial(filtered_least_squares, cutoff=30.0)
    return compare(problem(), [prediction_error, wrong, partial(filtered_least_squares, cutoff=6.0), partial(harmonic, frequency=0.01)])


@pytest.mark.slow
def test_every_method_has_a_row_with_its_parameters_and_deviations(table):
    assert list(table.index) == ["smooth", "prediction_error", "filtered_least_squares", "filtered_least_squares (2)", "harmonic"]
    for method in ("smooth", "prediction_error"):
        assert abs(table.loc[method, "mass.m"] - M) < 5 * table.loc[method, "mass.m.std"]
        assert abs(table.loc[method, "spring.k"] - K) < 5 * table.loc[method, "spring.k.std"]


def test_better_parameters_predict_better_and_good_ones_to_the_noise(table):
    ahead = table["b.x.ahead"]
    assert ahead["smooth"] == pytest.approx(NOISE, rel=0.4)
    assert ahead["prediction_error"] == pytest.approx(NOISE, rel=0.4)
    assert ahead["filtered_least_squares"] > 1.3 * ahead["smooth"]  # noise in the regressors


def test_a_method_that_does_not_apply_says_why_in_its_row(table):
    assert "hold no whole period" in table.loc["harmonic", "note"]
    assert np.isnan(table.loc["harmonic", "mass.m"])
    assert table.loc["smooth", "note"] == ""


@pytest.mark.slow
def test_results_that_are_there_are_taken_as_they_are():
    given = problem()
    bare = [replace(r, inputs={"F": r.inputs["F"]}) for r in given.recordings]
    plain = replace(given, recordings=bare)
    result, base = smooth(plain), prediction_error(plain)
    table = compare(plain, [base], result)
    assert table.loc["smooth", "mass.m"] == result.parameters["mass.m"].value
    assert table.loc["prediction_error", "mass.m"] == base.parameters["mass.m"].value
    assert table.loc["prediction_error", "a.x.rms"] == base.fit["a"]["x"].rms


def test_repr_names_the_method_and_the_free_parameters():
    base = prediction_error(problem())
    assert repr(base).startswith("Baseline(prediction_error of oscillator: spring.k = ") or "mass.m = " in repr(base)
    with pytest.raises(InputError, match="nothing to estimate"):
        prediction_error(Problem(model=OSCILLATOR, recordings=[recorded("a", 1)]))
