"""Electrical parts against circuits solved by hand, and the transducers against the balance of power."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from backsight.models import Component, Model, ModelError, compile_model, simulate
from backsight.models.electrical import (
    EMF,
    Capacitor,
    Current,
    CurrentSensor,
    DCMotor,
    ElectricalGround,
    Inductor,
    Resistor,
    TorqueMotor,
    UnevenDCMotor,
    UnevenEMF,
    UnevenTorqueMotor,
    Voltage,
    VoltageDrop,
    VoltageSensor,
)
from backsight.models.mechanics.rotational import Gear, Inertia, RotationalDamper, RotationalFixed

T = np.linspace(0.0, 1.0, 51)


def ring(outputs: dict[str, str], **parts: Component) -> Model:
    """A voltage source and the named parts in series, in order; the source's negative pin is the ground."""
    names = ["source", *parts]
    joined = [(f"{a}.{'p' if a == 'source' else 'n'}", f"{b}.p") for a, b in pairwise(names)]
    return Model(
        name="ring",
        components={"source": Voltage(), **parts, "earth": ElectricalGround()},
        connections=[*joined, (f"{names[-1]}.n", "source.n"), ("source.n", "earth.pin")],
        inputs={"V": "source.v"},
        outputs=outputs,
    )


def test_a_voltage_divides_over_resistors_in_series() -> None:
    model = ring({"i": "one.i", "v": "two.v"}, one=Resistor(R=2.0), two=Resistor(R=6.0))
    run = simulate(compile_model(model), [0.0, 1.0], {"V": 4.0})
    assert run.outputs["i"].tolist() == pytest.approx([0.5, 0.5])
    assert run.outputs["v"].tolist() == pytest.approx([3.0, 3.0])


def test_current_rises_in_a_coil_with_its_time_constant() -> None:
    dae = compile_model(ring({"i": "coil.i"}, coil=Inductor(L=0.3), wire=Resistor(R=1.5)))
    assert simulate(dae, T, {"V": 6.0}).outputs["i"] == pytest.approx(4.0 * (1 - np.exp(-5.0 * T)), rel=1e-8, abs=1e-11)
    assert [q.name for q in dae.states] == ["coil.i"]


def test_voltage_rises_on_a_capacitor_with_its_time_constant() -> None:
    dae = compile_model(ring({"v": "store.v"}, wire=Resistor(R=20.0), store=Capacitor(C=0.01)))
    assert simulate(dae, T, {"V": 6.0}).outputs["v"] == pytest.approx(6.0 * (1 - np.exp(-5.0 * T)), rel=1e-8, abs=1e-11)
    assert [q.name for q in dae.states] == ["store.v"]


def test_coil_and_capacitor_swing_without_loss() -> None:
    dae = compile_model(ring({"v": "store.v", "i": "coil.i"}, coil=Inductor(L=0.5), store=Capacitor(C=0.02)))
    run = simulate(dae, T, {"V": 0.0}, initial={"store.v": 3.0})
    assert run.outputs["v"] == pytest.approx(3.0 * np.cos(10.0 * T), abs=1e-8)
    assert run.outputs["i"] == pytest.approx(-0.6 * np.sin(10.0 * T), abs=1e-8)


def test_coils_in_series_are_one_coil_with_one_residual_voltage() -> None:
    dae = compile_model(ring({"i": "one.i"}, one=Inductor(L=0.1), two=Inductor(L=0.2), wire=Resistor(R=1.5)))
    assert [q.name for q in dae.states] == ["one.i"] or [q.name for q in dae.states] == ["two.i"]
    assert simulate(dae, T, {"V": 6.0}).outputs["i"] == pytest.approx(4.0 * (1 - np.exp(-5.0 * T)), rel=1e-8, abs=1e-11)
    assert len(dae.places) == 1


def test_a_current_source_drives_its_current_through_a_parallel_pair() -> None:
    model = Model(
        name="pair",
        components={
            "source": Current(),
            "one": Resistor(R=2.0),
            "two": Resistor(R=3.0),
            "gauge": VoltageSensor(),
            "earth": ElectricalGround(),
        },
        connections=[("source.p", f"{name}.p") for name in ("one", "two", "gauge")]
        + [("source.n", f"{name}.n") for name in ("one", "two", "gauge")]
        + [("source.n", "earth.pin")],
        inputs={"I": "source.i"},
        outputs={"v": "gauge.v", "i": "two.i"},
    )
    run = simulate(compile_model(model), [0.0, 1.0], {"I": 5.0})
    assert run.outputs["v"].tolist() == pytest.approx([6.0, 6.0])
    assert run.outputs["i"].tolist() == pytest.approx([2.0, 2.0])


def test_sensors_read_gain_times_quantity_plus_bias_and_disturb_nothing() -> None:
    model = ring({"i": "meter.i", "true": "wire.i"}, meter=CurrentSensor(gain=1.1, bias=0.2), wire=Resistor(R=2.0))
    run = simulate(compile_model(model), [0.0, 1.0], {"V": 6.0})
    assert run.outputs["true"].tolist() == pytest.approx([3.0, 3.0])
    assert run.outputs["i"].tolist() == pytest.approx([3.5, 3.5])
    gauge = model.insert("wire", VoltageSensor(gain=0.9, bias=-0.1), name="gauge")
    gauge = Model(name="gauge", components=gauge.components, connections=gauge.connections, inputs=gauge.inputs, outputs={"v": "gauge.v"})
    assert simulate(compile_model(gauge), [0.0, 1.0], {"V": 6.0}).outputs["v"].tolist() == pytest.approx([5.3, 5.3])


def test_a_circuit_without_a_ground_is_refused() -> None:
    floating = ring({}, wire=Resistor()).without("earth")
    with pytest.raises(ModelError, match="occur as differences only and have no origin; add an ElectricalGround"):
        compile_model(floating)


def test_residual_places_of_a_circuit_are_its_windings_and_stores() -> None:
    dae = compile_model(ring({}, coil=Inductor(), store=Capacitor(), wire=Resistor()))
    assert [(p.name, p.unit, p.kind) for p in dae.places] == [("coil", "V", "balance"), ("store", "A", "balance")]
    assert [(p.name, p.unit, p.kind) for p in dae.dormant_places] == [("wire", "V", "law")]


def generator() -> Model:
    """A wheel on an EMF with ratio 2 whose circuit is a resistor."""
    return Model(
        name="generator",
        components={
            "wheel": Inertia(J=0.5),
            "gear": Gear(ratio=0.5),
            "emf": EMF(k=3.0),
            "load": Resistor(R=4.0),
            "earth": ElectricalGround(),
        },
        connections=[
            ("wheel.flange", "gear.flange_a"),
            ("gear.flange_b", "emf.flange"),
            ("emf.p", "load.p"),
            ("emf.n", "load.n"),
            ("emf.n", "earth.pin"),
        ],
        outputs={"omega": "wheel.omega", "v": "emf.v", "i": "load.i"},
    )


def test_an_emf_brakes_a_wheel_through_a_resistor_and_takes_what_it_gives() -> None:
    run = simulate(compile_model(generator()), T, initial={"wheel.omega": 2.0})
    k = 3.0 * 2.0  # seen from the wheel
    assert run.outputs["omega"] == pytest.approx(2.0 * np.exp(-(k**2) / 4.0 / 0.5 * T), rel=1e-7, abs=1e-10)
    electrical = run.outputs["v"] * run.outputs["i"]
    mechanical = -0.5 * run.derivatives["wheel.omega"] * run.states["wheel.omega"]
    assert electrical == pytest.approx(mechanical, rel=1e-9, abs=1e-12)


def motor_and_wheel(**parts: Component) -> Model:
    chain = {"p": f"{next(iter(parts))}.p", "n": f"{list(parts)[-1]}.n"}
    names = list(parts)
    shaft = next(name for name in names if "flange" in parts[name].declared_connectors)
    return Model(
        name="motor",
        components={
            "source": Voltage(),
            **parts,
            "wheel": Inertia(J=0.02),
            "air": RotationalDamper(d=0.01),
            "wall": RotationalFixed(),
            "earth": ElectricalGround(),
        },
        connections=[
            ("source.p", chain["p"]),
            *((f"{a}.n", f"{b}.p") for a, b in pairwise(names)),
            (chain["n"], "source.n"),
            ("source.n", "earth.pin"),
            (f"{shaft}.flange", "wheel.flange"),
            ("wheel.flange", "air.flange_a"),
            ("air.flange_b", "wall.flange"),
        ],
        inputs={"V": "source.v"},
        outputs={"omega": "wheel.omega"},
    )


def test_a_dc_motor_is_its_resistance_inductance_and_emf_in_series() -> None:
    whole = motor_and_wheel(motor=DCMotor(L=0.05, R=2.0, Km=0.4))
    parts = motor_and_wheel(wire=Resistor(R=2.0), coil=Inductor(L=0.05), emf=EMF(k=0.4))
    runs = [simulate(compile_model(model), T, {"V": 10.0 * np.sign(np.sin(9.0 * T))}).outputs["omega"] for model in (whole, parts)]
    assert runs[0] == pytest.approx(runs[1], rel=1e-9, abs=1e-11)


def test_a_dc_motor_runs_up_to_the_speed_where_its_losses_take_the_power() -> None:
    long = np.linspace(0.0, 20.0, 11)
    run = simulate(compile_model(motor_and_wheel(motor=DCMotor(L=0.05, R=2.0, Km=0.4))), long, {"V": 10.0})
    omega, i = run.outputs["omega"][-1], run.states["motor.i"][-1]
    assert omega == pytest.approx(10.0 * 0.4 / (0.4**2 + 2.0 * 0.01), rel=1e-9)
    assert 10.0 * i == pytest.approx(2.0 * i**2 + 0.01 * omega**2, rel=1e-9)


def test_the_residual_of_a_dc_motor_is_a_voltage_of_its_armature() -> None:
    dae = compile_model(motor_and_wheel(motor=DCMotor()))
    assert ("motor", "V", "balance", "voltage balance of motor") in [(p.name, p.unit, p.kind, p.origin) for p in dae.places]
    assert {"motor.L", "motor.R", "motor.Km"} <= {p.name for p in dae.parameters}


def test_a_torque_motor_turns_current_into_torque() -> None:
    model = Model(
        name="direct",
        components={"motor": TorqueMotor(K=0.2), "wheel": Inertia(J=0.5)},
        connections=[("motor.flange", "wheel.flange")],
        inputs={"I": "motor.i"},
        outputs={"omega": "wheel.omega"},
    )
    dae = compile_model(model)
    assert dae.inputs[0].unit == "A"
    assert simulate(dae, T, {"I": 5.0}).outputs["omega"] == pytest.approx(2.0 * T, rel=1e-10, abs=1e-13)


WAVE = {"amplitude": 0.3, "order": 5.0, "phase": 0.7}


def test_an_uneven_motor_has_one_constant_for_its_torque_and_its_voltage_at_every_angle() -> None:
    """Against the two equations in scipy, at a voltage that is held from row to row."""
    volts, L, R, k = 10.0 * np.sign(np.sin(9.0 * T)), 0.05, 2.0, 0.4

    def rates(_: float, x: np.ndarray, v: float) -> list[float]:
        i, phi, omega = x
        at = k * (1 + 0.3 * np.sin(5.0 * phi + 0.7))
        return [(v - R * i - at * omega) / L, omega, (at * i - 0.01 * omega) / 0.02]

    x, omega = np.zeros(3), [0.0]
    for v, (a, b) in zip(volts[:-1], pairwise(T), strict=True):
        x = solve_ivp(rates, (a, b), x, args=(v,), rtol=1e-10, atol=1e-12).y[:, -1]
        omega.append(x[2])
    whole = motor_and_wheel(motor=UnevenDCMotor(L=L, R=R, Km=k, **WAVE))
    parts = motor_and_wheel(wire=Resistor(R=R), coil=Inductor(L=L), emf=UnevenEMF(k=k, **WAVE))
    even = motor_and_wheel(motor=UnevenDCMotor(L=L, R=R, Km=k))
    for model in (whole, parts):
        assert simulate(compile_model(model), T, {"V": volts}).outputs["omega"] == pytest.approx(omega, rel=1e-6, abs=1e-8)
    assert simulate(compile_model(even), T, {"V": volts}).outputs["omega"] == pytest.approx(
        simulate(compile_model(motor_and_wheel(motor=DCMotor(L=L, R=R, Km=k))), T, {"V": volts}).outputs["omega"], rel=1e-9, abs=1e-11
    )


def test_the_constant_of_a_motor_that_saturates_falls_with_the_current() -> None:
    """At a steady speed the air takes its torque, and resistance and induced voltage share what is given."""
    b, k, R = 0.04, 0.4, 2.0
    long = np.linspace(0.0, 40.0, 11)
    for model in (
        motor_and_wheel(motor=UnevenDCMotor(L=0.05, R=R, Km=k, b=b)),
        motor_and_wheel(wire=Resistor(R=R), emf=UnevenEMF(k=k, b=b)),
    ):
        omega = simulate(compile_model(model), long, {"V": 20.0}).outputs["omega"][-1]

        def left(i: float) -> float:
            at = k / np.sqrt(1 + b * i**2)
            return 20.0 - R * i - at * (at * i / 0.01)

        i = brentq(left, 0.0, 10.0)
        assert omega == pytest.approx(k / np.sqrt(1 + b * i**2) * i / 0.01, rel=1e-6)
    amperes = 1.0 / np.sqrt(b)
    heavy = Model(
        name="direct",
        components={"motor": UnevenTorqueMotor(K=0.2, b=b), "wheel": Inertia(J=0.5)},
        connections=[("motor.flange", "wheel.flange")],
        inputs={"I": "motor.i"},
        outputs={"omega": "wheel.omega"},
    )
    assert simulate(compile_model(heavy), T, {"I": amperes}).outputs["omega"] == pytest.approx(
        0.2 / np.sqrt(2) * amperes / 0.5 * T, rel=1e-9, abs=1e-12
    )


def test_work_of_an_uneven_torque_motor_is_the_integral_of_its_constant_over_the_angle() -> None:
    model = Model(
        name="direct",
        components={"motor": UnevenTorqueMotor(K=0.2, **WAVE), "wheel": Inertia(J=0.5)},
        connections=[("motor.flange", "wheel.flange")],
        inputs={"I": "motor.i"},
        outputs={"omega": "wheel.omega", "phi": "wheel.phi"},
    )
    run = simulate(compile_model(model), 2.0 * T, {"I": 5.0}).outputs
    work = 5.0 * 0.2 * (run["phi"] + 0.3 / 5.0 * (np.cos(0.7) - np.cos(5.0 * run["phi"] + 0.7)))
    assert 0.25 * run["omega"] ** 2 == pytest.approx(work, rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("volts", [4.0, -4.0])
def test_a_voltage_is_lost_whichever_way_the_current_flows(volts: float) -> None:
    model = ring({"i": "wire.i"}, wire=Resistor(R=2.0), brushes=VoltageDrop(v_d=0.6))
    run = simulate(compile_model(model), [0.0, 1.0], {"V": volts})
    assert run.outputs["i"].tolist() == pytest.approx([np.sign(volts) * (4.0 - 0.6) / 2.0] * 2)


def test_at_a_current_of_i_0_most_of_the_voltage_is_lost() -> None:
    model = ring({"i": "wire.i"}, wire=Resistor(R=2.0), brushes=VoltageDrop(v_d=0.6, i_0=0.5))
    run = simulate(compile_model(model), [0.0, 1.0], {"V": 2.0 * 0.5 + 0.6 * np.tanh(1.0)})
    assert run.outputs["i"].tolist() == pytest.approx([0.5, 0.5])
