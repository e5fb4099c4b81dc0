"""An arm behind a gear that was declared as rigid, with no coupling in the model; simulated here, in steps of 10 us."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording, diagnose
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.couplings import of_ideal, of_soft
from backsight.estimation.diagnosis.candidates.edits import Exchange, Insert
from backsight.estimation.diagnosis.candidates.laws import Motion
from backsight.estimation.diagnosis.candidates.places import elements
from backsight.estimation.diagnosis.search.elimination import Bare
from backsight.estimation.diagnosis.search.standing import Standing
from backsight.models import Model, compile_model
from backsight.models.analysis.linearise import linearise
from backsight.models.mechanics.rotational import (
    AngleSensor,
    EccentricRack,
    Gear,
    Inertia,
    RotationalDamper,
    RotationalFixed,
    RotationalFriction,
    Torque,
)
from backsight.models.plants import PLANTS

J_MOTOR, J_ARM, RATIO, D_ARM = 4e-6, 6e-3, 40.0, 0.05
MOTION = Motion(v_rms=2.0, low=-0.5, high=0.5)
STEP, PER = 1e-5, 100
MASSES = {"rotor": J_MOTOR, "arm": 5e-3}


def machine() -> Model:
    return Model(
        name="geared",
        components={
            "source": Torque(), "rotor": Inertia(J=J_MOTOR), "gear": Gear(ratio=RATIO), "arm": Inertia(J=5e-3),
            "bearing": RotationalDamper(d=0.02), "housing": RotationalFixed(), "encoder": AngleSensor(),
        },
        connections=[
            ("source.flange", "rotor.flange"), ("rotor.flange", "gear.flange_a"), ("gear.flange_b", "arm.flange"),
            ("arm.flange", "bearing.flange_a"), ("bearing.flange_b", "housing.flange"), ("rotor.flange", "encoder.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "encoder.phi"},
    )  # fmt: skip


def hanging(moment: float, seed: int, role: str) -> Recording:
    """A multisine torque for two seconds on rigid teeth; the arm's weight hangs beside its axis: moment [N.m] at a quarter turn."""
    rng = np.random.default_rng(seed)
    rates, sizes, phases = rng.uniform(0.4, 2.0, 4), rng.uniform(0.002, 0.005, 4), rng.uniform(0, 6, 4)
    J = J_MOTOR + J_ARM / RATIO**2
    phi = omega = 0.0
    rows = []
    for n in range(2000):
        torque = float(np.sum(sizes * np.sin(2 * np.pi * rates * n * 1e-3 + phases)))
        rows.append((torque, phi))
        for _ in range(PER):
            omega += STEP * (torque - D_ARM * omega / RATIO**2 - moment * np.sin(phi / RATIO) / RATIO) / J
            phi += STEP * omega
    return encoded(rows, role)


def recorded(k: float, d: float, seed: int, role: str) -> Recording:
    """A multisine torque for two seconds; the teeth give way by their torque over k [N.m/rad]."""
    rng = np.random.default_rng(seed)
    rates, sizes, phases = rng.uniform(0.4, 9.0, 5), rng.uniform(0.001, 0.003, 5), rng.uniform(0, 6, 5)
    phi = omega = theta = turning = 0.0
    rows = []
    for n in range(2000):
        torque = float(np.sum(sizes * np.sin(2 * np.pi * rates * n * 1e-3 + phases)))
        rows.append((torque, phi))
        for _ in range(PER):
            between = k * (phi / RATIO - theta) + d * (omega / RATIO - turning)
            omega += STEP * (torque - between / RATIO) / J_MOTOR
            turning += STEP * (between - D_ARM * turning) / J_ARM
            phi, theta = phi + STEP * omega, theta + STEP * turning
    return encoded(rows, role)


def encoded(rows: list[tuple[float, float]], role: str) -> Recording:
    """Torque and angle at the motor as an encoder has them."""
    given, turned = np.array(rows).T
    counts = 2 * np.pi / 4000
    return Recording(
        name=role, role=role, time=np.arange(2000) * 1e-3, inputs={"tau": given}, outputs={"phi": np.round(turned / counts) * counts}
    )


def test_a_gear_between_two_bodies_may_be_soft_or_loose_where_nothing_behind_it_is_yet():
    found = of_ideal(machine(), "gear", lambda _: MOTION, MASSES, {})
    assert {(c.place, c.physics, c.family) for c in found} == {("gear", "compliance", "transmission"), ("gear", "backlash", "transmission")}
    for c in found:
        states = {q.name for q in compile_model(c.edited(machine())).states}
        assert len(states) == 4  # an angle and a speed more than the two of the rigid machine
    rigid = of_ideal(found[0].edited(machine()), "gear", lambda _: MOTION, MASSES, {})
    assert rigid == []  # there is one now


def test_the_gears_of_the_plants_have_couplings_behind_them_or_no_body_before_them():
    for make in PLANTS.values():
        model = make()
        for name, component in model.components.items():
            if isinstance(component, Gear):
                assert of_ideal(model, name, lambda _: MOTION, dict.fromkeys(model.components, 1.0), {}) == []


def soft_then_loose() -> tuple[Candidate, Candidate]:
    """Teeth that give way, found first, and play that takes their place."""
    soft = next(c for c in of_ideal(machine(), "gear", lambda _: MOTION, MASSES, {}) if c.physics == "compliance")
    there = soft.edited(machine())
    (spot,) = (one for one in elements(there) if one.name == "gear_coupling")
    loose = of_soft(there, spot, MOTION, MASSES, {"gear_coupling.k": 60.0, "gear_coupling.d": 0.05})
    return soft, next(c for c in loose if c.physics == "backlash")


def test_play_in_the_place_of_teeth_that_give_way_stands_in_the_declared_model_alone():
    soft, loose = soft_then_loose()
    assert loose.replaces(soft)
    whole = loose.instead_of(soft)
    assert whole.place == "gear"
    alone, after = whole.edited(machine()), loose.edited(soft.edited(machine()))
    assert alone.components == after.components
    assert set(map(frozenset, alone.connections)) == set(map(frozenset, after.connections))
    assert {"gear_coupling.gap", "gear_coupling.k", "gear_coupling.d"} == set(whole.start)
    assert whole.named == loose.named


def test_a_model_is_put_together_anew_with_what_it_has_whatever_was_found_first():
    """What was found in the coupling before it was known for loose comes after what brings the coupling."""
    soft, loose = soft_then_loose()
    problem = Problem(model=machine(), recordings=[recorded(60.0, 0.05, 1, "fit")], parameters={"arm.J": Free(5e-3)})
    rubbing = Candidate(
        place="gear_coupling",
        family="friction",
        physics="coulomb_friction",
        edits=(Insert(place="gear_coupling", component=RotationalFriction(), name="rubbing"),),
        strengths=("rubbing.tau_c",),
    )
    result = SimpleNamespace(parameters={"k": SimpleNamespace(name="gear_coupling.k", value=61.0)})
    bare = Bare(problem=problem, model=machine())
    posed, model = bare.having([rubbing, loose.instead_of(soft)], problem, result)
    assert posed.parameters["gear_coupling.k"].guess == 61.0
    assert {"rubbing.tau_c", "gear_coupling.gap", "gear_coupling.d", "arm.J"} == {*posed.parameters} - {"gear_coupling.k"}
    assert "rubbing" in model.components
    assert bare.having([rubbing, loose], problem, result) is None  # nothing brings the coupling


def test_a_finding_without_a_component_of_its_own_is_not_exchanged():
    """A radius that is wrong beside a wheel that is off its centre: the wheel has the radius, too."""
    radius = Candidate(
        place="pulley", family="parameter", physics="wrong_parameter", strengths=("pulley.r",), named={"pulley.r": "pulley.r"}
    )
    wheel = Candidate(
        place="motor",
        family="periodic",
        physics="eccentricity",
        edits=(Exchange(name="pulley", component=EccentricRack()),),
        strengths=("pulley.amplitude",),
        named={"amplitude": "pulley.amplitude"},
    )
    assert not wheel.replaces(radius)
    assert not wheel.exchanges(radius)


def test_no_model_is_put_together_of_components_that_it_does_not_have():
    """Teeth in two sections, then play in the first: with the play first both sections would have it."""
    soft, loose = soft_then_loose()
    there = soft.edited(machine())
    (spot,) = (one for one in elements(there) if one.name == "gear_coupling")
    section = next(c for c in of_soft(there, spot, MOTION, MASSES, {"gear_coupling.k": 60.0}) if c.physics == "compliance")
    model = loose.edited(section.edited(there))
    problem = Problem(model=machine(), recordings=[recorded(60.0, 0.05, 1, "fit")], parameters={"arm.J": Free(5e-3)})
    result = SimpleNamespace(parameters={}, residual_places={})
    standing, bare = Standing(problem=problem, model=model, result=result), Bare(problem=problem, model=machine())
    names = {type(model.components[n]) for n in ("gear_coupling", "gear_coupling_2")}
    assert len(names) == 2
    assert standing.having([section, loose.instead_of(soft)], bare) is None
    assert standing.having([soft, section, loose], bare) is not None


def test_a_soft_gear_resonates_where_its_guess_says():
    """At 8 or 30 Hz, with the motor's inertia seen from the arm."""
    c = next(c for c in of_ideal(machine(), "gear", lambda _: MOTION, MASSES, {"gear.ratio": RATIO}) if c.physics == "compliance")
    k = c.start["gear_coupling.k"][0]
    dae = compile_model(c.edited(machine()))
    x0 = {q.name: 0.0 for q in dae.states}
    found = np.abs(np.linalg.eigvals(linearise(dae, x0, {"tau": 0.0}).A).imag).max()
    assert found == pytest.approx(np.sqrt(k * (1 / (J_MOTOR * RATIO**2) + 1 / 5e-3)), rel=0.01)
    assert found == pytest.approx(2 * np.pi * 8.0, rel=0.01)


@pytest.mark.slow
def test_teeth_that_give_way_are_found():
    k, d = 60.0, 0.05
    free = {"arm.J": Free(5e-3, min=1e-5), "bearing.d": Free(0.03, min=0.0)}
    found = diagnose(Problem(model=machine(), recordings=[recorded(k, d, 1, "fit"), recorded(k, d, 2, "held_out")], parameters=free))
    first = found.findings[0].explanation
    assert (first.place, first.physics) == ("gear", "compliance")
    assert first.parameters["k"].value == pytest.approx(k, rel=0.03)
    assert found.held_out is not None
    assert found.held_out.improvement_percent > 50


@pytest.mark.slow
def test_the_weight_of_an_arm_is_found_though_a_spring_is_nearly_the_same():
    moment, free = 0.25, {"arm.J": Free(5e-3, min=1e-5), "bearing.d": Free(0.03, min=0.0)}
    runs = [hanging(moment, seed, role) for seed, role in ((1, "fit"), (2, "held_out"))]
    assert 1.0 < np.ptp(runs[0].outputs["phi"]) / RATIO < 6.0
    found = diagnose(Problem(model=machine(), recordings=runs, parameters=free))
    (finding,) = found.findings
    first = finding.explanation
    assert (first.place, first.physics, first.family) == ("arm", "gravity", "potential")
    assert first.parameters["tau_sin"].value == pytest.approx(moment, rel=0.02)
    assert abs(first.parameters["tau_cos"].value) < 0.01 * moment
    assert found.held_out is not None
    assert found.held_out.improvement_percent > 50
