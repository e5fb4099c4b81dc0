"""Chances of gains: against the draws of a linear smoothing problem, against independent and against equal looks."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from concealed_axis import smoothed
from scipy.stats import chi2

from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.chance import LEAST, Chance
from backsight.estimation.diagnosis.scores.score import Columns
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.supermodel import looked_at

RNG = np.random.default_rng(3)


def copies(looks: int, times: int) -> np.ndarray:
    """Correlation of independent looks, every one there several times."""
    return np.kron(np.eye(looks), np.ones((times, times)))


def related(looks: int, rho: float) -> np.ndarray:
    """Correlation of looks of which neighbours are alike, as wave numbers are."""
    return rho ** np.abs(np.subtract.outer(np.arange(looks), np.arange(looks)))


def largest(correlation: np.ndarray, draws: int) -> np.ndarray:
    """Largest gain of every draw, (draws,)."""
    e, Q = np.linalg.eigh(correlation)
    root = Q * np.sqrt(np.maximum(e, 0.0))
    return ((root @ RNG.standard_normal((len(e), draws))) ** 2).max(axis=0) / 2


@pytest.mark.parametrize(
    ("correlation", "share"),
    [(copies(40, 1), 1.0), (copies(30, 20), 1 / 20), (related(200, 0.9), None), (related(200, 0.99), None), (related(200, 0.5), None)],
    ids=["independent", "copies", "related", "much alike", "hardly alike"],
)
def test_as_many_looks_count_as_have_something_of_their_own(correlation: np.ndarray, share: float | None) -> None:
    chance = Chance(looks=Counter({1: len(correlation)}), most=largest(correlation, 4000))
    if share is not None:
        assert chance.share == pytest.approx(share, rel=0.15)
    fresh = largest(correlation, 20_000)
    for p, most in ((0.1, 1.25), (0.05, 1.25), (0.01, 1.8)):  # looks that are related have more of their own far out
        assert 0.75 < np.mean(fresh > chance.needed(p)) / p < most
        assert chance.of(chance.needed(p)) == pytest.approx(p)


def test_without_draws_it_is_the_bound_and_without_looks_nothing_is_by_chance() -> None:
    bound = Chance(looks=Counter({1: 3, 2: 1}))
    g = 9.0
    assert bound.share == 1.0
    assert bound.of(g) == pytest.approx(3 * chi2.sf(2 * g, 1) + chi2.sf(2 * g, 2), rel=1e-3)
    assert bound.of(LEAST) < 1.0
    assert Chance(looks=Counter()).of(1.0) == 0.0
    assert Chance(looks=Counter()).needed(0.05) == LEAST


def test_a_chance_is_no_larger_than_the_bound() -> None:
    assert Chance(looks=Counter({1: 5}), most=np.full(16, 12.0)).share == 1.0  # by chance larger than they should be


def test_scores_of_drawn_rows_vary_as_their_information_says() -> None:
    problem, result, base = smoothed()
    some = [c for c in library(problem, problem.model, result.solution) if c.place in ("carriage", "sensor:x")]
    every = Columns.joined([k.columns for k in looked_at(problem, problem.model, base, some)])
    scores = base.scores(every)
    columns = every.taken(np.flatnonzero(np.diag(scores.G) > 1e-6 * scores.plain)[:16].tolist())
    G = base.scores(columns).G
    size = np.sqrt(np.diag(G))
    b = base.drawn(5, 4000).b(columns) / size[:, None]
    assert np.abs(b @ b.T / b.shape[1] - G / np.outer(size, size)).max() < 5 / np.sqrt(b.shape[1])
    assert np.array_equal(base.drawn(5, 8).b(columns), base.drawn(5, 8).b(columns))
    assert not np.allclose(base.drawn(5, 8).b(columns), base.drawn(6, 8).b(columns))


def test_the_library_of_an_axis_has_far_fewer_effects_than_looks() -> None:
    problem, result, base = smoothed()
    found = screen(base, looked_at(problem, problem.model, base, library(problem, problem.model, result.solution)))
    looks = sum(found.chance.looks.values())
    assert 5 < found.chance.share * looks < 0.8 * looks
    assert found.chance.needed(0.05) < Chance(looks=found.chance.looks).needed(0.05)
    assert found.chance.of(found.found[0].gain) > 1e-3  # nothing is missing
