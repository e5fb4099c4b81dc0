"""Priors and starts that the data contradict are named; those that they do not are not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from linear_runs import ALL_FREE, FORCE_STD, MODEL, OFFSET, STD, K, M, drive, many, problem

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.problem import Known
from backsight.estimation.smoothing.beforehand import blamed, freed
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.wording import measured
from backsight.ocp import Options

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


@pytest.mark.parametrize("std", [1e-4 * K, 1e-7 * K])
def test_a_prior_that_wins_against_the_data_is_named_with_where_they_lead(std):
    y = record(1)
    free = problem(y)[0].parameters["spring.k"]
    result, _ = problem(y, parameters=ALL_FREE | {"spring.k": Free(1.1 * K, std=std)})
    (note,) = said(result)
    found = re.fullmatch(
        rf"spring\.k = 55 ± (\S+) N/m was known beforehand, and without that it would be near (\S+) ± (\S+): {re.escape(MISLEADS)}", note
    )
    assert found is not None
    assert float(found[2]) == pytest.approx(free.value, rel=0.05)  # by one step, and in two digits


def test_a_prior_that_wins_and_is_right_is_not_named():
    assert said(problem(record(1), parameters=ALL_FREE | {"spring.k": Free(K, std=1e-4 * K)})[0]) == []


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


def posed(y: np.ndarray, **given: object) -> Problem:
    time, u = drive(len(y))
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    asked: dict = {"parameters": ALL_FREE, "weights": Weights(W={"mass": FORCE_STD})} | given
    return Problem(model=MODEL, recordings=[recording], **asked)


def test_what_keeps_a_problem_from_an_answer_is_compared_with_the_answer_without_it():
    y = record(4)
    wrong = posed(y, initial={"mass.s": 0.5}, parameters=ALL_FREE | {"spring.k": Free(4 * K, std=0.01), "offset.f": Free(OFFSET, std=1.0)})
    plain = freed(wrong)
    assert plain is not None
    assert not plain.initial
    assert plain.parameters["spring.k"] == Free(4 * K)
    without = smooth(plain)
    at, k = without.estimates["run"]["mass.s"].iloc[0], without.parameters["spring.k"]
    said = blamed(wrong, without)
    assert f"spring.k would be {' ± '.join(measured(k.value, k.std))} N/m instead of 200 ± 0.01; mass.s would begin at {at:.3f}" in said
    assert "offset.f" not in said  # agrees
    assert freed(posed(y)) is None


def test_where_a_solve_stops_its_numbers_are_no_notes_and_the_likeliest_causes_are():
    settings = Settings(options=Options(gauss_newton_iterations=1, max_iterations=1), check_mesh=False)
    y = record(4)
    y[100] += 1.0
    result = smooth(posed(y), settings=settings)
    assert not result.solver.converged
    assert result.notes[0].startswith("x: one sample stands far off its neighbours")
    assert result.notes[-1].startswith("No estimate: what is written is where the solver stopped.")
    assert not any("white" in note or "W of" in note for note in result.notes[:-1])


def test_where_a_solve_stops_a_given_w_and_a_v_below_the_samples_noise_are_named():
    settings = Settings(options=Options(gauss_newton_iterations=1, max_iterations=1), check_mesh=False)
    problem = posed(record(4))
    place = problem.dae.places[0].name
    weighed = replace(problem, weights=Weights(W={place: 1.0}, V={"x": 1e-9}))
    result = smooth(weighed, settings=settings)
    assert not result.solver.converged
    assert result.notes[0].startswith("V of x is given as 1e-09 m")
    assert result.notes[-1].endswith(f"leave out W of {place}, so that the data choose it.")
