"""What may be between a circuit and a shaft, on a motor whose current is measured. The motor is simulated here, by small steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from neutral import Point

from backsight.estimation import Free, Problem, Recording, Weights, diagnose, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.motors import Turning, of_motor
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.smoothing.program import Settings
from backsight.models import Model, compile_model
from backsight.models.electrical import CurrentSensor, DCMotor, ElectricalGround, TorqueMotor, Voltage
from backsight.models.mechanics.rotational import AngleSensor, Inertia, RotationalDamper, RotationalFixed

L, R, K, J, D = 4e-3, 1.5, 0.05, 1e-4, 2e-4
STEP, PER, ROWS = 2e-3, 400, 1000
STD = {"i": 5e-3, "phi": 2e-4}
TURNING = Turning(current=2.0, speed=50.0, span=6.0, interval=2e-3)


def machine() -> Model:
    return Model(
        name="servo",
        components={
            "amplifier": Voltage(), "meter": CurrentSensor(), "motor": DCMotor(L=L, R=R, Km=K), "zero": ElectricalGround(),
            "rotor": Inertia(J=J), "bearing": RotationalDamper(d=D), "housing": RotationalFixed(), "encoder": AngleSensor(),
        },
        connections=[
            ("amplifier.p", "meter.p"), ("meter.n", "motor.p"), ("motor.n", "amplifier.n"), ("amplifier.n", "zero.pin"),
            ("motor.flange", "rotor.flange"), ("rotor.flange", "bearing.flange_a"), ("bearing.flange_b", "housing.flange"),
            ("encoder.flange", "rotor.flange"),
        ],
        inputs={"u": "amplifier.v"},
        outputs={"i": "meter.i", "phi": "encoder.phi"},
    )  # fmt: skip


def recorded(seed: int, role: str = "fit", *, lost: float = 0.0, wave: float = 0.0, b: float = 0.0) -> Recording:
    """Two seconds of smooth voltages. lost: at the brushes [V]; wave: of the motor constant, six times a turn; b: saturation."""
    rng = np.random.default_rng(seed)
    rates, sizes, phases = rng.uniform(0.5, 6.0, 6), rng.uniform(0.5, 1.5, 6), rng.uniform(0, 6, 6)
    i = phi = omega = 0.0
    rows, h = [], STEP / PER
    for n in range(ROWS):
        u = float(np.sum(sizes * np.sin(2 * np.pi * rates * n * STEP + phases)))
        rows.append((u, i + STD["i"] * rng.normal(), phi + STD["phi"] * rng.normal()))
        for _ in range(PER):
            at = K * (1 + wave * np.cos(6 * phi)) / np.sqrt(1 + b * i * i)
            i += h * (u - R * i - at * omega - lost * np.tanh(i / 0.01)) / L
            omega += h * (at * i - D * omega) / J
            phi += h * omega
    u, i_read, phi_read = np.array(rows).T
    read = {"i": i_read, "phi": phi_read}
    return Recording(name=role, role=role, time=np.arange(ROWS) * STEP, inputs={"u": u}, outputs=read, output_std=STD)


def posed(**concealed: float) -> Problem:
    free = {
        "motor.L": Free(3e-3, min=1e-5), "motor.R": Free(2.0, min=0.01), "motor.Km": Free(0.06, min=1e-4),
        "rotor.J": Free(1.3e-4, min=1e-7), "bearing.d": Free(1e-4, min=0.0),
    }  # fmt: skip
    return Problem(model=machine(), recordings=[recorded(1, **concealed), recorded(2, "held_out", **concealed)], parameters=free)


def offered(name: str, turning: Turning | None = TURNING, model: Model | None = None) -> dict[str, Candidate]:
    return {c.physics: c for c in of_motor(model or machine(), name, lambda _: turning, {})}


def test_without_strength_they_change_nothing():
    at = Point(compile_model(machine()))
    for c in offered("motor").values():
        assert np.concatenate(at.told(compile_model(c.edited(machine())))) == pytest.approx(np.concatenate(at.told())), c.title


def test_a_motor_that_stood_still_or_is_none_has_none():
    assert offered("motor", None) == {}
    assert offered("motor", Turning(current=0.0, speed=0.0, span=0.0, interval=2e-3)) == {}
    assert offered("rotor") == {}


def test_waves_are_looked_for_of_which_half_a_one_was_seen_in_more_than_a_few_rows():
    (orders,) = offered("motor", Turning(current=1.0, speed=50.0, span=1.2, interval=2e-3))["torque_ripple"].shapes.values()
    assert orders[0] == 3.0  # 1.2 rad of 2 pi / 3
    assert orders[-1] == 15.0  # 50 rad/s: 0.1 rad a row
    assert "torque_ripple" not in offered("motor", Turning(current=1.0, speed=50.0, span=0.02, interval=2e-3))


def test_a_motor_behind_an_amplifier_of_currents_loses_no_voltage():
    model = Model(
        name="direct",
        components={"motor": TorqueMotor(K=0.2), "wheel": Inertia(J=0.5)},
        connections=[("motor.flange", "wheel.flange")],
        inputs={"I": "motor.i"},
        outputs={"omega": "wheel.omega"},
    )
    assert set(offered("motor", model=model)) == {"torque_ripple", "magnetic_saturation"}


def test_of_a_motor_that_has_one_of_them_the_others_are_offered_and_each_can_go():
    ripple, saturation = (offered("motor")[word] for word in ("torque_ripple", "magnetic_saturation"))
    assert not saturation.replaces(ripple)
    wavy = ripple.edited(machine()).with_values(motor={"amplitude": 0.05})
    others = {c.physics: c for c in of_motor(wavy, "motor", lambda _: TURNING, {"motor.amplitude": 0.05})}
    assert set(others) == {"magnetic_saturation", "voltage_drop"}
    assert others["magnetic_saturation"].edited(wavy).components["motor"].parameters == wavy.components["motor"].parameters
    assert "b" in others["magnetic_saturation"].edited(machine()).components["motor"].declared_parameters
    dropping = others["voltage_drop"].edited(wavy)
    assert {c.physics for c in of_motor(dropping, "motor", lambda _: TURNING, {"motor.amplitude": 0.05})} == {"magnetic_saturation"}


def test_a_wave_is_looked_at_with_all_its_orders_also_where_the_motor_saturates_already():
    posed_for = posed(b=0.02)
    model = offered("motor")["magnetic_saturation"].edited(machine())
    problem = replace(posed_for, model=model, recordings=posed_for.recordings[:1], weights=Weights(W={"motor": 1e-3, "rotor": 1e-5}))
    solution = smooth(problem, settings=Settings(check_mesh=False)).solution
    candidates = [c for c in library(problem, model, solution) if c.physics == "torque_ripple"]
    looks = looked_at(problem, model, Linearised(solution), candidates)
    (orders,) = candidates[0].shapes.values()
    assert sorted(look.shape["motor.order"] for look in looks) == sorted(orders)
    assert len(orders) > 10


@pytest.mark.slow
def test_a_motor_constant_that_waves_is_found_with_its_wave():
    found = diagnose(posed(wave=0.08))
    (finding,) = found.findings
    assert (finding.explanation.place, finding.explanation.physics, found.verdict) == ("motor", "torque_ripple", "input")
    told = {name: s.value for name, s in finding.explanation.parameters.items()}
    assert told["order"] == pytest.approx(6.0, abs=2e-3)
    assert abs(told["amplitude"]) == pytest.approx(0.08, rel=0.01)
    assert found.after.parameters["motor.Km"].value == pytest.approx(K, rel=5e-3)


@pytest.mark.slow
def test_a_motor_that_saturates_and_waves_is_found_with_both():
    found = diagnose(posed(wave=0.08, b=0.02))
    told = {f.explanation.physics: {name: s.value for name, s in f.explanation.parameters.items()} for f in found.findings}
    assert set(told) == {"torque_ripple", "magnetic_saturation"}
    assert told["magnetic_saturation"]["b"] == pytest.approx(0.02, rel=0.02)
    assert abs(told["torque_ripple"]["amplitude"]) == pytest.approx(0.08, rel=0.02)
    assert compile_model(found.model).name == "servo"


@pytest.mark.slow
def test_a_voltage_that_is_lost_at_the_brushes_is_found_with_its_size():
    found = diagnose(posed(lost=0.3))
    (finding,) = found.findings
    assert (finding.explanation.place, finding.explanation.physics, found.verdict) == ("motor", "voltage_drop", "missing_physics")
    told = {name: s.value for name, s in finding.explanation.parameters.items()}
    assert (told["v_d"], told["i_0"]) == (pytest.approx(0.3, rel=2e-3), pytest.approx(0.01, rel=0.05))
    assert found.after.parameters["motor.R"].value == pytest.approx(R, rel=5e-3)


@pytest.mark.slow
def test_of_a_motor_that_lacks_nothing_nothing_is_said():
    assert diagnose(posed()).verdict == "none"
