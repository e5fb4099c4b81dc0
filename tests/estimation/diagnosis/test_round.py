"""What a round does beside scores and refusals: the model as it is may come to rest better where a fit did; what no output shows."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_axis import posed, run
from examples import soft_drive
from screened import screened

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights
from backsight.estimation.diagnosis.candidates.candidate import Candidate, Kind
from backsight.estimation.diagnosis.scores.chance import Chance
from backsight.estimation.diagnosis.scores.screen import Screen, Screened
from backsight.estimation.diagnosis.search.choice import sound
from backsight.estimation.diagnosis.search.elimination import Bare
from backsight.estimation.diagnosis.search.fits import Base, Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.late_signals import late_as_another, late_unheard
from backsight.estimation.diagnosis.search.refit import QUICKLY, Fitted, worth_of
from backsight.estimation.diagnosis.search.round import Round, _gained
from backsight.estimation.smoothing.smoother import smoothing


def begun(problem: Problem, result: Smoothing) -> Round:
    """The scores beside a smoothed model."""
    fits = Fits(pool=ThreadPoolExecutor(1), ahead=1, kept=Keep(None, problem), say=lambda _: None, end=inf)
    base = Base(problem=problem, model=problem.model, result=result, settings=QUICKLY, changes=())
    return Round.of(base, Bare(problem=problem, model=problem.model), [], (set(), 0.0), fits, 0)


def test_a_model_that_was_left_in_a_worse_valley_goes_where_a_fit_of_nothing_came_to_rest():
    """Nothing is missing: Coulomb friction is fitted as none, and gains all that the model as it is was short of, 50 nats."""
    problem = replace(posed(run(1.0, 2e-3)), weights=Weights(W={"carriage": 0.02}))
    result = smoothing(problem, settings=QUICKLY)
    scored, right = begun(problem, result), worth_of(problem, result, weighed=True)
    short = replace(right, nats=right.nats - 50.0)
    friction = next(s for s in scored.found.found if s.candidate.physics == "coulomb_friction")
    scored._fit([(friction.candidate, friction)], short)
    assert 40 < scored.fitted[0][2].gain < 50
    nearer = scored._from_a_fit(short, [])
    assert nearer is not None
    assert nearer.result.solver.converged
    assert nearer.model is problem.model
    assert np.isclose(worth_of(problem, nearer.result, weighed=True).nats, right.nats, atol=0.1)
    good = [(c, s, replace(f, gain=45.0)) for c, s, f in scored.fitted]
    assert scored._from_a_fit(short, good) is None  # what was borne out is about as good


def test_a_model_that_came_to_rest_stays():
    problem = replace(posed(run(1.0, 2e-3)), weights=Weights(W={"carriage": 0.02}))
    result = smoothing(problem, settings=QUICKLY)
    scored, now = begun(problem, result), worth_of(problem, result, weighed=True)
    friction = next(s for s in scored.found.found if s.candidate.physics == "coulomb_friction")
    scored._fit([(friction.candidate, friction)], now)
    assert scored._from_a_fit(now, []) is None


def test_what_is_not_looked_for_has_no_score():
    made = run(1.0, 2e-3, force=lambda t, _, v: -5.0 * np.sign(v) * (t > 0.5))
    problem = replace(posed(made), weights=Weights(W={"carriage": 0.02}))
    result = smoothing(problem, settings=QUICKLY)
    whole = begun(problem, result)
    friction = next(c for c in whole.candidates if c.physics == "coulomb_friction")
    late = friction.since(0.5)

    def looked_at(*gone: Candidate) -> set[Kind]:
        scored = Round.of(whole.base, whole.bare, [], (set(), 0.0), whole.fits, 0, {c.kind for c in gone})
        return {s.candidate.kind for s in scored.found.found if s.candidate.key == friction.key}

    assert looked_at() == {late.kind, friction.kind}
    assert looked_at(late) == {friction.kind}
    assert looked_at(friction) == set()


def test_a_plain_law_is_fitted_from_where_a_richer_one_came_to_rest_whose_peak_is_not_told():
    problem = posed(run(2.0, 2e-3, f_c=2.0))
    result = smoothing(problem, settings=QUICKLY)
    scored, now = begun(problem, result), worth_of(problem, result, weighed=True)
    stribeck, coulomb = (next(c for c in scored.candidates if c.physics == f"{law}_friction") for law in ("stribeck", "coulomb"))
    scored._fit([(stribeck, next(s for s in scored.found.found if s.candidate.key == stribeck.key))], now)
    (rich,) = scored.fitted
    assert not (sound(*rich[::2]) and np.isfinite(rich[2].gain))
    ((plain, there),) = scored._plainer_than_fitted()
    assert plain.key == coulomb.key
    ((c, s, f),) = _gained(scored.fits.candidates(replace(scored.base, result=there), [(plain, None)]), now)
    assert sound(c, f)
    assert f.gain > 1000
    assert f.result.parameters[c.strengths[0]].value == pytest.approx(2.0, rel=0.02)
    scored.fitted.append((c, s, f))
    assert scored._plainer_than_fitted() == []  # it came there by itself


def test_a_delay_whose_fit_was_lost_is_fitted_from_where_a_lag_came_to_rest():
    """A sensor that is three samples late."""
    made = run(1.0)
    x = made.outputs["x"]
    problem = posed(replace(made, outputs={"x": np.concatenate([np.full(3, x[0]), x[:-3]])}))
    result = smoothing(problem, settings=QUICKLY)
    scored, now = begun(problem, result), worth_of(problem, result, weighed=True)
    lag, delay = (next(s for s in scored.found.found if s.candidate.physics == f"sensor_{word}") for word in ("lag", "delay"))
    scored._fit([(lag.candidate, lag)], now)
    (first,) = scored.fitted
    assert np.isfinite(first[2].gain)
    scored.fitted.append((delay.candidate, delay, Fitted(candidate=delay.candidate, failed="lost")))
    ((again, there),) = late_as_another(scored.fitted)
    assert again.candidate is delay.candidate
    assert again.look.shape["sensor_delay_x.delay"] == first[2].result.parameters["sensor_lag_x.tau"].value
    ((c, _, f),) = _gained(scored.fits.candidates(replace(scored.base, result=there), [(again.candidate, again)]), now)
    assert f.result.parameters["sensor_delay_x.delay"].value == pytest.approx(3e-3, rel=0.02)
    assert f.gain > first[2].gain
    assert "delay" in c.title
    scored.fitted[1] = c, delay, f
    assert [s.candidate.physics for s, _ in late_as_another(scored.fitted)] == ["sensor_lag"]  # now that one is tried from there


@pytest.mark.parametrize(("f_c", "is_fitted"), [(20.0, True), (0.0, False)])
def test_where_a_late_input_is_likely_and_leaves_much_over_late_sensors_are_fitted_whatever_their_scores(f_c: float, is_fitted: bool):
    """A sensor that is three samples late; nothing tells it from an input that is, unless friction is missing, too."""
    made = run(1.0, f_c=f_c)
    x = made.outputs["x"]
    problem = posed(replace(made, outputs={"x": np.concatenate([np.full(3, x[0]), x[:-3]])}), W={})
    result = smoothing(problem, settings=QUICKLY)
    scored, now = begun(problem, result), worth_of(problem, result, weighed=True)
    late = next(s for s in scored.found.found if s.candidate.physics == "input_delay")

    def asked():
        return late_unheard(scored.fitted, scored.candidates, scored.found, scored.sizes.most)

    scored._fit([(late.candidate, late)], now)
    scored.fitted = [(c, s, replace(f, gain=1.1 * late.gain)) for c, s, f in scored.fitted]
    assert [c.physics for c in asked()] == ["sensor_delay"] * is_fitted  # it brings what its score promised, and leaves as much over
    scored.fitted = [(c, s, replace(f, gain=0.9 * late.gain)) for c, s, f in scored.fitted]
    assert [c.physics for c in asked()] == ["sensor_delay"] * is_fitted
    scored.fitted = [(c, s, Fitted(candidate=c, failed="lost")) for c, s, _ in scored.fitted]
    assert [c.physics for c in asked()] == ["sensor_delay"]
    better = screened("carriage", "viscous_friction", 2.0 * late.gain)
    scored.fitted.append((better.candidate, better, Fitted(candidate=better.candidate, failed="lost")))
    assert asked() == []


def test_fits_anew_begin_at_the_guesses_that_were_given():
    problem = posed(run(0.2, 2e-3))
    scored = begun(problem, smoothing(problem, settings=QUICKLY))
    moved = {name: replace(free, guess=2 * free.guess) for name, free in problem.parameters.items() if isinstance(free, Free)}
    scored.base = replace(scored.base, problem=replace(problem, parameters={**problem.parameters, **moved, "friction.f_c": Free(1.0)}))
    guessed = scored._as_guessed.problem.parameters
    assert guessed == {**problem.parameters, "friction.f_c": Free(0.0)}  # nobody gave that: where it is


def screen(*found: Screened) -> Screen:
    return Screen(found=found, chance=Chance(looks=Counter({1: len(found)})), G=np.empty((0, 0)), plain=np.empty(0), columns=())


def of_family(family: str, s: Screened) -> Screened:
    return replace(s, look=replace(s.look, candidate=replace(s.candidate, family=family)))


class Asked:
    """Fits that are only asked for."""

    def candidates(self, base, wanted, *, anew):
        assert anew
        self.problem, self.wanted = base.problem, wanted
        return [(c, s, Fitted(candidate=c)) for c, s in wanted]


def test_inside_of_what_no_output_shows_damping_and_parameters_are_fitted_anew_and_what_did_not_come_to_rest():
    """Of a motor that is seen, a shaft, and a load in a bearing that is not."""
    free = {"motor.J": Free(2e-3), "load.J": Free(8e-3), "shaft.k": Free(40.0), "shaft.d": 0.01, "bearing.d": 0.05}
    t = np.linspace(0.0, 1.0, 101)
    recording = Recording(name="run", time=t, inputs={"tau": np.sin(9 * t)}, outputs={"phi": np.sin(9 * t)}, output_std={"phi": 1e-3})
    problem = Problem(model=soft_drive(), recordings=[recording], parameters=free)
    base = Base(problem=problem, model=problem.model, result=SimpleNamespace(parameters={}), settings=QUICKLY, changes=())
    damping, elsewhere = screened("shaft", "damping", 0.1), screened("motor", "damping", 9.0)
    parameters = [of_family("parameter", screened(place, "wrong_parameter", 0.1)) for place in ("shaft", "bearing", "motor")]
    lost, fitted, seen = (screened(place, "quadratic_drag", 9.0) for place in ("load", "load", "motor"))
    found = screen(elsewhere, lost, fitted, seen, damping, *parameters)
    asked = Asked()
    one = Round(
        base=base,
        bare=Bare(problem=problem, model=problem.model),
        fits=asked,
        linearised=None,
        candidates=[],
        found=found,
        sizes=None,
        accepted=[],
        loose=(set(), 0.0),
    )
    one.fitted = [(s.candidate, s, Fitted(candidate=s.candidate, gain=gain)) for s, gain in ((lost, -inf), (fitted, 5.0), (seen, -inf))]
    anew = one._fitted_anew()
    assert [c for c, _ in asked.wanted] == [s.candidate for s in (lost, damping, *parameters[:2])]
    assert [s for _, s in asked.wanted] == [lost, damping, None, None]  # parameters begin at what was given
    assert [s for _, s, _ in anew] == [lost, None, None, None]  # the score of what was likely counts


def test_what_may_hold_an_unseen_body_is_fitted_from_the_guesses_and_all_else_from_where_the_base_came_to_rest(monkeypatch):
    problem = posed(run(0.2, 2e-3))
    scored = begun(problem, smoothing(problem, settings=QUICKLY))
    asked = list[tuple[Base, list, bool]]()

    class Noted:
        def candidates(self, base, wanted, *, anew=False):
            asked.append((base, [(c.key, s is None) for c, s in wanted], anew))
            return [(c, s, Fitted(candidate=c)) for c, s in wanted]

    scored.fits = Noted()
    monkeypatch.setattr("backsight.estimation.diagnosis.search.round.hidden", lambda _: {"load"})
    friction, drag, seen = (screened(*one, 9.0) for one in (("load", "coulomb_friction"), ("load", "drag"), ("motor", "coulomb_friction")))
    fits = scored._judged([(s.candidate, s) for s in (friction, drag, seen)])
    (base, others, rest), (guesses, held, anew) = asked
    assert (held, anew) == ([(friction.candidate.key, True)], True)
    assert guesses.problem.parameters == problem.parameters
    assert (others, rest) == ([(drag.candidate.key, False), (seen.candidate.key, False)], False)
    assert base is scored.base
    assert [s for _, s, _ in fits] == [drag, seen, None]  # no score tells what the first is worth


def test_of_two_fits_of_one_candidate_each_keeps_its_own_numbers():
    """A lag may be fitted from its own start and from where a delay came to rest."""
    problem = replace(posed(run(1.0, 2e-3, f_c=20.0)), weights=Weights(W={"carriage": 0.02}))
    result = smoothing(problem, settings=QUICKLY)
    scored, now = begun(problem, result), worth_of(problem, result, weighed=True)
    friction = next(s for s in scored.found.found if s.candidate.physics == "coulomb_friction")
    scored._fit([(friction.candidate, friction)], now)
    ((c, s, f),) = scored.fitted
    worse = replace(f, gain=f.gain - 100.0)
    scored.fitted = [(c, s, f), (c, s, worse)]
    best = scored._kept([(c, s, worse), (c, s, f)])
    assert best.judged[2].gain == f.gain
    assert [fit.gain for _, _, fit in scored.fitted] == [f.gain, worse.gain]


def test_the_date_of_a_change_is_sought_anew_beside_its_fit():
    """A damper that is stronger from 1.2 s on, dated a tenth of a second off."""
    problem = posed(run(2.0, 2e-3, force=lambda t, _, v: -120.0 * v * (t > 1.2)))
    result = smoothing(problem, settings=QUICKLY)
    scored, now = begun(problem, result), worth_of(problem, result, weighed=True)
    s = next(s for s in scored.found.found if s.candidate.changes and s.candidate.subject == ("friction.d",))
    off = s.look.whole.candidate.since(1.1)
    off_there = replace(s, look=replace(s.look, candidate=off))
    (best,) = _gained(scored.fits.candidates(scored.base, [(off, off_there)]), now)
    c, _, f = scored._set_in(best)
    assert c.onset == pytest.approx(1.2, abs=0.02)
    (name,) = c.strengths
    assert f.result.parameters[name].value == pytest.approx(120.0, rel=0.05)
    assert f.gain > best[2].gain
