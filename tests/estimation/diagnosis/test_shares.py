"""Sizes of effects against the forces of the simulator that made the record, and the strengths that would have been seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import posed, run, smoothed

from backsight.estimation import Weights, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.shares import CERTAIN, FLOOR, SURE, Sizes, limits
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.models.plants import actuator


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module")
def axis() -> tuple:
    problem, result, base = smoothed(1.5, 2e-3)
    made = run(1.5, 2e-3)
    looks = looked_at(problem, problem.model, base, library(problem, problem.model, result.solution))
    return made, Sizes(problem, result, base), looks, screen(base, looks)


def test_the_force_at_a_place_is_its_largest_term(axis):
    made, sizes, *_ = axis
    v = made.truth["carriage.v"]
    terms = [rms(made.inputs["F"]), 203.5 * rms(v), 95.109 * rms(np.gradient(v, made.time))]
    assert sizes.forces == {"carriage": pytest.approx(max(terms), rel=0.05)}


@pytest.mark.parametrize(("physics", "of"), [("quadratic_drag", lambda _, v: v * np.abs(v)), ("cubic_spring", lambda x, _: x**3)])
def test_the_share_of_an_effect_is_its_rms_force_over_that(axis, physics, of):
    made, sizes, looks, _ = axis
    look = next(look for look in looks if look.candidate.key == ("carriage", physics))
    force = of(made.truth["carriage.s"], made.truth["carriage.v"])
    assert sizes.shares(look, np.array([7.0])) == {"carriage": pytest.approx(7.0 * rms(force) / sizes.forces["carriage"], rel=0.03)}


@pytest.mark.parametrize("kind", ["ou", "matern"])
def test_sizes_are_the_same_where_the_residual_force_has_a_memory(axis, kind):
    """Its own row has the white noise behind it: forces and effects stand in another one."""
    made, plain, *_ = axis
    problem = posed(made)
    problem = replace(problem, weights=Weights(W={"carriage": 1.0}, tau={"carriage": 0.05}, kind={"carriage": kind}))
    result = smooth(problem)
    base = Linearised(result.solution)
    sizes = Sizes(problem, result, base)
    assert sizes.forces == {"carriage": pytest.approx(plain.forces["carriage"], rel=0.02)}
    assert sizes.left["carriage"] < FLOOR
    look = next(
        look
        for look in looked_at(problem, problem.model, base, library(problem, problem.model, result.solution))
        if look.candidate.key == ("carriage", "quadratic_drag")
    )
    v = made.truth["carriage.v"]
    assert sizes.shares(look, np.array([7.0])) == {"carriage": pytest.approx(7.0 * rms(v * v) / sizes.forces["carriage"], rel=0.03)}


def test_a_sensor_fault_is_no_force(axis):
    _, sizes, looks, _ = axis
    bias = next(look for look in looks if look.candidate.physics == "sensor_bias")
    assert sizes.shares(bias, np.array([1.0])) == {"carriage": pytest.approx(0.0, abs=1e-9)}


def test_little_is_left_over_of_a_model_that_lacks_nothing_and_what_lacks_is(axis):
    _, sizes, *_ = axis
    assert sizes.left["carriage"] < FLOOR
    made = run(1.5, 2e-3, f_c=20.0)
    problem = posed(made, W={"carriage": 0.5})
    result = smooth(problem)
    lacking = Sizes(problem, result, Linearised(result.solution))
    friction = rms(20.0 * np.sign(made.truth["carriage.v"]))
    assert 0.2 * friction < lacking.left["carriage"] * lacking.forces["carriage"] < 1.2 * friction


def test_what_would_have_been_seen_is_a_number_of_deviations_or_the_floor(axis):
    _, sizes, _, found = axis
    least = max(np.sqrt(2 * found.chance.needed(SURE)), CERTAIN)
    out = {(u.place, u.physics): u for u in limits(found, sizes, actuator(), {("carriage", "cogging")})}
    assert ("carriage", "cogging") not in out  # it was found
    assert all(np.isfinite(u.strength) and u.strength > 0 for u in out.values())
    s = next(s for s in found.found if s.candidate.key == ("carriage", "quadratic_drag"))
    one = sizes.shares(s.look, np.ones(1))["carriage"]
    drag = out["carriage", "quadratic_drag"]
    assert drag.strength == pytest.approx(max(least * s.std[0], FLOOR / one))
    assert (drag.parameter, drag.unit) == ("c", "N.s2/m2")
    assert [u for u in out.values() if not u.unit] == []
    bias = out["sensor:x", "sensor_drift"]
    (rate,) = (s.std for s in found.found if s.candidate.physics == "sensor_drift")
    assert bias.strength == pytest.approx(least * rate[0])


def test_limits_are_in_order_one_for_each_parameter_of_an_effect_in_units_of_their_own(axis):
    _, sizes, _, found = axis
    out = limits(found, sizes, actuator(), set())
    places = [u.place for u in out]
    assert places == sorted(places, key=lambda place: (":" in place, place))
    which = [(u.place, u.physics, u.parameter, u.unit) for u in out]
    assert len(set(which)) == len(which)
    stops = [s.candidate for s in found.found if s.candidate.key == ("carriage", "end_stop")]
    assert len(stops) > 1  # on either side
    assert next(u.unit for u in out if u.physics == "sensor_drift") == "m/s"


@pytest.mark.parametrize(("signal", "rate"), [("m", "m/s"), ("rad/s", "rad/s2"), ("m/s2", "m/s3"), ("N.m", "N.m/s"), ("", "/s")])
def test_a_rate_has_the_unit_of_its_signal_per_second(signal, rate):
    drift = Candidate(place="sensor:y", family="sensor", physics="sensor_drift")
    assert drift.said("/s", {"y": signal}) == rate
    assert drift.said("", {"y": signal}) == signal
    assert drift.said("s", {"y": signal}) == "s"


def test_what_would_have_been_seen_hangs_on_the_shape_in_the_middle_not_on_that_of_most_gain(axis):
    _, sizes, looks, found = axis
    c = next(look.candidate for look in looks if look.candidate.key == ("carriage", "stribeck_friction"))
    shapes = [s for s in (screen(sizes.base, [look], draws=0).found for look in looks if look.candidate is c) if s]
    stds = sorted(float(s[0].std[-1]) for s in shapes)
    assert stds[-1] > 2 * stds[0]  # it matters
    strength = {(u.place, u.physics): u.strength for u in limits(found, sizes, actuator(), set())}["carriage", "stribeck_friction"]
    least = max(np.sqrt(2 * found.chance.needed(SURE)), CERTAIN)
    best = next(s for s in found.found if s.candidate is c)
    middle = next(s.look for s in found.shapes[id(c)] if s.std[-1] == pytest.approx(stds[len(stds) // 2], rel=1e-6))
    floor = FLOOR / sizes.shares(middle, np.eye(len(best.std))[-1])["carriage"]
    assert strength == pytest.approx(max(least * stds[len(stds) // 2] * np.sqrt(best.inflation), floor))


def test_a_force_that_acts_where_the_machine_never_was_has_no_least_strength(axis, monkeypatch):
    """It would be next to nothing wherever the machine was, and have to be more than anything."""
    _, sizes, _, found = axis
    monkeypatch.setattr(Sizes, "shares", lambda *_: {"carriage": 1e-30})
    weak = [replace(s, std=1e9 * s.std) for s in found.found if s.candidate.physics == "stribeck_friction"]
    shapes = {id(s.candidate): [replace(one, std=1e9 * one.std) for one in found.shapes[id(s.candidate)]] for s in weak}
    (told,) = limits(replace(found, found=weak, shapes=shapes), sizes, actuator(), set())
    assert (told.physics, told.strength) == ("stribeck_friction", np.inf)


def test_the_least_lag_dead_zone_and_saturation_are_those_between_one_that_shows_and_one_that_does_not(axis):
    _, sizes, looks, found = axis
    out = {(u.place, u.physics): u for u in limits(found, sizes, actuator(), set())}
    least = max(np.sqrt(2 * found.chance.needed(SURE)), CERTAIN)
    for key, grows in {
        ("input:F", "input_lag"): True,
        ("input:F", "input_delay"): True,
        ("input:F", "input_dead_zone"): True,
        ("input:F", "input_saturation"): False,
        ("sensor:x", "sensor_delay"): True,
    }.items():
        inflation = next(s.inflation for s in found.found if s.candidate.key == key)
        here = [look for look in looks if look.candidate.key == key]
        shown, hidden = list[float](), list[float]()
        for look in here:
            (s,) = screen(sizes.base, [look], draws=0).found or (None,)
            (value,) = look.shape.values()
            matters = key[0].startswith("sensor") or max(sizes.shares(look, np.ones(1)).values()) > FLOOR
            told = s is not None and least * s.std[0] * np.sqrt(inflation) < 1.0
            (shown if told and matters else hidden).append(value)
        assert shown  # each of them at its largest
        near, far = (min(shown), max(hidden, default=0.0)) if grows else (max(shown), min(hidden, default=np.inf))
        assert min(near, far) <= out[key].strength <= max(near, far), key
        assert out[key].unit == {"input_lag": "s", "input_delay": "s", "sensor_delay": "s"}.get(key[1], "N")


def test_an_effect_at_its_limit_is_seen_and_one_at_a_tenth_of_it_is_not(axis):
    _, sizes, _, found = axis
    drag = next(u for u in limits(found, sizes, actuator(), set()) if u.physics == "quadratic_drag")
    gains = []
    for strength in (0.1 * drag.strength, 2.0 * drag.strength):
        made = run(1.5, 2e-3, force=lambda _t, _q, v, c=strength: -c * v * np.abs(v))
        problem = posed(made)
        result = smooth(problem)
        c = [c for c in library(problem, problem.model, result.solution) if c.key == ("carriage", "quadratic_drag")]
        base = Linearised(result.solution)
        gains.append(screen(base, looked_at(problem, problem.model, base, c)).found[0].gain)
    needed = found.chance.needed(SURE)
    assert gains[0] < needed < gains[1]
