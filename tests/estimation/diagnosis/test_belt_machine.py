"""A machine of a user's own: a motor moves a slide by a stiff belt, with an encoder at either end. Simulated here, in steps of 20 us."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import NOISE, run
from concealed_axis import posed as axis

from backsight.estimation import Diagnosis, Free, Problem, Recording, diagnose, smooth
from backsight.estimation.diagnosis.evidence.misfit import OFF, off
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.models import Model, Output
from backsight.models.errors import InputError
from backsight.models.mechanics.rotational import AngleSensor, Inertia, Rack, RotationalDamper, RotationalFixed, Torque
from backsight.models.mechanics.translational import Damper, Fixed, Mass, PositionSensor, SpringDamper

J, B, R, K, D, M, D_S = 1.2e-3, 2e-3, 0.0159155, 2.2e5, 150.0, 6.0, 25.0
STEP, SAMPLE = 2e-5, 1e-3


def machine(*, rigid: bool = False) -> Model:
    """rigid: as somebody declares it who takes the belt for part of the pulley."""
    whole = Model(
        name="belt_slide",
        components={
            "source": Torque(), "motor": Inertia(J=1e-3), "bearing": RotationalDamper(d=1e-3), "housing": RotationalFixed(),
            "pulley": Rack(r=R), "belt": SpringDamper(k=2e5, d=150.0), "slide": Mass(m=5.0), "guide": Damper(d=20.0), "bed": Fixed(),
            "encoder": AngleSensor(), "scale": PositionSensor(),
        },
        connections=[
            ("source.flange", "motor.flange"), ("motor.flange", "bearing.flange_a"), ("bearing.flange_b", "housing.flange"),
            ("motor.flange", "pulley.wheel"), ("pulley.rack", "belt.flange_a"), ("belt.flange_b", "slide.flange"),
            ("slide.flange", "guide.flange_a"), ("guide.flange_b", "bed.flange"), ("encoder.flange", "motor.flange"),
            ("scale.flange", "slide.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "encoder.phi", "s": "scale.s"},
    )  # fmt: skip
    if not rigid:
        return whole
    components = {name: one for name, one in whole.components.items() if name != "belt"}
    stay = [(a, b) for a, b in whole.connections if "belt." not in a + b]
    return replace(whole, components=components, connections=[*stay, ("pulley.rack", "slide.flange")])


def recorded(friction: float, seed: int, role: str, *, k: float = K, late: int = 0) -> Recording:
    """Two seconds of a controlled motion to and fro; Coulomb friction [N] at the slide, as an impulse that no step exceeds.

    k: of the belt [N/m]; late: samples by which the scale reads what was.
    """
    rng, per = np.random.default_rng(seed), round(SAMPLE / STEP)
    rates, sizes = rng.uniform(0.5, 3.0, 3), rng.uniform(0.01, 0.04, 3)
    phi = omega = s = v = 0.0
    rows = []
    for row in range(2000):
        wanted = float(np.sum(sizes * (1.0 - np.cos(2 * np.pi * rates * row * SAMPLE))))
        torque = 6.0 * (wanted / R - phi) - 0.06 * omega
        rows.append((torque, phi, s))
        for _ in range(per):
            force = k * (R * phi - s) + D * (R * omega - v)
            omega += STEP * (torque - B * omega - R * force) / J
            v += STEP * (force - D_S * v) / M
            v -= float(np.clip(v, -friction * STEP / M, friction * STEP / M))
            phi, s = phi + STEP * omega, s + STEP * v
    given, turned, moved = np.array(rows).T
    moved = np.concatenate([np.zeros(late), moved[: len(moved) - late]])
    counts, fine = 2 * np.pi / 8192, 5e-6
    outputs = {
        "phi": np.round(turned / counts) * counts,
        "s": np.round((moved + 4e-6 * rng.standard_normal(len(moved))) / fine) * fine,
    }
    return Recording(name=role, role=role, time=np.arange(2000) * SAMPLE, inputs={"tau": given}, outputs=outputs)


def posed(*recordings: Recording) -> Problem:
    positive = {"motor.J": 8e-4, "bearing.d": 1e-3, "belt.k": 1e5, "belt.d": 100.0, "slide.m": 4.0, "guide.d": 10.0}
    free = {name: Free(guess, min=guess / 100.0) for name, guess in positive.items()}
    return Problem(model=machine(), recordings=recordings, parameters=free)


def posed_rigid(*recordings: Recording) -> Problem:
    """The motor's inertia and its bearing are known: with a rigid belt the slide's are not told from them."""
    free = {"slide.m": Free(4.0, min=0.1), "guide.d": Free(10.0, min=0.1)}
    return Problem(model=machine(rigid=True), recordings=recordings, parameters={"motor.J": J, "bearing.d": B, **free})


def diagnosed(friction: float) -> Diagnosis:
    return diagnose(posed(recorded(friction, 1, "fit"), recorded(friction, 2, "held_out")))


@pytest.mark.slow
def test_friction_behind_a_stiff_belt_is_found_though_the_belts_stiffness_times_its_way_is_a_thousand_times_as_much():
    found = diagnosed(7.0)
    (finding,) = found.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("slide", "coulomb_friction")
    strength = finding.explanation.parameters["f_c"]
    assert strength.value == pytest.approx(7.0, rel=0.02)
    assert found.held_out is not None
    assert found.held_out.improvement_percent > 80
    assert found.held_out.p_value < 0.05
    assert found.model.components["slide"].parameters["m"] == pytest.approx(M, rel=0.02)


@pytest.mark.slow
def test_the_same_machine_is_silent_where_nothing_is_missing():
    assert diagnosed(0.0).verdict == "none"


@pytest.mark.slow
def test_a_belt_that_was_taken_for_rigid_is_found_where_two_encoders_contradict_each_other():
    """All that a rigid belt leaves is what the encoders are off, a hundred times their steps; forces are left over only with the belt."""
    found = diagnose(posed_rigid(recorded(7.0, 1, "fit"), recorded(7.0, 2, "held_out")))
    belt, friction = found.findings
    assert (belt.explanation.place, belt.explanation.physics) == ("pulley", "compliance")
    assert belt.explanation.parameters["k"].value == pytest.approx(K, rel=0.02)
    assert (friction.explanation.place, friction.explanation.physics) == ("slide", "coulomb_friction")
    assert friction.explanation.parameters["f_c"].value == pytest.approx(7.0, rel=0.02)
    assert found.held_out is not None
    assert found.held_out.improvement_percent > 90


@pytest.mark.slow
@pytest.mark.long
def test_a_scale_that_is_late_beside_a_rigid_belt_is_no_soft_one():
    found = diagnose(posed_rigid(*(recorded(0.0, seed, role, k=1e8, late=3) for seed, role in ((1, "fit"), (2, "held_out")))))
    (finding,) = found.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("sensor:s", "sensor_delay")
    assert "sensor_delay_s.x_1" in found.repaired.initial  # what it holds at first
    assert finding.explanation.parameters["delay"].value == pytest.approx(3 * SAMPLE, rel=0.02)


def test_what_outputs_are_off_beside_their_noise_tells_that_they_contradict_each_other():
    soft, stiff = (posed_rigid(recorded(0.0, 1, "fit", k=k)) for k in (K, 1e8))
    contradicting, agreeing = (off(p, smooth(p, settings=QUICKLY), contradicting=True) for p in (soft, stiff))
    assert contradicting > 2 * OFF
    assert agreeing < 1.5


def test_an_output_alone_contradicts_nothing_however_far_off_it_is():
    """Coulomb friction that an axis' model lacks, its residual force held far too tightly."""
    tight = axis(run(1.0, 2e-3, f_c=20.0), W={"carriage": 1e-3})
    result = smooth(tight, settings=QUICKLY)
    assert result.fit["axis"]["x"].rms > 3 * OFF * NOISE
    assert off(tight, result, contradicting=True) == 0.0
    assert off(tight, result) > OFF


def test_an_output_that_is_noisier_than_its_sensor_is_declared_contradicts_nothing():
    problem = posed_rigid(recorded(0.0, 1, "fit", k=1e8))
    fine = replace(problem.model, outputs={"phi": "encoder.phi", "s": Output("scale.s", noise_std=1e-7)})
    problem = replace(problem, model=fine)
    assert off(problem, smooth(problem, settings=QUICKLY), contradicting=True) < 1.5


DEGREES = 180.0 / np.pi


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "said"),
    [
        pytest.param(
            lambda y: {"phi": DEGREES * y["phi"], "s": y["s"]},
            'phi is 0.01745 times what its column says, as of "deg" read as "rad"',
            marks=pytest.mark.long,
        ),
        pytest.param(lambda y: {"phi": y["s"], "s": y["phi"]}, "the columns of phi and s are exchanged", marks=pytest.mark.long),
        (lambda y: {"phi": y["phi"], "s": -y["s"]}, "s has the other sign: negate the column of s"),
    ],
)
def test_columns_that_no_such_machine_could_have_are_told_from_what_they_may_be(read, said):
    made = recorded(0.0, 1, "fit")
    with pytest.raises(InputError) as error:
        diagnose(posed(replace(made, outputs=read(made.outputs))))
    assert said in str(error.value)
