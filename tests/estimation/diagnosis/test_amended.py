"""What is asked of what was found: an effect that is nothing beside a later one, held inputs, levels of friction, what is late."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from concealed_axis import posed, run
from diagnoses import found
from scipy.signal import lfilter

from backsight.estimation import Free, Weights, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.channels import of_input, of_sensor
from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, Motion, of_law
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.search.amended import eliminate, held_again, late_by_both, of_one_level
from backsight.estimation.diagnosis.search.elimination import Bare
from backsight.estimation.diagnosis.search.fits import Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.refit import HELD, QUICKLY, settled
from backsight.estimation.diagnosis.search.refit import posed as having
from backsight.estimation.diagnosis.search.search import Search
from backsight.estimation.diagnosis.search.standing import Standing
from backsight.estimation.smoothing.smoother import smoothing
from backsight.models.plants import actuator

MOTION = Motion(v_rms=0.2, low=-0.05, high=0.05)


def law(name: str) -> Candidate:
    (spot,) = bodies(actuator())
    return of_law(next(one for one in AGAINST_GROUND if (one.label or one.physics) == name), actuator(), spot, MOTION)


def after(spring: float) -> Search:
    """A search that has found a spring first and friction then; in truth there is friction and a spring of so much [N/m3]."""
    bare = posed(run(1.0, 2e-3, force=lambda _, s, __: -spring * s**3, f_c=20.0), W={"carriage": 0.05})
    first, later = law("cubic_spring"), law("coulomb_friction")
    problem, model = bare, bare.model
    for c in (first, later):
        problem, model = having(problem, model, c, {})
    result = smooth(problem, settings=QUICKLY)
    assert result.solver.converged
    search = Search(
        standing=Standing(problem=bare, model=bare.model, result=smooth(bare, settings=QUICKLY)),
        fits=Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=inf),
    )
    both = found(first, 10.0), found(later, 500.0)
    search.standing = Standing(problem=settled(problem, result), model=model, result=result, findings=both, accepted=(first, later))
    return search


def test_what_is_nothing_beside_what_was_found_later_goes_out_again():
    search = after(0.0)
    eliminate(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["coulomb_friction"]
    (friction,) = search.standing.findings
    more = friction.gain - 510.0  # a strength that is nothing costs what any parameter does
    assert 0.0 < more < 0.5 * np.log(search.result.criteria.samples) + 1.0
    assert [(a.physics, a.gap) for a in friction.alternatives] == [("cubic_spring", pytest.approx(500.0 + more))]
    assert "cubic_spring_carriage" not in search.standing.model.components
    assert not any("cubic_spring" in name for name in (*search.problem.parameters, *search.result.parameters))
    f_c = search.result.parameters["coulomb_friction_carriage.f_c"]
    assert abs(f_c.value - 20.0) < 4 * f_c.std < 1.0


def test_what_takes_the_place_of_what_was_found_is_plainer_than_what_mends_that():
    bare = posed(run(1.0, 2e-3, f_c=20.0), W={"carriage": 0.05})
    first = law("cubic_spring")
    problem, model = having(bare, bare.model, first, {})
    result = smooth(problem, settings=QUICKLY)
    search = Search(
        standing=Standing(problem=settled(problem, result), model=model, result=result, findings=(found(first, 10.0),), accepted=(first,)),
        fits=Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=inf),
    )
    scored = search._scored()
    mending, instead = law("spring"), law("coulomb_friction")
    scored._fit([(s.candidate, s) for s in scored.found.found if s.candidate.key in {mending.key, instead.key}], search.now)
    fits = {c.physics: (c, s, f) for c, s, f in scored.fitted}
    _, _, alone = scored._in_the_end(fits["coulomb_friction"])
    assert alone.beside == 0
    assert 0.0 < alone.spared < 0.5 * np.log(result.criteria.samples)
    assert alone.ends_with == alone.gain + alone.spared
    _, _, besides = scored._in_the_end(fits["spring"])
    assert (besides.beside, besides.spared) == (1, 0.0)
    richer = replace(first, absorbs={first.strengths[0]: "another.k"})
    assert richer.replaces(first)
    assert scored._in_the_end((richer, None, fits["spring"][2]))[2].beside == 1  # the law that it takes over is there with it


def test_inputs_are_held_again_where_that_is_better_with_what_was_found():
    """And the model without it is the one with held inputs."""
    search = after(0.0)
    was, now = search.standing, replace(search.problem, recordings=[replace(r, hold="linear") for r in search.problem.recordings])
    search.standing = was.at(now, smooth(now, settings=QUICKLY))
    bare = search.bare.problem
    held = search.held = Standing(problem=bare, model=bare.model, result=smooth(bare, settings=QUICKLY))
    search.bare = replace(search.bare, problem=replace(bare, recordings=now.recordings))
    search.first_weights = Weights(W={"carriage": 9.0})
    held_again(search)
    assert search.held is None
    assert {r.hold for r in search.problem.recordings} == {r.hold for r in search.bare.problem.recordings} == {"zero"}
    assert (search.first, search.first_weights) == (held.result, held.problem.weights)
    assert search.first_left["carriage"] > 0.05  # 20 N of friction
    assert [f.explanation.physics for f in search.standing.findings] == ["cubic_spring", "coulomb_friction"]


def test_what_is_something_beside_it_stays():
    search = after(4e5)  # 50 N at the end of the way
    eliminate(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["cubic_spring", "coulomb_friction"]
    assert "cubic_spring_carriage" in search.standing.model.components


def test_what_a_richer_law_has_taken_over_is_not_in_the_model_in_the_end():
    bare = posed(run(1.0, 2e-3, f_c=20.0), W={"carriage": 0.05})
    first = law("coulomb_friction")
    problem, model = having(bare, bare.model, first, {})
    (spot,) = bodies(model)
    richer = of_law(next(one for one in AGAINST_GROUND if one.physics == "stribeck_friction"), model, spot, MOTION)
    assert "coulomb_friction_carriage.f_c" in richer.absorbs
    problem, model = having(problem, model, richer, {})
    result = smooth(problem, settings=QUICKLY)
    fits = Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=inf)
    search = Search(standing=Standing(problem=bare, model=bare.model, result=smooth(bare, settings=QUICKLY)), fits=fits)
    search.standing = Standing(problem=problem, model=model, result=result, findings=(found(richer, 90.0),), accepted=(richer,))
    search.sizes = Sizes(problem, result, Linearised(result.solution))
    search.on_a_checked_mesh()
    search.renew()
    assert "coulomb_friction_carriage" not in search.standing.model.components
    assert not any("coulomb" in name for name in search.result.parameters)
    assert "coulomb" not in search.standing.findings[0].change
    assert search.result.solver.converged


def test_friction_of_two_levels_is_of_one_beside_a_constant_that_was_found_later():
    """20 N both ways and 8 N always, of which 3 N were found."""
    made = run(1.0, 2e-3, force=lambda _, __, ___: -8.0, f_c=20.0)
    bare = posed(made, W={"carriage": 0.05})
    first = smooth(bare, settings=QUICKLY)
    there = library(bare, bare.model, first.solution)
    levels = next(c for c in there if {"f_plus", "f_minus"} <= c.named.keys() and "d_plus" not in c.named)
    constant = next(c for c in there if c.physics == "constant_force")
    problem, model = having(bare, bare.model, levels, {})
    problem, model = having(problem, model, constant, {constant.strengths[0]: 3.0})
    held = replace(problem, parameters={**problem.parameters, constant.strengths[0]: 3.0})
    result = smooth(held, settings=QUICKLY)
    fits = Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=inf)
    search = Search(standing=Standing(problem=bare, model=bare.model, result=first), fits=fits)
    both = found(levels, 900.0), found(constant, 90.0)
    search.standing = Standing(problem=settled(held, result), model=model, result=result, findings=both, accepted=(levels, constant))
    search.sizes = Sizes(held, result, Linearised(result.solution))
    of_one_level(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["coulomb_friction", "constant_force"]
    level, force = search.result.parameters["coulomb_friction_carriage.f_c"], search.result.parameters[constant.strengths[0]]
    assert abs(level.value - 20.0) < 4 * level.std < 2.0
    assert abs(force.value - 8.0) < 4 * force.std < 2.0
    assert "coulomb" in search.standing.findings[0].change


def read_late(lag: float, delay: int, first: str = "sensor_lag") -> Search:
    """A search that has found a lag of a sensor and a delay then; in truth it lags by so much [s], and so many samples.

    Where it does not lag the search stands at half of that as a lag all the same, or as a delay of the input (first).
    """
    made = run(1.0)
    x = made.outputs["x"]
    if lag:
        kept = np.exp(-1e-3 / lag)
        x = lfilter([0.0, 1.0 - kept], [1.0, -kept], x, zi=[x[0]])[0]
    late = {"x": np.concatenate([np.full(delay, x[0]), x[: len(x) - delay]])}
    bare = posed(replace(made, outputs=late), W={"carriage": 0.02})
    of_either = [
        *of_sensor(actuator(), "x", [], 1e-3, 1.0, scaled=False, span=None),
        *of_input(actuator(), "F", [made.inputs["F"]], 1e-3, 1.0),
    ]
    lags, delays = (next(c for c in of_either if c.physics == word) for word in (first, "sensor_delay"))
    (own,) = lags.named.values()
    half = delay / 2 * 1e-3
    problem, model = having(bare, bare.model, lags, {own: half})
    problem, model = having(problem, model, delays, {"sensor_delay_x.delay": half})
    held = problem if lag else replace(problem, parameters={**problem.parameters, own: half})
    result = smooth(held, settings=QUICKLY)
    fits = Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=inf)
    search = Search(standing=Standing(problem=bare, model=bare.model, result=smooth(bare, settings=QUICKLY)), fits=fits)
    both = found(lags, 900.0), found(delays, 90.0)
    search.standing = Standing(problem=settled(held, result), model=model, result=result, findings=both, accepted=(lags, delays))
    return search


@pytest.mark.parametrize(("first", "late"), [("sensor_lag", 3), ("input_delay", 1)])
def test_a_delay_that_was_half_a_lag_or_half_the_inputs_is_all_of_it(first: str, late: int):
    search = read_late(lag=0.0, delay=late, first=first)
    late_by_both(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["sensor_delay"]
    assert not {"sensor_lag_x", "input_delay_F"} & set(search.standing.model.components)
    delay = search.result.parameters["sensor_delay_x.delay"]
    assert abs(delay.value - 1e-3 * late) < 4 * delay.std < 1e-4


def test_a_lag_beside_which_there_is_a_delay_stays():
    search = read_late(lag=4e-3, delay=3)
    late_by_both(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["sensor_lag", "sensor_delay"]


@pytest.mark.parametrize(("gain", "stays"), [(13.0, False), (500.0, True)])
def test_little_gained_at_held_weights_is_sought_again_with_those_of_the_data(gain: float, stays: bool):
    bare, friction = posed(run(1.0, 2e-3, f_c=20.0)), law("coulomb_friction")
    bare = replace(bare, weights=Weights())
    fits = Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=inf)
    search = Search(standing=Standing(problem=bare, model=bare.model, result=smoothing(bare, settings=HELD)), fits=fits, settings=HELD)
    problem, model = having(bare, bare.model, friction, {})
    search.before, result = search.standing, smoothing(problem, settings=HELD)
    search.standing = Standing(problem=problem, model=model, result=result, findings=(found(friction, gain),), accepted=(friction,))
    assert search._weighed()
    assert search.settings.weigh
    assert ("coulomb_friction_carriage" in search.standing.model.components) is stays
    assert len(search.standing.findings) == len(search.standing.accepted) == stays
    assert (search.first is search.result) is not stays


def test_what_was_taken_back_is_there_again_where_there_was_no_time_to_seek_it():
    bare, friction = replace(posed(run(1.0, 2e-3, f_c=20.0)), weights=Weights()), law("coulomb_friction")
    fits = Fits(pool=ProcessPoolExecutor(1), ahead=1, kept=Keep(None, bare), say=lambda _: None, end=0.0)
    search = Search(standing=Standing(problem=bare, model=bare.model, result=smooth(bare, settings=QUICKLY)), fits=fits)
    problem, model = having(bare, bare.model, friction, {})
    result = smooth(problem, settings=QUICKLY)
    search.aside = Standing(problem=problem, model=model, findings=(found(friction, 60.0),), accepted=(friction,), result=result)
    search.run()
    assert [f.explanation.physics for f in search.standing.findings] == ["coulomb_friction"]
    assert not any("Coulomb friction" in note or "coulomb friction" in note for note in (*search.notes, *search.closing))
    assert search.verdict() == "missing_physics"
    assert "coulomb_friction_carriage" in search.standing.model.components
    assert search.standing.findings[-1].explanation.parameters["f_c"].value == pytest.approx(20.0, rel=0.05)


def test_what_a_later_one_needs_cannot_go():
    problem = posed(run(0.1))
    result = smooth(problem)
    spring = law("cubic_spring")
    on_it = replace(spring, edits=(replace(spring.edits[0], place="cubic_spring_carriage.flange_b"),))
    assert Bare(problem=problem, model=problem.model).having([on_it], problem, result) is None
    assert Bare(problem=problem, model=problem.model).having([], problem, result) == (problem, problem.model)


def test_what_came_free_with_one_that_stays_stays_free():
    """A play's damping is free once the play was kept; without the spring beside it, it still is."""
    problem = posed(run(0.1))
    result, spring, friction = smooth(problem), law("cubic_spring"), law("coulomb_friction")
    width = "coulomb_friction_carriage.width"
    later = replace(friction, later={width: (0.01, 1e-4, 0.1)})
    both, _ = having(*having(problem, problem.model, spring, {}), later, {})
    now = replace(both, parameters={**both.parameters, width: Free(0.02, min=1e-4, max=0.1)})
    kept = Bare(problem=problem, model=problem.model).having([later], now, result)
    assert kept is not None
    assert kept[0].parameters[width] == Free(0.02, min=1e-4, max=0.1)
