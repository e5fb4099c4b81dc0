"""The screen against draws, against a bounded minimiser, and against dense regressions of which the answers are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from concealed_axis import smoothed
from scipy.optimize import minimize
from scipy.stats import chi2

from backsight.estimation.diagnosis.candidates.candidate import Candidate, Signal
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.onsets import late
from backsight.estimation.diagnosis.scores.score import Columns, Scores
from backsight.estimation.diagnosis.scores.screen import Screen, gain, screen, told
from backsight.estimation.diagnosis.scores.supermodel import Look, looked_at

ROWS = 60


@dataclass(frozen=True)
class Regression:
    """Rows r + J dX + S a with unit noise: what `Linearised` is for a smoothing problem, by a projection."""

    r: np.ndarray
    J: np.ndarray

    def effects(self, columns: Columns) -> np.ndarray:
        Q, _ = np.linalg.qr(self.J)
        return columns.squares - Q @ (Q.T @ columns.squares)

    @property
    def left(self) -> np.ndarray:
        return self.effects(Columns(squares=self.r[:, None], multiplied=np.zeros((0, 1))))[:, 0]

    @property
    def intervals(self) -> np.ndarray:
        return np.arange(len(self.r))

    def drawn(self, seed: int, draws: int) -> Drawn:
        return Drawn(self, np.random.default_rng([5, seed]).standard_normal((len(self.r), draws)))

    def scores(self, columns: Columns) -> Scores:
        S = self.effects(columns)
        return Scores(b=S.T @ self.r, G=S.T @ S, plain=np.sum(columns.squares**2, axis=0))


@dataclass(frozen=True)
class Drawn:
    """Scores of rows that were drawn."""

    base: Regression
    rows: np.ndarray

    def b(self, columns: Columns) -> np.ndarray:
        return self.base.effects(columns).T @ self.rows


def look(columns: np.ndarray, of: Candidate | None = None, **given) -> Look:
    c = of or Candidate(place="p", family="friction", physics="x", strengths=tuple(f"a_{i}" for i in range(columns.shape[1])), **given)
    return Look(candidate=c, shape={}, columns=Columns(squares=columns, multiplied=np.zeros((0, columns.shape[1]))))


def regression(seed: int, signal: np.ndarray | None = None) -> Regression:
    rng = np.random.default_rng(seed)
    J = np.random.default_rng(99).standard_normal((ROWS, 4))
    return Regression(r=rng.standard_normal(ROWS) + (0 if signal is None else signal), J=J)


def test_gain_estimate_and_deviation_are_those_of_a_regression():
    rng = np.random.default_rng(0)
    S = rng.standard_normal((ROWS, 2))
    base = regression(1, -S @ [1.0, -2.0])
    (found,) = screen(base, [look(S)]).found
    A = np.column_stack([base.J, S])
    fit, (rest,), *_ = np.linalg.lstsq(A, -base.r, rcond=None)
    _, (before,), *_ = np.linalg.lstsq(base.J, -base.r, rcond=None)
    assert found.estimate == pytest.approx(fit[4:])
    assert found.gain == pytest.approx((before - rest) / 2)
    assert found.std == pytest.approx(np.sqrt(np.diag(np.linalg.inv(A.T @ A)))[4:])
    assert found.freedom == 2


def test_the_best_shape_of_a_candidate_is_kept_and_every_look_counted():
    rng = np.random.default_rng(0)
    right, wrong = rng.standard_normal((ROWS, 1)), rng.standard_normal((ROWS, 1))
    c = Candidate(place="p", family="friction", physics="x", strengths=("a",))
    found = screen(regression(2, -right[:, 0]), [look(wrong, c), look(right, c), look(rng.standard_normal((ROWS, 2)))])
    assert len(found.found) == 2
    assert found.found[0].look.columns.squares is not None
    assert np.array_equal(found.found[0].look.columns.squares, right)
    assert found.chance.looks == {1: 2, 2: 1}


@pytest.mark.parametrize("seed", range(6))
def test_strengths_that_may_not_be_negative_gain_what_a_bounded_minimiser_says(seed):
    rng = np.random.default_rng(seed)
    S = rng.standard_normal((ROWS, 3)) + rng.standard_normal((ROWS, 1))
    base = regression(seed, S @ rng.standard_normal(3) / 3)
    (found,) = screen(base, [look(S, one_sided=True)]).found
    scores = base.scores(look(S).columns)

    def cost(a):
        return scores.b @ a + a @ scores.G @ a / 2, scores.b + scores.G @ a

    best = minimize(cost, np.ones(3), jac=True, bounds=[(0, None)] * 3, options={"ftol": 1e-14, "gtol": 1e-10})
    assert found.gain == pytest.approx(-best.fun, abs=1e-6)
    assert found.estimate == pytest.approx(best.x, abs=1e-4)
    (free,) = screen(base, [look(S)]).found
    assert free.gain >= found.gain


def test_a_signal_cannot_be_other_than_it_is_with_a_negative_share():
    S = np.random.default_rng(0).standard_normal((ROWS, 1))
    signal = Signal(of=("input:u",), changed=lambda _, values: values)
    against, along = (screen(regression(3, sign * 3 * S[:, 0]), [look(S, signals=(signal,))]).found[0] for sign in (1, -1))
    assert against.gain == 0
    assert along.gain > 20


def test_of_what_is_all_shape_the_one_is_kept_that_is_as_large_as_it_is_and_not_one_that_had_to_be_five_times_as_large():
    """A short delay does to an input that is mostly noise what a long one does, but for its size."""
    rng = np.random.default_rng(4)
    true = 3 * rng.standard_normal((ROWS, 1))
    base = regression(3, -true[:, 0])
    nearly = true + 0.3 * rng.standard_normal((ROWS, 1))
    signal = Signal(of=("input:u",), changed=lambda _, values: values, start={"u.delay": 1.0})
    whole = Candidate(place="p", family="friction", physics="input_delay", signals=(signal,))
    kept, growing = (screen(base, [look(true / 5, c), look(nearly, c)]).found[0] for c in (whole, replace(whole, grows=("u.delay",))))
    fifth, other = (screen(base, [look(columns, whole)]).found[0].gain for columns in (true / 5, nearly))
    assert fifth > other
    assert np.array_equal(kept.look.columns.squares, nearly)
    assert np.array_equal(growing.look.columns.squares, true / 5)


@pytest.mark.parametrize("seed", range(25))
def test_of_what_is_all_shape_and_no_shape_is_there_as_a_whole_that_is_kept_which_gains_most(seed):
    """Parameters have made up for most of a lag: of none as long as it is all is left, and a short one that is hardly told is no lag."""
    rng = np.random.default_rng(seed)
    long, short = 9 * rng.standard_normal((ROWS, 1)), 0.1 * rng.standard_normal((ROWS, 1))
    base = regression(100 + seed, -0.4 * long[:, 0])
    signal = Signal(of=("sensor:y",), changed=lambda _, values: values, start={"lag.tau": 1.0})
    lag = Candidate(place="p", family="friction", physics="sensor_lag", signals=(signal,))
    for looks in ([short, long], [long, short]):
        (kept,) = screen(base, [look(columns, lag) for columns in looks]).found
        assert np.array_equal(kept.look.columns.squares, long)
        assert kept.estimate == pytest.approx([0.4], abs=0.1)


def test_the_chance_of_a_gain_is_an_upper_limit_and_near_to_what_draws_give():
    rng = np.random.default_rng(0)
    looks = [look(rng.standard_normal((ROWS, n))) for n in (1, 1, 1, 2, 2, 3)]
    tops = []
    for seed in range(2000):
        tops.append(screen(regression(1000 + seed), looks).found)
    gains = np.array([max(s.gain for s in found) for found in tops])
    judge = screen(regression(0), looks)
    for chance in (0.3, 0.1, 0.05):
        seen = np.mean(gains > judge.chance.needed(chance))
        assert 0.6 * chance - 0.01 < seen < chance + 3 * np.sqrt(chance / len(gains))
        assert judge.chance.of(judge.chance.needed(chance)) == pytest.approx(chance, rel=1e-6)
    assert judge.chance.of(1e-9) == pytest.approx(1.0, abs=0.01)


def test_two_names_of_one_effect_are_alike_and_others_are_as_their_angle():
    rng = np.random.default_rng(0)
    S, T = rng.standard_normal((ROWS, 1)), rng.standard_normal((ROWS, 1))
    pair = rng.standard_normal((ROWS, 2))
    base = regression(0, -S[:, 0])
    within = base.J @ rng.standard_normal((4, 1))  # what the parameters can take over makes no difference
    found = screen(base, [look(S), look(-3 * S + within), look(T), look(pair), look(pair @ [[1.0, 2.0], [0.5, -1.0]])])
    by = {id(s.look): s for s in found.found}
    one, same, other, two, turned = (
        next(s for s in by.values() if np.array_equal(s.look.columns.squares, columns))
        for columns in (S, -3 * S + within, T, pair, pair @ [[1.0, 2.0], [0.5, -1.0]])
    )
    assert found.alike(one, same) == pytest.approx(1.0)
    assert found.alike(two, turned) == pytest.approx(1.0)
    Q, _ = np.linalg.qr(base.J)
    a, b = (x[:, 0] - Q @ (Q.T @ x[:, 0]) for x in (S, T))
    assert found.alike(one, other) == pytest.approx(abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b))
    assert found.alike(one, two) == 0.0  # one number cannot stand for two


def test_what_parameters_can_take_over_wholly_is_not_told():
    base = regression(0)
    found = screen(base, [look(base.J @ np.ones((4, 1))), look(np.random.default_rng(1).standard_normal((ROWS, 1)))])
    assert len(found.found) == 1
    assert found.chance.looks == {1: 1}


def test_a_strength_that_is_told_once_counts_once():
    S = np.random.default_rng(1).standard_normal((ROWS, 1))
    base = regression(0, -S[:, 0])
    (twice,) = screen(base, [look(np.column_stack([S, 2 * S]))]).found
    (once,) = screen(base, [look(S)]).found
    assert twice.freedom == 1
    assert twice.gain == pytest.approx(once.gain)


def test_of_a_strength_of_which_a_part_is_not_told_there_is_no_deviation():
    S = np.random.default_rng(1).standard_normal((ROWS, 2))
    base = regression(0)
    (found,) = screen(base, [look(np.column_stack([S[:, 0], S[:, 0], 1e6 * S[:, 1]]))]).found
    assert found.freedom == 2
    assert np.isinf(found.std[:2]).all()
    (alone,) = screen(base, [look(S)]).found
    assert found.std[2] == pytest.approx(1e-6 * alone.std[1])


def test_every_shape_is_there_and_one_that_shows_nothing_has_no_deviation():
    S = np.random.default_rng(1).standard_normal((ROWS, 1))
    c, untold = (Candidate(place="p", family="friction", physics=name, strengths=("a",)) for name in ("x", "y"))
    looks = [look(size * S, c) for size in (1.0, 0.0, 3.0)]
    found = screen(regression(0, -S[:, 0]), [*looks, look(np.zeros((ROWS, 1)), untold)])
    (best,) = found.found
    first, none, larger = found.shapes[id(c)]
    assert [s.look for s in (first, none, larger)] == looks
    assert np.isinf(none.std[0])
    assert larger.std[0] == pytest.approx(first.std[0] / 3) == pytest.approx(best.std[0] * (1 if best.look is larger.look else 1 / 3))
    assert [np.isinf(s.std[0]) for s in found.shapes[id(untold)]] == [True]


def test_gain_of_some_columns_and_a_screen_of_nothing():
    S = np.random.default_rng(1).standard_normal((ROWS, 3))
    base = regression(0, S[:, 0])
    scores = base.scores(look(S).columns)
    assert gain(scores, [0, 2]) == pytest.approx(screen(base, [look(S[:, [0, 2]])]).found[0].gain)
    nothing = screen(base, [])
    assert nothing.found == ()
    assert nothing.chance.of(1.0) == 0.0
    assert nothing.chance.needed(0.05) == 0.1
    assert isinstance(nothing, Screen)


@dataclass(frozen=True)
class WithForces(Regression):
    """A regression whose first rows are residual forces of two places."""

    @property
    def residual_forces(self) -> Columns:
        own = np.zeros((ROWS, 2))
        own[:20, 0], own[20:40, 1] = self.r[:20], self.r[20:40]
        return Columns(squares=own, multiplied=np.zeros((0, 2)))


def test_a_parameter_that_only_scales_what_is_left_over_is_no_suspect_however_much_that_gains():
    plain = regression(0)
    base = WithForces(r=plain.r, J=plain.J)
    forces = base.residual_forces.squares
    within = plain.J @ np.ones((4, 1))  # what trajectories and parameters make up for
    parameter = Candidate(place="body", family="parameter", physics="wrong_parameter", strengths=("body.m",))
    scaling = look(forces @ [[0.7], [0.7]] + within, parameter)
    assert base.scores(scaling.columns).b ** 2 / base.scores(scaling.columns).G[0] > 20
    other = look(forces[:, :1] + 0.5 * np.random.default_rng(1).standard_normal((ROWS, 1)), parameter)
    friction = look(forces[:, :1])
    assert told(base, [scaling, other, friction]) == [other, friction]
    assert told(plain, [friction]) == [friction]


def memory(seed: int, rows: int, r: float) -> np.ndarray:
    """Of unit variance, with correlation r from row to row."""
    e = np.random.default_rng(seed).standard_normal(rows)
    for k in range(1, rows):
        e[k] = r * e[k - 1] + np.sqrt(1 - r * r) * e[k]
    return e


@pytest.mark.parametrize("r", [0.0, 0.9])
def test_a_gain_is_worth_what_it_is_beside_residuals_that_have_a_memory(r):
    rows, slow = 2000, look(np.sin(np.linspace(0, 9, 2000))[:, None])
    J = np.random.default_rng(0).standard_normal((rows, 3))
    found = [screen(Regression(r=memory(seed, rows, r), J=J), [slow]).found[0] for seed in range(400)]
    likely = chi2.isf(0.05, 1) / 2
    plain, worth = (np.mean([getattr(s, word) > likely for s in found]) for word in ("gain", "worth"))
    assert worth < 0.12  # 25 parts tell a variance to a quarter, and with a memory a little less of it
    assert bool(plain > 0.5) is (r > 0)
    # the variance of a sum of an autoregression is (1 + r)/(1 - r) times that of white noise; parts of 80 rows miss some of it
    assert 0.75 < np.mean([s.inflation for s in found]) / ((1 + r) / (1 - r)) < 1.15


def test_what_explains_all_that_is_left_is_worth_all_of_its_gain_and_what_stands_for_it_here_and_not_there_less():
    t = np.linspace(0, 40, 4000)
    right = np.sign(np.sin(t))
    alike = right * (t / 40 - 0.2)
    J = np.random.default_rng(0).standard_normal((len(t), 3))
    base = Regression(r=np.random.default_rng(1).standard_normal(len(t)) - 0.7 * right, J=J)
    true, false = screen(base, [look(right[:, None]), look(alike[:, None])]).found
    assert true.estimate == pytest.approx([0.7], abs=0.06)
    assert true.inflation < 1.8
    assert false.gain > 100
    assert false.inflation > 5


def test_scores_in_two_threads_are_those_in_one():
    """Of a machine, whose factorisation both use at once."""
    problem, result, base = smoothed()
    looks = looked_at(problem, problem.model, base, library(problem, problem.model, result.solution))
    one, two = (screen(base, looks, late(base, looks), threads=threads) for threads in (1, 2))
    assert [s.candidate.key for s in one.found] == [s.candidate.key for s in two.found]
    assert [(s.gain, s.inflation, *s.estimate) for s in one.found] == [(s.gain, s.inflation, *s.estimate) for s in two.found]
    assert np.array_equal(one.chance.most, two.chance.most)
