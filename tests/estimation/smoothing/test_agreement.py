"""What weights promise of the residuals: a dense Gaussian of the same plant, and weights that are wrong by known factors."""

from __future__ import annotations

import numpy as np
import pytest
from linear_runs import FORCE_STD, MODEL, STD, dense, drive, many, problem

from backsight.estimation import Problem, Recording, Weights, smooth
from backsight.estimation.smoothing.agreement import force_squares, output_squares
from backsight.estimation.smoothing.program import Settings

FIXED = {"parameters": {}}
N = 400


def said(notes: tuple[str, ...]) -> list[str]:
    return [note for note in notes if "mislead" in note]


def test_what_the_data_tell_is_shared_by_samples_and_forces_as_in_a_dense_gaussian():
    """S = C + std^2 I, E the effect of the start: what is left of the samples is std^2 S^-1 P y, P = I - E (E' S^-1 E)^-1 E' S^-1."""
    n = 120
    y = many(n, 1, np.random.default_rng(0))[0] + STD * np.random.default_rng(1).normal(size=n)
    _, solution = problem(y, settings=Settings(step=0.01), **FIXED)
    _, S, effect = dense(n)
    E, inverse = effect[:, :2], np.linalg.inv(S)
    projected = inverse - inverse @ E @ np.linalg.solve(E.T @ inverse @ E, E.T @ inverse)
    told = output_squares(solution, 0, [0])[1]
    assert told == pytest.approx(STD**2 * np.trace(projected), rel=0.01)
    # all rows less all unknowns, of which there are two more than forces
    assert told + force_squares(solution, 0)[1] == pytest.approx(n - 2, rel=1e-6)


def test_right_weights_are_not_doubted_and_the_squares_are_what_they_promise():
    rng, sums = np.random.default_rng(3), np.zeros((2, 2))
    for _ in range(6):
        result, solution = problem(many(N, 1, rng)[0] + STD * rng.normal(size=N), **FIXED)
        assert said(result.notes) == []
        sums += [force_squares(solution, 0), output_squares(solution, 0, [0])]
    assert np.all(np.abs(sums[:, 0] - sums[:, 1]) < 4 * np.sqrt(2 * sums[:, 1])), sums


@pytest.mark.parametrize("times", [3.0, 10.0])
def test_a_place_whose_weight_is_too_small_is_named_with_the_factor(times):
    rng = np.random.default_rng(4)
    y = many(N, 1, rng)[0] + STD * rng.normal(size=N)
    result, _ = problem(y, weights=Weights(W={"mass": FORCE_STD / times}), **FIXED)
    (note, *_) = said(result.notes)
    assert note.startswith("residual.mass is ")
    assert "times what W of mass allows" in note
    assert float(note.split()[2]) == pytest.approx(times, rel=0.4)


def test_an_output_whose_weight_is_too_small_is_named_with_the_factor():
    rng = np.random.default_rng(5)
    result, _ = problem(many(N, 1, rng)[0] + 5 * STD * rng.normal(size=N), **FIXED)
    (note,) = [note for note in said(result.notes) if note.startswith("x: measured minus smoothed")]
    assert float(note.partition(" is ")[2].split()[0]) == pytest.approx(5.0, rel=0.2)


def test_a_noise_from_the_data_that_is_none_is_doubted():
    """Where W allows no force what the forces do is taken for noise, and differences of the samples know better."""
    rng = np.random.default_rng(6)
    time, u = drive(N)
    y = many(N, 1, rng)[0] + STD * rng.normal(size=N)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y})
    result = smooth(Problem(model=MODEL, recordings=[recording], weights=Weights(W={"mass": 1e-6})))
    (note,) = [note for note in said(result.notes) if note.startswith("V of x is ")]
    assert float(note.split()[4]) == pytest.approx(result.weights.V["x"] / STD, rel=0.2)
    assert not [note for note in result.notes if note.startswith("x: measured")]


@pytest.mark.parametrize("times", [0.6, 5.0, 20.0])
def test_a_given_noise_below_that_of_the_samples_is_named_first_and_what_follows_from_it_is_not(times):
    """Forces that nobody weighs follow the rest of the noise, and would look like a force with a memory."""
    rng = np.random.default_rng(8)
    time, u = drive(2 * N)
    y = many(2 * N, 1, rng)[0] + STD * rng.normal(size=2 * N)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD / times})
    notes = smooth(Problem(model=MODEL, recordings=[recording])).notes
    told = [note for note in notes if "its samples have noise of" in note]
    assert bool(told) == (times > 2)
    if told:
        assert notes[0] == told[0]
        assert float(told[0].split("noise of ")[1].split()[0]) == pytest.approx(STD, rel=0.15)
        assert not any("memory" in note or "not white" in note for note in notes)
