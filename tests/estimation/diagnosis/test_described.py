"""What a force without a name goes with, of forces made by formulas, and of the axis with a force of which no component is made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Weights, smooth
from backsight.estimation.diagnosis.search.described import described, explained, foretold, functions
from backsight.estimation.diagnosis.search.refit import QUICKLY

N = 2000
UNITS = {"position": "m", "velocity": "m/s", "time": "s", "F": "N"}


def moved(seed: int = 0) -> dict[str, np.ndarray]:
    """A motion of three sines, and an input that has nothing to do with it."""
    t = np.linspace(0.0, 10.0, N)
    rates, sizes = np.array([1.1, 2.3, 5.2]), np.array([0.5, 0.3, 0.1])
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    x = sizes @ np.sin(rates[:, None] * t + phases[:, None])
    v = (sizes * rates) @ np.cos(rates[:, None] * t + phases[:, None])
    return {"position": x, "velocity": v, "time": t, "F": np.random.default_rng(seed + 50).standard_normal(N)}


def told(force: np.ndarray, motion: dict[str, np.ndarray]) -> list[tuple[str, float]]:
    return explained(force, [f for f in functions(force, motion, UNITS) if not f.of_input])


def coloured(seed: int, memory: float) -> np.ndarray:
    """Noise that is forgotten after `memory` samples."""
    kept, out, rng = np.exp(-1.0 / memory), np.zeros(N), np.random.default_rng(seed)
    for k in range(1, N):
        out[k] = kept * out[k - 1] + rng.standard_normal()
    return out


def test_a_force_that_waves_along_the_position_is_told_with_its_length():
    m = moved()
    force = np.sin(2 * np.pi * m["position"] / 0.0873) + 0.2 * np.random.default_rng(1).standard_normal(N)
    ((words, share),) = told(force, m)
    assert words == "waves of 0.0873 m along the position"
    assert share == pytest.approx(0.5 / 0.54, abs=0.03)


def test_of_two_functions_the_larger_comes_first_with_its_own_share():
    m = moved()
    force = 2.0 * np.sign(m["velocity"]) + 1.5 * np.sin(2 * np.pi * m["position"] / 0.11)
    (first, most), (second, more) = told(force, m)
    assert (first, second) == ("the direction of the velocity", "waves of 0.11 m along the position")
    assert most == pytest.approx(4.0 / 5.125, abs=0.04)
    assert more == pytest.approx(1.125 / 5.125, abs=0.04)


def test_a_constant_is_told_and_hides_nothing():
    m = moved()
    force = 3.0 + 2.0 * np.sign(m["velocity"]) + 0.2 * np.random.default_rng(2).standard_normal(N)
    assert [words for words, _ in told(force, m)] == ["a constant", "the direction of the velocity"]


@pytest.mark.parametrize(("memory", "most"), [(1.0, 0), (20.0, 3), (100.0, 5)])
def test_noise_goes_with_nothing(memory, most):
    """A shift of twelve is beaten by chance once in thirteen: of twenty so many at most."""
    wrong = sum(bool(told(coloured(seed, memory), moved(seed))) for seed in range(20))
    assert wrong <= most


def test_what_is_foretold_of_a_part_is_not_fitted_to_it():
    """A function that is there in one part alone foretells nothing, however well it fits."""
    column = np.zeros((N, 1))
    column[: N // 10] = 1.0
    assert foretold(column[:, 0], column) < 1e-9
    assert foretold(np.ones(N), np.ones((N, 1))) == pytest.approx(1.0)


def test_a_force_on_the_axis_that_goes_with_time_is_described_so():
    made = run(1.0, 2e-3, force=lambda t, _q, v: np.full_like(v, 5.0 * np.sin(2 * np.pi * 7.0 * t)))
    problem = replace(posed(made), weights=Weights())
    words = described(smooth(problem, settings=QUICKLY), "carriage")
    share, _, rest = words.partition(" % with waves of ")
    assert float(share) > 65
    assert float(rest.split()[0]) == pytest.approx(1 / 7, rel=0.02)
    assert "s along the time" in rest


def test_a_place_that_is_not_there_goes_with_nothing():
    problem = posed(run(0.2, 2e-3))
    assert described(smooth(problem), "nowhere") == ""
