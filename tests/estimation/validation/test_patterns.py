"""What a residual force goes with."""

import numpy as np
import pandas as pd
import pytest

from backsight.estimation.results import Companion
from backsight.estimation.validation.patterns import CONSTANT, companion, correlation, differing, own_states

UNITS = {"carriage.s": "m", "carriage.v": "m/s", "wheel.omega": "rad/s", "motor.i": "A"}


def coloured(rng: np.random.Generator, a: float, n: int) -> np.ndarray:
    e = rng.standard_normal(n)
    for k in range(1, n):
        e[k] += a * e[k - 1]
    return e


def test_unrelated_coloured_series_get_the_deviation_that_they_have() -> None:
    rng, n, a = np.random.default_rng(1), 2000, 0.9
    found = [correlation(coloured(rng, a, n), coloured(rng, a, n)) for _ in range(60)]
    expected = np.sqrt((1 + a * a) / (1 - a * a) / n)  # Bartlett, both first order
    assert np.std([r for r, _ in found]) == pytest.approx(expected, rel=0.3)
    assert np.median([d for _, d in found]) == pytest.approx(expected, rel=0.3)


@pytest.fixture(scope="module")
def motion() -> pd.DataFrame:
    t = np.arange(8000) * 1e-3
    s = 0.1 * np.sin(3 * t) + 0.03 * np.sin(11 * t)
    return pd.DataFrame({"t_s": t, "carriage.s": s, "carriage.v": 0.3 * np.cos(3 * t) + 0.33 * np.cos(11 * t)})


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("5 * sign(v)", "the sign of carriage.v"),
        ("-30 * v", "carriage.v"),
        ("20 * abs(v)", "|carriage.v|"),
        ("40 * v * abs(v)", "carriage.v squared, with its sign"),
        ("2 * a", "the rate of change of carriage.v"),
        ("60 * s", "carriage.s"),
    ],
)
def test_a_residual_is_named_after_the_law_that_made_it(motion: pd.DataFrame, law: str, words: str) -> None:
    t = motion["t_s"].to_numpy()
    known = {"s": motion["carriage.s"].to_numpy(), "v": motion["carriage.v"].to_numpy(), "sign": np.sign, "abs": np.abs}
    known["a"] = -0.9 * np.sin(3 * t) - 3.63 * np.sin(11 * t)
    w = eval(law, known) + 0.5 * np.random.default_rng(2).standard_normal(t.size)
    found = companion(w, ["carriage.v", "carriage.s"], motion, UNITS, np.arange(t.size))
    assert found is not None
    assert found.what == words


def test_noise_goes_with_nothing(motion: pd.DataFrame) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        w = coloured(rng, 0.95, len(motion))
        assert companion(w, ["carriage.v", "carriage.s"], motion, UNITS, np.arange(len(motion))) is None


def test_a_place_is_held_against_its_own_states_or_else_those_of_its_kind() -> None:
    states = ("carriage.s", "carriage.v", "wheel.omega", "motor.i")
    assert own_states("carriage", "N", states, UNITS) == (["carriage.v", "carriage.s"], True)
    assert own_states("screw", "N", states, UNITS) == (["carriage.v", "carriage.s"], False)
    assert own_states("spindle", "N.m", states, UNITS) == (["wheel.omega"], False)
    assert own_states("motor", "V", states, UNITS) == (["motor.i"], True)
    assert own_states("valve", "Pa", states, UNITS) == ([], False)


def test_an_input_whose_gain_is_off_is_named(motion: pd.DataFrame) -> None:
    rng, n = np.random.default_rng(4), len(motion)
    u = np.repeat(rng.standard_normal(n // 50), 50)
    found = companion(0.1 * u + 0.05 * rng.standard_normal(n), ["carriage.v"], motion, UNITS, np.arange(n), {"F": u})
    assert found is not None
    assert found.what == "the input F"
    assert found.correlation == pytest.approx(0.1 / np.sqrt(0.1**2 + 0.05**2), abs=0.02)
    assert 0 < found.std < 0.1


def test_constants_that_differ_between_recordings_are_each_ones_own():
    plain, rng = Companion(what="a constant, 7 N", law=CONSTANT, correlation=0.7, std=0.02), np.random.default_rng(6)
    white = rng.standard_normal(400)
    white -= white.mean()
    assert differing(plain, {"a": 7.0 + white, "b": 6.5 + white}, "N") == plain
    assert differing(plain, {"a": 7.0 + white}, "N") == plain
    # a mean that is hardly known says nothing of another constant
    assert differing(plain, {"a": 7.0 + white, "b": 1.0 + 60.0 * white}, "N") == plain
    found = differing(plain, {"a": 7.0 + white, "b": -6.5 + white, "empty": np.full(3, np.nan)}, "N")
    assert found.what == "a constant of every recording, 7 N in a and -6.5 N in b"
    assert "per_recording" in found.law
    assert found.correlation == plain.correlation


def test_an_input_that_acts_late_is_named(motion: pd.DataFrame) -> None:
    rng, n, t = np.random.default_rng(5), len(motion), motion["t_s"].to_numpy()
    u = np.sin(7 * t) + 0.4 * np.sin(29 * t + 1.0)
    late = np.sin(7 * (t - 0.01)) + 0.4 * np.sin(29 * (t - 0.01) + 1.0)
    found = companion(late - u + 0.05 * rng.standard_normal(n), ["carriage.v"], motion, UNITS, np.arange(n), {"F": u})
    assert found is not None
    assert found.what == "the rate of change of the input F"
    assert found.law == "a delay or a lag of it"
    assert found.correlation < -0.8
