"""The library of a problem: every rival is in it, under names that exist, and nothing that the study itself frees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import posed, run, smoothed
from neutral import Point

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.edits import Insert
from backsight.estimation.diagnosis.candidates.library import _kinematic, _said, _tilting, _uneven, library
from backsight.estimation.diagnosis.search.choice import plainness
from backsight.models import Model, Parameter, compile_model
from backsight.models.mechanics.rotational import AngleSensor, Gear, Inertia, Rack
from backsight.models.mechanics.translational import Mass
from backsight.models.plants import quadrotor


@pytest.fixture(scope="module")
def axis() -> tuple:
    problem, result, _ = smoothed(0.5)
    return problem, result, library(problem, problem.model, result.solution)


def test_every_fault_and_law_that_an_axis_can_have_is_there(axis):
    *_, found = axis
    there = {c.key for c in found}
    laws = ["viscous", "coulomb", "stribeck", "logarithmic", "asymmetric", "position_dependent"]
    expected = {("carriage", f"{w}_friction") for w in laws}
    expected |= {("carriage", w) for w in ("cogging", "spring", "cubic_spring", "quadratic_drag", "constant_force", "added_mass")}
    expected |= {("input:F", f"input_{w}") for w in ("gain", "offset", "lag", "delay", "saturation", "dead_zone")}
    expected |= {("sensor:x", f"sensor_{w}") for w in ("gain", "bias", "drift", "lag", "delay")}
    expected |= {("screw", "compliance"), ("screw", "backlash"), ("carriage", "end_stop")}
    assert expected <= there


def test_all_that_is_told_of_a_law_is_estimated(axis):
    """A number of the library's own would be told as one of the machine's."""
    *_, found = axis
    laws = [c for c in found if not c.signals]
    assert {c.key: set(c.named.values()) - {*c.strengths, *c.start} for c in laws} == {c.key: set() for c in laws}


def test_a_parameter_is_a_suspect_while_it_is_fixed_and_not_nothing():
    made = run(0.3)
    for given, suspects in ((Free(90.0), set()), (90.0, {"carriage.m"})):
        problem = posed(made, carriage__m=given)
        found = library(problem, problem.model, smooth(problem).solution)
        wrong = {name for c in found if c.physics == "wrong_parameter" for name in c.strengths}
        assert wrong == suspects  # friction.f_c and offset.f are absent, not wrong


@pytest.mark.parametrize(("given", "is_said"), [(0.0, True), (90.0, False), (Free(90.0), False)])
def test_a_mass_that_the_study_says_is_nothing_is_doubted_before_numbers_of_the_model(axis, given, is_said):
    problem, _, found = axis
    problem = replace(problem, parameters={**problem.parameters, "carriage.m": given})
    added, spring = (_said(next(c for c in found if c.physics == word), problem, problem.model) for word in ("added_mass", "spring"))
    default = Candidate(place="screw", family="parameter", physics="wrong_parameter", strengths=("screw.k",))
    assert (plainness(added, [0.0]) < plainness(default, [0.0])) is is_said
    assert plainness(spring, [0.0]) > plainness(default, [0.0])


@pytest.mark.parametrize(("suspects", "together"), [(("Ixx", "Iyy", "Izz"), True), (("Ixx", "Izz"), False)])
def test_moments_of_inertia_about_the_axes_of_a_tilt_are_doubted_together_too(suspects, together):
    """Unless one of them is free, and so no suspect."""

    def doubted(name: str) -> Candidate:
        start, place = {name: (0.02, 0.002, 0.2)}, {"place": "body", "family": "parameter", "physics": "wrong_parameter"}
        return Candidate(**place, strengths=(name,), start=start, named={name: name}, stated=name == "body.Iyy")

    found = _tilting(quadrotor(), [doubted(f"body.{word}") for word in suspects])
    assert [c.strengths for c in found] == [("body.Ixx", "body.Iyy")] * together
    for c in found:
        assert (c.key, c.stated, c.start.keys(), c.named) == (
            ("body", "wrong_parameter", "body.Ixx", "body.Iyy"),
            True,
            {*c.strengths},
            {n: n for n in c.strengths},
        )


def test_a_drift_is_counted_from_where_the_recording_begins():
    """On a clock that began long before, it would be a bias."""
    problem = posed(run(0.3))
    (axis,) = problem.recordings
    late = replace(problem, recordings=[replace(axis, time=axis.time + 1e5)])
    found = library(late, late.model, smooth(late).solution)
    drifts = [edit.component for c in found if c.physics == "sensor_drift" for edit in c.edits if isinstance(edit, Insert)]
    assert [d.parameters["t_0"] for d in drifts] == [pytest.approx(1e5, abs=1e-6)]


def test_a_body_that_an_output_reads_directly_is_no_sensor():
    """A mass that is 15 % wrong is a suspect, whether an encoder stands between or not."""
    problem = posed(run(0.3), carriage__m=80.0)
    model = replace(problem.model, outputs={"x": "carriage.s"})
    found = library(replace(problem, model=model), model, smooth(replace(problem, model=model)).solution)
    assert {n for c in found if c.physics == "wrong_parameter" for n in c.strengths} == {"carriage.m"}


def test_a_law_takes_over_what_a_parameter_of_the_model_stands_for():
    """The axis's own friction, free, under names of the model's own: two dampers and one of each direction would be one too many."""
    problem = posed(run(0.5, f_c=20.0), friction__f_c=Free(15.0))
    own = {"level": Parameter("N", 15.0, min=0.0), "damping": Parameter("N.s/m", 190.0, min=0.0)}
    model = replace(problem.model, parameters=own, bindings={"friction.f_c": "level", "friction.d": "damping"})
    free = {"carriage.m": Free(90.0), "level": Free(15.0), "damping": Free(190.0), "offset.f": 0.0}
    renamed = replace(problem, model=model, parameters=free)
    names = {"friction.f_c": "level", "friction.d": "damping"}
    plain, bound = (library(p, p.model, smooth(p).solution) for p in (problem, renamed))
    assert {c.key for c in plain if c.absorbs} >= {("carriage", f"{w}_friction") for w in ("asymmetric", "stribeck", "presliding")}
    expected = [(c.key, {names[n]: by for n, by in c.absorbs.items()}) for c in plain]
    assert [(c.key, dict(c.absorbs)) for c in bound] == expected


@pytest.mark.parametrize("r", [0.03, -0.03])
def test_a_wheel_may_be_off_its_centre_whichever_way_it_turns_its_belt(r):
    model = Model(
        name="belt",
        components={"wheel": Inertia(J=1e-3), "belt": Rack(r=r), "slide": Mass(m=1.0)},
        connections=(("wheel.flange", "belt.wheel"), ("belt.rack", "slide.flange")),
        inputs={},
        outputs={"s": "slide.s"},
    )
    (c,) = _kinematic(model, {"belt.r": r})
    guess, low, high = c.start["belt.amplitude"]
    assert low < guess < high == pytest.approx(0.009)


def servo(*, side: str, behind: bool = True) -> Model:
    """An arm behind a gear of ratio 50. side: the body whose angle is the state; behind: whether an arm is there, or only its encoder."""
    parts = {"rotor": Inertia(J=1e-4), "gearbox": Gear(ratio=50.0), "encoder": AngleSensor()} | ({"arm": Inertia(J=0.2)} if behind else {})
    joined = [("rotor.flange", "gearbox.flange_a"), ("gearbox.flange_b", "encoder.flange")]
    return Model(
        name="servo",
        components=parts,
        connections=[*joined, *([("gearbox.flange_b", "arm.flange")] if behind else [])],
        outputs={"motor": "rotor.phi", "load": "encoder.phi"},
        states=(f"{side}.phi", f"{side}.omega"),
    )


@pytest.mark.parametrize("side", ["rotor", "arm"])
def test_a_gear_may_wave_whichever_side_tells_the_angle_of_the_other(side):
    model = servo(side=side)
    (c,) = _uneven(model, {"gearbox.ratio": 50.0})
    assert (c.key, c.family) == (("gearbox", "kinematic_error"), "transmission")
    amplitude, order, phase = (c.named[word] for word in ("amplitude", "order", "phase"))
    assert c.shapes == {order: (1.0, 2.0, 50.0, 100.0)}
    base, dae = compile_model(model), compile_model(c.edited(model))
    assert [q.name for q in dae.states] == [q.name for q in base.states] == [f"{side}.phi", f"{side}.omega"]
    for seed in range(3):
        motor, load = Point(base, seed).told(dae, {amplitude: 0.01, order: 2.0, phase: 0.4})[1]
        known = motor / 50.0 if side == "rotor" else load
        wave = 0.01 * (np.sin(2.0 * known + 0.4) - np.sin(0.4))
        assert motor / 50.0 - load == pytest.approx(-wave if side == "rotor" else wave, rel=1e-9)


def test_a_gear_with_nothing_but_a_sensor_behind_it_is_that_sensors():
    assert _uneven(servo(side="rotor", behind=False), {}) == []


def test_a_law_beside_one_of_the_model_rounds_its_sign_as_that_does():
    """Two widths would tell apart what are two names of one force; asperities have no such name."""
    problem = posed(run(0.3, f_c=20.0), friction__f_c=Free(15.0, min=0.0), friction__width=3.7e-3)
    found = library(problem, problem.model, smooth(problem).solution)
    widths = {
        c.physics: edit.component.parameters["width"]
        for c in found
        if c.place == "carriage" and c.physics.endswith("friction") and c.physics != "presliding_friction"
        for edit in c.edits
        if isinstance(edit, Insert) and edit.component.parameters.get("width")
    }
    assert widths["stribeck_friction"] == 3.7e-3
    assert set(widths.values()) == {3.7e-3}


@pytest.mark.slow
def test_names_in_candidates_are_parameters_of_the_edited_model(axis):
    problem, _, found = axis
    for c in found:
        names = {p.name for p in compile_model(c.edited(problem.model)).parameters}
        for used in (c.strengths, c.start, c.shapes, c.named.values(), [c.quadrature] if c.quadrature else []):
            assert set(used) <= names, c.title


def test_shapes_hang_on_the_motion_that_was_recorded(axis):
    *_, found = axis
    made = run(0.5)
    by = {c.key: c for c in found}
    (velocities,) = by["carriage", "stribeck_friction"].shapes.values()
    assert velocities[-1] == pytest.approx(np.sqrt(np.mean(made.truth["carriage.v"] ** 2)), rel=0.02)
    (periods,) = by["carriage", "cogging"].shapes.values()
    assert max(periods) == pytest.approx(np.ptp(made.truth["carriage.s"]), rel=0.01)


def test_a_candidate_says_what_it_is(axis):
    *_, found = axis
    by = {c.key: c for c in found}
    gain, coulomb, compliance = by["input:F", "input_gain"], by["carriage", "coulomb_friction"], by["screw", "compliance"]
    assert coulomb.title == "coulomb friction at carriage"
    assert [edit.words for edit in coulomb.edits] == ["coulomb_friction_carriage = Friction() at carriage.flange"]
    assert gain.rank < coulomb.rank
    assert by["sensor:x", "sensor_gain"].rank < gain.rank
    assert coulomb.size == 1
    assert by["carriage", "cogging"].size == 3
    assert compliance.dear
    assert by["input:F", "input_lag"].sent.signals == ()


def test_numbers_of_components_that_candidates_brought_are_no_suspects():
    problem = posed(run(0.3), carriage__m=Free(90.0))
    heavier = next(c for c in library(problem, problem.model, smooth(problem).solution) if c.key == ("carriage", "added_mass"))
    now = heavier.edited(problem.model)
    grown = replace(problem, model=now, parameters={**problem.parameters, **dict.fromkeys(heavier.strengths, 2.0)})
    solution = smooth(grown).solution
    (name,) = heavier.brought

    def suspects(brought) -> set:
        return {s.partition(".")[0] for c in library(grown, now, solution, brought) if c.physics == "wrong_parameter" for s in c.strengths}

    assert name in suspects(())
    assert name not in suspects({name})
