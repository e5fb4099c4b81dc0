"""What speaks against a fit that brought enough evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_axis import posed, run
from screened import screened

from backsight.estimation import Free, Recording, Smoothing, Weights, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate, Signal
from backsight.estimation.diagnosis.candidates.channels import of_sensor
from backsight.estimation.diagnosis.candidates.edits import Since
from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, Motion, of_law
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.evidence.worth import Worth
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import Screen, screen
from backsight.estimation.diagnosis.scores.shares import FLOOR, Sizes
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.refit import Fitted
from backsight.estimation.diagnosis.search.refit import posed as having
from backsight.estimation.diagnosis.search.refusals import (
    Beside,
    creeping,
    misleading,
    one_way,
    refining,
    slight,
    stands_in,
    trifling,
    unyielding,
    why_not,
)
from backsight.models.plants import actuator


@pytest.mark.parametrize(("already", "left", "out"), [(2, 0.9, True), (2, 0.5, False), (1, 0.9, False)])
def test_a_third_law_of_one_family_has_to_take_as_much_as_matters_from_what_is_left(already, left, out):
    def result(rms: float) -> SimpleNamespace:
        return SimpleNamespace(residual_places={"carriage": SimpleNamespace(rms=rms)})

    words = ("coulomb_friction", "asymmetric_friction")
    accepted = [Candidate(place="carriage", family="friction", physics=w, strengths=(w,)) for w in words[:already]]
    c = Candidate(place="carriage", family="friction", physics="logarithmic_friction", strengths=("log.b",))
    sizes = SimpleNamespace(forces={"carriage": 60.0})  # 1 % of which are 0.6
    assert trifling(c, Fitted(candidate=c, result=result(left)), accepted, result(1.0), sizes) is out


@pytest.mark.parametrize(("family", "dear"), [("actuator", False), ("friction", False), ("transmission", True)])
def test_a_fault_of_an_input_or_a_coupling_with_which_more_is_left_over_explains_nothing(family, dear):
    """Coulomb friction of 20 N and an input read 40 % too large or right, smoothed without the friction; W as the data have it."""
    made = run(1.0, 2e-3, f_c=20.0)
    right = posed(made, W={})
    wrong = replace(right, recordings=[replace(r, inputs={"F": 1.4 * r.inputs["F"]}) for r in right.recordings])
    wrong = replace(wrong, parameters={**wrong.parameters, "carriage.m": 95.0})
    fits = []
    for problem in (right, wrong):
        result = smooth(problem)
        assert result.solution is not None
        candidate = Candidate(place="input:F", family=family, physics="input_gain", dear=dear)
        fitted = Fitted(candidate=candidate, problem=problem, result=result, worth=Worth(nats=0.0, solution=result.solution))
        fits.append((candidate, fitted, Sizes(problem, result, Linearised(result.solution))))
    (c, better, small), (_, worse, large) = fits
    assert misleading(c, worse, small) is (family == "actuator" or dear)
    assert misleading(c, better, large) is False


def test_forces_that_had_no_room_are_known_by_a_fault_with_which_outputs_are_not_off():
    """An input that is 60 N too large, at a W that has no room for that: with its offset known the force at the axis is what there is."""
    made = run(1.0, 2e-3, f_c=20.0)
    problem = posed(made, W={"carriage": 1e-4})
    shifted = replace(problem, recordings=[replace(r, inputs={"F": 60.0 + r.inputs["F"]}) for r in problem.recordings])
    before = smooth(shifted)
    candidate = Candidate(place="input:F", family="actuator", physics="input_offset")
    sizes = Sizes(shifted, before, Linearised(before.solution))
    known = replace(shifted, parameters={**shifted.parameters, "offset.f": 60.0}, weights=Weights(W={"carriage": 1.0}))
    after = smooth(known)
    assert sizes.off > 3.0
    fitted = Fitted(candidate=candidate, problem=known, result=after, worth=Worth(nats=0.0, solution=after.solution))
    assert not misleading(candidate, fitted, sizes)
    sizes.off = 0.0
    assert misleading(candidate, fitted, sizes)


@pytest.mark.parametrize(("gap", "is_nothing"), [(5e-5, True), (0.01, False)])
def test_play_that_hardly_unloads_its_shaft_is_none(gap, is_nothing):
    told = {name: SimpleNamespace(name=name, value=value) for name, value in (("shaft.gap", gap), ("shaft.k", 60.0))}
    c = Candidate(place="shaft", family="transmission", physics="backlash", start={"shaft.gap": (gap, 0, 1)}, named={"gap": "shaft.gap"})
    sizes = SimpleNamespace(forces={"motor": 2.5, "load": 2.5})
    assert slight(c, None, Fitted(candidate=c, result=SimpleNamespace(parameters=told)), sizes) is is_nothing


@pytest.mark.parametrize(("value", "is_nothing"), [(1.8, True), (2.2, False), (-2.2, False)])
@pytest.mark.parametrize("physics", ["viscous_friction", "input_dead_zone"])
def test_what_its_fit_leaves_hardly_anything_of_is_none(physics, value, is_nothing):
    """At its score, with 2 of the strength, it was 1 % of the forces."""
    zone = physics == "input_dead_zone"
    s = screened("carriage", physics, 50.0)
    path = "zone.width" if zone else s.candidate.strengths[0]
    more = (
        {"signals": (Signal(of=("input:F",), changed=np.add, start={path: 2.0}),), "named": {"width": path}, "strengths": ()}
        if zone
        else {}
    )
    c = replace(s.candidate, **more)
    s = replace(s, look=replace(s.look, candidate=c, shape={path: 2.0} if zone else {}), estimate=np.array([0.7 if zone else 2.0]))
    sizes = SimpleNamespace(shares=lambda _, strength: {"carriage": 0.01 * float(strength[0]) / (1.0 if zone else 2.0)})
    told = {path: SimpleNamespace(name=path, value=abs(value) if zone else value)}
    assert slight(c, s, Fitted(candidate=c, result=SimpleNamespace(parameters=told)), sizes) is is_nothing


@pytest.mark.parametrize(("size", "is_nothing"), [(0.8, True), (1.2, False)])
@pytest.mark.parametrize("waves", [False, True])
def test_a_law_of_several_strengths_or_a_wave_has_the_same_floor(size, is_nothing, waves):
    """By what its fit made of it: 1 % of the forces at a size of one."""
    s = screened("carriage", "viscous_friction", 50.0)
    own = {"strengths": ("wave.amplitude",), "quadrature": "wave.phase", "named": {"period": "wave.period"}}
    c = replace(s.candidate, start={}, **(own if waves else {"strengths": ("law.b", "law.c")}))
    told = {"wave.amplitude": size, "wave.phase": 0.3} if waves else {"law.b": 0.0, "law.c": size}
    result = SimpleNamespace(parameters={name: SimpleNamespace(name=name, value=value) for name, value in told.items()})
    sizes = SimpleNamespace(shares=lambda _, strengths: {"carriage": FLOOR * float(np.linalg.norm(strengths))})
    s = replace(s, look=replace(s.look, candidate=c), estimate=np.array([5.0, 5.0]))
    assert slight(c, s, Fitted(candidate=c, result=result), sizes) is is_nothing


@pytest.mark.parametrize(
    ("family", "value", "is_nothing"), [("parameter", 0.055, False), ("parameter", 0.0595, True), ("inertia", 0.055, True)]
)
def test_a_parameter_that_is_plainly_wrong_is_never_slight(family, value, is_nothing):
    s = screened("rotor", "wrong_parameter", 50.0)
    c = replace(s.candidate, family=family, strengths=("rotor.tau",), start={"rotor.tau": (0.06, 0.0, 1.0)})
    sizes = SimpleNamespace(shares=lambda _, strength: {"rotor": 0.004 * float(np.abs(strength[0]))})
    fit = Fitted(candidate=c, result=SimpleNamespace(parameters={"rotor.tau": SimpleNamespace(name="rotor.tau", value=value)}))
    assert slight(c, replace(s, look=replace(s.look, candidate=c)), fit, sizes) is is_nothing


@pytest.mark.parametrize(("value", "is_nothing"), [(0.8, True), (1.8, True), (2.2, False)])
def test_an_effect_has_to_be_as_large_as_the_floor_whenever_it_sets_in(value, is_nothing):
    s = screened("carriage", "viscous_friction", 50.0)
    s = replace(s, estimate=np.array([2.0]))
    late = replace(s.candidate, edits=(*s.candidate.edits, Since(time=1.0, before=())))
    assert late.onset == 1.0
    sizes = SimpleNamespace(shares=lambda _, strength: {"carriage": FLOOR * float(strength[0]) / 2.0})
    told = {s.candidate.strengths[0]: SimpleNamespace(name=s.candidate.strengths[0], value=value)}
    for c in (s.candidate, late):
        fit = Fitted(candidate=c, result=SimpleNamespace(parameters=told))
        assert slight(c, replace(s, look=replace(s.look, candidate=c)), fit, sizes) is is_nothing


@pytest.mark.parametrize(("force", "left", "is_one"), [(0.35, 0.004, True), (0.35, 0.3, False), (0.02, 0.001, False)])
def test_a_constant_force_that_was_not_left_over_takes_the_place_of_another(force, left, is_one):
    """Of a body that hovers, where forces vary by 0.015 N: one that was left over was missing, and a small one may be."""
    s = screened("body.f_z", "constant_force", 50.0)
    before = SimpleNamespace(residual_places={"body.f_z": SimpleNamespace(rms=left), "body.f_x": SimpleNamespace(rms=0.006)})
    varying = {"body.f_x": 0.03, "body.f_z": 0.015}
    sizes = SimpleNamespace(varying=varying, shares=lambda _, a: {"body.f_x": 0.0, "body.f_z": abs(float(a[0])) / varying["body.f_z"]})
    told = {s.candidate.strengths[0]: SimpleNamespace(value=-force)}
    fit = Fitted(candidate=s.candidate, result=SimpleNamespace(parameters=told))
    assert stands_in(s.candidate, s, fit, before, sizes) is is_one
    other = screened("body.f_z", "viscous_friction", 50.0)
    told = {other.candidate.strengths[0]: SimpleNamespace(value=-force)}
    assert not stands_in(other.candidate, other, replace(fit, result=SimpleNamespace(parameters=told)), before, sizes)


@pytest.fixture(scope="module")
def with_friction() -> tuple[Smoothing, Sizes, Screen, list[Candidate]]:
    """An axis whose model has the Coulomb friction of 20 N that it has."""
    problem = posed(run(2.0, 2e-3, f_c=20.0), W={"carriage": 0.05})
    problem = replace(problem, parameters={**problem.parameters, "friction.f_c": Free(15.0, min=0.0)})
    result = smooth(problem)
    assert result.solution is not None
    base, candidates = Linearised(result.solution), library(problem, problem.model, result.solution)
    found = screen(base, looked_at(problem, problem.model, base, candidates))
    return result, Sizes(problem, result, base), found, candidates


@pytest.mark.parametrize(("f_s", "is_it"), [(20.3, True), (30.0, False)])
def test_a_law_that_hardly_differs_from_that_which_is_at_work_refines_nothing(with_friction, f_s, is_it):
    result, sizes, found, candidates = with_friction
    c = next(c for c in candidates if c.key == ("carriage", "stribeck_friction"))
    s = found.shapes[id(c)][len(found.shapes[id(c)]) // 2]
    told = {name: SimpleNamespace(value=value) for name, value in zip(c.strengths, (20.0, f_s), strict=True)}
    fit = Fitted(candidate=c, result=SimpleNamespace(parameters=told))
    assert refining(c, s, fit, result, sizes, found) is is_it
    without = SimpleNamespace(parameters={**result.parameters, "friction.f_c": SimpleNamespace(value=0.0)})
    assert refining(c, s, fit, without, sizes, found) is False


@pytest.mark.parametrize(("d_minus", "is_it"), [(230.0, False), (1e5, True)])
def test_viscous_friction_steeper_than_the_rounded_sign_is_how_that_creeps(with_friction, d_minus, is_it):
    """20 N over about 1 % of the velocity are 2e4 N s/m."""
    result, _, _, candidates = with_friction
    c = next(c for c in candidates if "d_minus" in c.named)
    told = {name: SimpleNamespace(value=value) for name, value in zip(c.strengths, (190.0, d_minus), strict=True)}
    worth = Worth(nats=0.0, solution=result.solution)
    assert creeping(c, Fitted(candidate=c, result=SimpleNamespace(parameters=told), worth=worth)) is is_it


@pytest.mark.parametrize(("both_ways", "is_it"), [(True, False), (False, True)])
def test_friction_of_a_direction_in_which_nothing_slides_is_not_told(both_ways, is_it):
    """An axis whose velocity is given: the force that this takes with mass, viscous friction and 20 N against the motion is its input."""
    t = np.arange(0.0, 3.0, 1e-3)
    slow, w = 0.0 if both_ways else 0.2, 2 * np.pi * 1.3
    v, a, x = slow + 0.15 * np.sin(w * t), 0.15 * w * np.cos(w * t), slow * t - 0.15 / w * np.cos(w * t)
    force = 95.0 * a + 200.0 * v + 20.0 * np.sign(v)
    outputs = {"x": x + 2e-6 * np.random.default_rng(0).standard_normal(len(t))}
    recording = Recording(name="axis", time=t, inputs={"F": force}, outputs=outputs, output_std={"x": 2e-6}, hold="linear")
    axis = replace(posed(run(0.1), W={"carriage": 0.05}), recordings=[recording])
    (spot,) = bodies(actuator())
    law = next(one for one in AGAINST_GROUND if one.label == "asymmetric_level")
    c = of_law(law, actuator(), spot, Motion(v_rms=0.2, low=-0.1, high=0.1))
    problem, model = having(axis, axis.model, c, {})
    result = smooth(problem)
    fit = Fitted(candidate=c, problem=problem, model=model, result=result, worth=Worth(nats=0.0, solution=result.solution))
    assert result.parameters[f"{c.strengths[0].rpartition('.')[0]}.f_plus"].value == pytest.approx(20.0, abs=1.0)
    assert one_way(c, fit) is is_it
    assert not creeping(c, fit)


def test_friction_that_yields_over_a_short_way_is_weighed_as_a_whole_beside_that_which_is_at_work(with_friction):
    """It is looked at as a signal: no strength tells how much of it there is. A longer way differs from sliding friction by more."""
    result, sizes, found, candidates = with_friction
    c = next(c for c in candidates if c.physics == "presliding_friction")
    fit, (few, many) = Fitted(candidate=c, result=result), (found.shapes[id(c)][k] for k in (0, -1))
    assert refining(c, few, fit, result, sizes, found)
    assert not refining(c, many, fit, result, sizes, found)


@pytest.mark.parametrize(("delay", "is_nothing"), [(4e-5, True), (6e-5, False)])
def test_what_is_late_by_a_twentieth_of_a_sampling_interval_is_on_time(delay, is_nothing):
    (c,) = (c for c in of_sensor(actuator(), "x", [], 1e-3, 1.0, scaled=False, span=None) if c.physics == "sensor_delay")
    told = {name: SimpleNamespace(name=name, value=delay) for name in c.named.values()}
    sizes = SimpleNamespace(forces={"carriage": 60.0})
    assert slight(c, None, Fitted(candidate=c, result=SimpleNamespace(parameters=told)), sizes) is is_nothing


@pytest.mark.parametrize(("way", "is_it"), [(4e-6, True), (2e-5, False)])
def test_asperities_that_yield_by_less_than_samples_tell_are_those_of_coulomb_friction(with_friction, way, is_it):
    """Samples are good to 2 um, and 3 of their deviations tell."""
    result, _, _, candidates = with_friction
    c = next(c for c in candidates if c.physics == "presliding_friction")
    told = {c.named["f_c"]: 20.0, c.named["sigma_0"]: 20.0 / way}
    problem = SimpleNamespace(posed=SimpleNamespace(dae=result.solution.transcription.dae))
    fit = Fitted(candidate=c, problem=problem, result=SimpleNamespace(value=told.get), worth=Worth(nats=0.0, solution=result.solution))
    assert c.absorbs
    assert unyielding(c, fit) is is_it
    assert not unyielding(replace(c, absorbs={}), fit)


def test_what_others_can_do_of_a_force_is_none_of_its_own(with_friction):
    """Of a Coulomb friction of 20 N beside one of 1 N nothing stays; beside nothing it is its rms over that of the forces there."""
    _, sizes, found, candidates = with_friction
    c = next(c for c in candidates if c.key == ("carriage", "coulomb_friction"))
    look = found.shapes[id(c)][0].look
    alone = sizes.net(look, np.array([20.0]), [])
    assert alone == pytest.approx(sizes.shares(look, np.array([20.0]))["carriage"])
    assert alone > 0.1
    assert sizes.net(look, np.array([20.0]), [look]) < 1e-6


@pytest.mark.parametrize(("place", "gain", "told"), [("screw_mass", 28.0, False), ("screw_mass", 100.0, True), ("carriage", 28.0, True)])
def test_what_acts_within_a_coupling_that_was_found_has_to_bring_a_part_of_what_that_did(with_friction, place, gain, told):
    result, sizes, found, _ = with_friction
    s = screened(place, "viscous_friction", gain)
    parameters = {s.candidate.strengths[0]: SimpleNamespace(name="d", value=1.0, std=0.01, unit="N.s/m")}
    fit = Fitted(candidate=s.candidate, result=SimpleNamespace(parameters=parameters, residual_places={}), gain=gain)
    sizes = SimpleNamespace(shares=lambda *_: {place: 0.2}, forces={}, names=[place])
    beside = Beside(accepted=[], result=result, sizes=sizes, found=found, loose={"screw", "screw_mass"}, least=63.5)
    assert (why_not(s.candidate, s, fit, beside) == "") is told
