"""Shafts, gears and racks: kinematics and energies by hand."""

import numpy as np
import pytest
from one_dimensional import T

from backsight.models import Component, Model, compile_model, simulate
from backsight.models.mechanics.rotational import (
    AngleSensor,
    EccentricRack,
    Gear,
    GearWithError,
    Inertia,
    Rack,
    RotationalRigid,
    RotationalSpring,
    Rotor,
    Torque,
    TorsionString,
)
from backsight.models.mechanics.translational import Mass
from backsight.models.plants import xy_table


def test_a_rigid_shaft_adds_the_inertias() -> None:
    model = Model(
        name="pair",
        components={"motor": Torque(), "a": Inertia(J=0.5), "shaft": RotationalRigid(), "b": Inertia(J=1.5)},
        connections=[("motor.flange", "a.flange"), ("a.flange", "shaft.flange_a"), ("shaft.flange_b", "b.flange")],
        inputs={"T": "motor.tau"},
        outputs={"omega": "b.omega", "tau": "shaft.tau"},
    )
    result = simulate(compile_model(model), T, {"T": 4.0})
    assert result.outputs["omega"] == pytest.approx(2.0 * T, rel=1e-10, abs=1e-13)
    assert result.outputs["tau"] == pytest.approx(np.full(len(T), 3.0))


def test_two_rotors_on_a_string_swing_against_each_other_and_turn_any_number_of_times() -> None:
    model = Model(
        name="string",
        components={"a": Rotor(J=0.2), "string": TorsionString(k=30.0), "b": Rotor(J=0.3)},
        connections=[("a.flange", "string.flange_a"), ("string.flange_b", "b.flange")],
    )
    dae = compile_model(model)
    assert [q.name for q in dae.states] == ["a.omega", "string.dphi", "b.omega"]
    rate = np.sqrt(30.0 * (1 / 0.2 + 1 / 0.3))
    result = simulate(dae, T, initial={"a.omega": 100.0, "b.omega": 100.0, "string.dphi": 0.5})
    assert result.states["string.dphi"] == pytest.approx(0.5 * np.cos(rate * T), rel=1e-6, abs=1e-8)
    assert 0.2 * result.states["a.omega"] + 0.3 * result.states["b.omega"] == pytest.approx(np.full(len(T), 50.0), rel=1e-10)


def test_a_damped_string_loses_its_swing_at_the_rate_of_its_damping() -> None:
    model = Model(
        name="string",
        components={"a": Rotor(J=0.5), "string": TorsionString(k=32.0, d=1.0), "b": Rotor(J=0.5)},
        connections=[("a.flange", "string.flange_a"), ("string.flange_b", "b.flange")],
    )
    decay, swing = 2.0, np.sqrt(128.0 - 4.0)
    expected = 0.5 * np.exp(-decay * T) * (np.cos(swing * T) + decay / swing * np.sin(swing * T))
    result = simulate(compile_model(model), T, initial={"string.dphi": 0.5})
    assert result.states["string.dphi"] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_gear_between_elastic_shafts_passes_power_without_loss() -> None:
    model = Model(
        name="shafts",
        components={
            "a": Inertia(J=0.2),
            "in_": RotationalSpring(k=30.0),
            "gear": Gear(ratio=-3.0),
            "out": RotationalSpring(k=90.0),
            "b": Inertia(J=2.0),
        },
        connections=[
            ("a.flange", "in_.flange_a"),
            ("in_.flange_b", "gear.flange_a"),
            ("gear.flange_b", "out.flange_a"),
            ("out.flange_b", "b.flange"),
        ],
        outputs={"twist_in": "in_.phi_rel", "twist_out": "out.phi_rel"},
    )
    dae = compile_model(model)
    assert [q.name for q in dae.states] == ["a.phi", "a.omega", "b.phi", "b.omega"]
    result = simulate(dae, T, initial={"a.phi": 0.4, "b.omega": 1.0})
    energy = (
        0.1 * result.states["a.omega"] ** 2
        + 1.0 * result.states["b.omega"] ** 2
        + 15.0 * result.outputs["twist_in"] ** 2
        + 45.0 * result.outputs["twist_out"] ** 2
    )
    assert energy == pytest.approx(np.full(len(T), energy[0]), rel=1e-9)
    series = 1.0 / (1.0 / 30.0 + 9.0 / 90.0)  # at shaft a
    frequency = np.sqrt(series * (1 / 0.2 + 9 / 2.0))  # of phi_a + 3 phi_b
    across = 0.4 * np.cos(frequency * T) + 3.0 / frequency * np.sin(frequency * T)
    assert result.states["a.phi"] + 3.0 * result.states["b.phi"] == pytest.approx(across, rel=1e-7, abs=1e-9)


def geared(gear: Component) -> Model:
    """A driven inertia of 0.02 kg m2, a gear, and 0.3 kg m2 behind it."""
    return Model(
        name="geared",
        components={"motor": Torque(), "encoder": AngleSensor(), "a": Inertia(J=0.02), "gear": gear, "b": Inertia(J=0.3)},
        connections=[
            ("motor.flange", "a.flange"),
            ("encoder.flange", "a.flange"),
            ("a.flange", "gear.flange_a"),
            ("gear.flange_b", "b.flange"),
        ],
        inputs={"T": "motor.tau"},
        outputs={"phi_a": "encoder.phi", "omega_a": "a.omega", "phi_b": "b.phi", "omega_b": "b.omega"},
    )


def test_a_gear_with_an_error_runs_ahead_and_behind_and_passes_all_work_on() -> None:
    gear = GearWithError(ratio=4.0, amplitude=0.2, order=3.0, phase=0.7)
    y = simulate(compile_model(geared(gear)), T, {"T": 2.0}, rtol=1e-12).outputs
    assert y["phi_b"][-1] > 2 * np.pi / 3
    assert y["phi_a"] == pytest.approx(4.0 * y["phi_b"] + 0.2 * (np.sin(3.0 * y["phi_b"] + 0.7) - np.sin(0.7)), rel=1e-9, abs=1e-12)
    energy = 0.5 * 0.02 * y["omega_a"] ** 2 + 0.5 * 0.3 * y["omega_b"] ** 2
    assert energy == pytest.approx(2.0 * y["phi_a"], rel=1e-8, abs=1e-10)


def test_a_gear_without_error_is_a_gear() -> None:
    plain, even = (
        simulate(compile_model(geared(gear)), T, {"T": 2.0}).outputs["phi_b"] for gear in (Gear(ratio=4.0), GearWithError(ratio=4.0))
    )
    assert even == pytest.approx(plain, rel=1e-10)
    assert plain == pytest.approx(0.5 * 8.0 / (0.3 + 16 * 0.02) * T**2, rel=1e-9, abs=1e-12)


def belt(wheel: Component) -> Model:
    return Model(
        name="belt",
        components={"motor": Torque(), "wheel": Inertia(J=0.02), "belt": wheel, "slide": Mass(m=3.0)},
        connections=[("motor.flange", "wheel.flange"), ("wheel.flange", "belt.wheel"), ("belt.rack", "slide.flange")],
        inputs={"T": "motor.tau"},
        outputs={"x": "slide.s", "v": "slide.v", "phi": "wheel.phi", "omega": "wheel.omega"},
    )


def test_a_rack_turns_torque_into_force() -> None:
    y = simulate(compile_model(belt(Rack(r=0.1))), T, {"T": 0.5}).outputs
    assert y["x"] == pytest.approx(0.5 * 0.1 * 0.5 / (0.02 + 3.0 * 0.01) * T**2, rel=1e-10, abs=1e-14)
    assert y["x"] == pytest.approx(0.1 * y["phi"], rel=1e-12, abs=1e-15)


def test_an_eccentric_wheel_moves_its_belt_unevenly_and_passes_all_work_on() -> None:
    dae = compile_model(belt(EccentricRack(r=0.1, amplitude=0.02, phase=0.7)))
    assert (len(dae.states), len(dae.algebraics)) == (2, 0)
    y = simulate(dae, T, {"T": 0.5}, rtol=1e-12).outputs
    assert y["phi"][-1] > 2 * np.pi
    assert y["x"] == pytest.approx(0.1 * y["phi"] + 0.02 * (np.sin(y["phi"] + 0.7) - np.sin(0.7)), rel=1e-9, abs=1e-12)
    assert 0.5 * 0.02 * y["omega"] ** 2 + 1.5 * y["v"] ** 2 == pytest.approx(0.5 * y["phi"], rel=1e-8, abs=1e-10)


def test_an_eccentric_wheel_can_take_the_place_of_a_round_one_in_the_gantry() -> None:
    round_, uneven = compile_model(xy_table()), compile_model(xy_table().replace("wheel_1", EccentricRack(r=0.01, amplitude=5e-4)))
    assert [q.name for q in uneven.states] == [q.name for q in round_.states]
    assert (len(uneven.algebraics), uneven.index) == (0, 0)
