"""Concealed machines against the plants, written by others, with the same effect declared, and against conservation of energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backsight.data.cases.actuator import BENCH as AXIS
from backsight.data.cases.case import Case, RigBench
from backsight.data.cases.drillstring import BENCH as DRILL
from backsight.data.cases.five_bar import BENCH as ARM
from backsight.data.cases.quadrotor import BENCH as CRAFT
from backsight.data.cases.quadrotor import PILOT
from backsight.data.cases.xy_table import BENCH as TABLE
from backsight.data.generators.concealed.actuator import Axis
from backsight.data.generators.concealed.drillstring import Rig
from backsight.data.generators.concealed.five_bar import Joints
from backsight.data.generators.concealed.quadrotor import Craft, fly, stick
from backsight.data.generators.concealed.rig import Machine, Setting, Trace, operate
from backsight.data.generators.concealed.sensing import SensorFault
from backsight.data.generators.concealed.xy_table import Gantry
from backsight.data.generators.quadrotor import G, Quadrotor, with_values
from backsight.data.generators.run import clock
from backsight.data.generators.runge_kutta import advance
from backsight.data.generators.xy_table import Table
from backsight.models import Model, compile_model, simulate
from backsight.models.plants import actuator, drillstring, five_bar, quadrotor, xy_table
from backsight.models.signals import Lag

SECONDS = {"actuator": 1.0, "xy_table": 0.6, "drillstring": 6.0, "five_bar": 0.6}
PLANTS = {"actuator": actuator, "xy_table": xy_table, "drillstring": drillstring, "five_bar": five_bar}


def trace_of(bench: RigBench, values: Mapping[str, float], structure: Mapping[str, Any]) -> tuple[Machine, Trace]:
    """A run of the bench's machine without process forces."""
    setting = Setting(conditions=replace(bench.conditions, duration=SECONDS[bench.plant]), coloured={})
    machine, time = bench.machine(values, structure), clock(setting.conditions, np.random.default_rng(0))
    control = bench.control(machine, Case(kind="test"), "multisine", time, setting.conditions.step, np.random.default_rng(1))
    return machine, operate(machine, control, setting, (), np.random.default_rng(0))


def usual(bench: RigBench) -> dict[str, float]:
    return {**bench.base, **bench.known}


def compare(bench: RigBench, model: Model, structure: Mapping[str, Any], values: Mapping[str, float], start: Mapping[str, float]) -> float:
    """Largest difference of an output between the machine and the model, over its greatest size. values: what the model has besides."""
    base = usual(bench)
    machine, trace = trace_of(bench, {**base, **{k: v for k, v in values.items() if k in base}}, structure)
    commands = dict(zip(machine.inputs, trace.commands.T, strict=True))
    dae = compile_model(model)
    known = {p.name for p in dae.parameters}
    told = simulate(dae, trace.time, commands, {k: v for k, v in {**base, **values}.items() if k in known}, dict(start))
    clean = dict(zip(machine.outputs, trace.clean.T, strict=True))
    return max(float(np.abs(told.outputs[o] - y).max() / np.abs(y - y[0]).max()) for o, y in clean.items())


START = {"xy_table": {"drive_3.phi": 50.0}, "five_bar": {"joint_2.phi": -0.05}}
WITHOUT = pytest.mark.parametrize("bench", [AXIS, TABLE, DRILL, ARM], ids=lambda b: b.plant)


@WITHOUT
def test_without_effects_it_moves_like_the_plant(bench: RigBench) -> None:
    accuracy = 1e-5 if bench is DRILL else 1e-6  # its step is long against L/R
    assert compare(bench, PLANTS[bench.plant](), {}, {}, START.get(bench.plant, {})) < accuracy


def test_an_accelerometer_behind_a_lag_reads_what_the_plant_with_one_does() -> None:
    """What the motors' currents make of the acceleration jumps from row to row, and the lag is as long as two of these.

    But for ten rows about where a wheel stops or breaks away, which it does between two rows.
    """
    _, trace = trace_of(TABLE, usual(TABLE), {})
    names = ("x_r", "y_r", "ax_r", "ay_r", "x_m", "y_m")
    clean, jumps = (dict(zip(names, of.T, strict=True)) for of in (trace.clean, trace.jumps))
    read = SensorFault(tau=0.004).read("ay_r", trace.time, clean, jumps)
    commands = dict(zip(("I_x", "I_y"), trace.commands.T, strict=True))
    lagging = compile_model(xy_table().insert("sensor:ay_r", Lag(tau=0.004), "lag"))
    told = simulate(lagging, trace.time, commands, usual(TABLE), {**START["xy_table"], "lag.y": clean["ay_r"][0]}).outputs["ay_r"]
    rests = np.any(np.diff(trace.v == 0.0, axis=0, prepend=True), axis=1)
    steady = ~np.convolve(rests, np.ones(21), mode="same").astype(bool)
    assert np.count_nonzero(steady) > 100
    size = np.std(clean["ay_r"])
    assert np.abs(told - read)[steady].max() < 0.005 * size
    assert np.abs(told - clean["ay_r"])[steady].max() > 0.2 * size


def test_friction_inertia_and_damping_that_the_study_leaves_out_act_like_those_of_the_gantry_plant() -> None:
    values = {"friction_2.tau_c": 0.05, "drive_2.J": 3e-4, "spindle.d": 4e-3, "friction_2.d": 1e-3}
    bench = TABLE
    machine, trace = trace_of(bench, {**usual(bench), **values}, {})
    commands = dict(zip(machine.inputs, trace.commands.T, strict=True))
    told = simulate(compile_model(xy_table()), trace.time, commands, {**usual(bench), **values}, START["xy_table"])
    for output, y in zip(machine.outputs, trace.clean.T, strict=True):
        assert np.abs(told.outputs[output] - y).max() < 1e-6 * np.abs(y - y[0]).max(), output


def test_damping_of_the_string_is_that_of_the_plant() -> None:
    assert compare(DRILL, drillstring(), {"d": 0.01}, {"string.d": 0.01}, {}) < 1e-5


def test_a_tilted_plane_pulls_like_that_of_the_plant() -> None:
    values = {"world.tilt": 0.03, "world.direction": -np.pi / 2}
    assert compare(ARM, five_bar(), {"tilt": 0.03}, values, START["five_bar"]) < 1e-6


def test_a_mass_beside_link_56_moves_its_four_moments() -> None:
    m, x, y, base = 0.2, 0.05, 0.12, usual(ARM)
    moments = {"P_4": base["P_4"] + m, "P_5": base["P_5"] + m * x, "P_6": base["P_6"] + m * (x * x + y * y), "link_56.m_y": m * y}
    machine, trace = trace_of(ARM, base, {"mass": m, "x": x, "y": y})
    commands = dict(zip(machine.inputs, trace.commands.T, strict=True))
    told = simulate(compile_model(five_bar()), trace.time, commands, {**base, **moments}, START["five_bar"])
    assert np.abs(told.outputs["theta_2"] - trace.clean[:, 1]).max() < 1e-6


@pytest.mark.parametrize("side", ["motor", "carriage"])
def test_an_elastic_screw_swings_like_that_of_the_plant(side: str) -> None:
    base = usual(AXIS)
    values = {"carriage.m": base["carriage.m"] - 30.0, "motor_mass.m": 30.0, "screw.k": 1e6, "screw.d": 300.0}
    _, trace = trace_of(AXIS, base, {"k": 1e6, "d_s": 300.0, "encoder": side})
    told = simulate(compile_model(actuator("compliant", side)), trace.time, {"F": trace.commands[:, 0]}, {**base, **values}, {})
    assert np.abs(told.outputs["x"] - trace.clean[:, 0]).max() < 1e-6 * np.abs(trace.clean).max()


def test_a_stiff_screw_with_no_gap_is_a_rigid_one() -> None:
    soft, stiff = (Axis(m=90.0, d=0.0, f_c=0.0, k=1e6, gap=gap) for gap in (1e-3, 0.0))
    assert soft.screw(0.4e-3, 1.0) == 0.0
    assert soft.screw(1.5e-3, 0.0) == pytest.approx(stiff.screw(1e-3, 0.0))


def swing(machine: Machine, q: np.ndarray, v: np.ndarray, seconds: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """q and v after free motion without friction and inputs."""

    def rates(_t: float, y: np.ndarray) -> np.ndarray:
        M, f = machine.equations(y[: q.size], y[q.size :])
        return np.concatenate([y[q.size :], np.linalg.solve(M, f)])

    y = advance(rates, 0.0, np.concatenate([q, v]), seconds, steps)
    return y[: q.size], y[q.size :]


@pytest.mark.parametrize("structure", [{"e": 2e-3}, {"belt": 0, "k_b": 3e4}, {"belt": 2, "k_b": 3e4}, {"k_3": 0.05}], ids=str)
def test_the_gantry_keeps_its_energy_with_every_structure(structure: dict[str, Any]) -> None:
    gantry = Gantry(table=replace(Table(), k=0.4), **structure)
    k_3, r = gantry.k_3, gantry.table.r

    def energy(q: np.ndarray, v: np.ndarray) -> float:
        twist = (q[0] - q[1]) / r
        stretch = q[gantry.belt] - q[3] if gantry.belt >= 0 else 0.0
        potential = gantry.table.k * twist**2 / 2 + k_3 * twist**4 / 4 + gantry.k_b * stretch**2 / 2
        return float(v @ gantry.equations(q, v)[0] @ v / 2 + potential)

    q, v = gantry.start.copy(), np.array([0.3, -0.2, 0.4, 0.35])[: gantry.start.size]
    after = swing(gantry, q, v, 0.3, 600)
    assert np.abs(after[0] - q).max() > 0.01
    assert energy(*after) == pytest.approx(energy(q, v), rel=1e-8)


def test_two_sections_of_the_string_keep_their_energy_and_their_twist_at_rest() -> None:
    rig = Rig(string=replace(DRILL.machine({**usual(DRILL)}, {}).string, R=0.0, B_r=0.0, B_b=0.0, Km=0.0), k_1=0.5, J_s=0.012)  # type: ignore[attr-defined]

    def energy(q: np.ndarray, v: np.ndarray) -> float:
        M, _ = rig.equations(q, v)
        return float(v @ M @ v / 2 + rig.k_1 * (q[1] - q[3]) ** 2 / 2 + rig.string.k * (q[3] - q[2]) ** 2 / 2)

    q, v = np.zeros(4), np.array([0.0, 2.0, -1.0, 0.5])
    assert energy(*swing(rig, q, v, 2.0, 2000)) == pytest.approx(energy(q, v), rel=1e-8)
    twisted = np.array([0.0, 1.0, 0.0, 1.0 - 1 / (1 + rig.k_1 / rig.string.k)])
    assert rig.equations(twisted, np.zeros(4))[1][3] == pytest.approx(0.0, abs=1e-12)


def test_a_tilted_arm_keeps_its_energy() -> None:
    arm, q, v = Joints(tilt=0.4, mass=0.2, x=0.05, y=0.1), np.array([0.3, 0.1]), np.array([0.5, -1.0])

    def energy(q: np.ndarray, v: np.ndarray) -> float:
        a, _, _ = arm.arm.links(q, v)
        c, d = arm.place()
        height = 0.15 * np.sin(a[0]) + sum(m * (c @ np.sin(a)) for m, c in arm.arm.points) + arm.mass * (c @ np.sin(a) + d @ np.cos(a))
        return float(v @ arm.equations(q, v)[0] @ v / 2 + G * np.sin(arm.tilt) * height)

    assert energy(*swing(arm, q, v, 0.5, 500)) == pytest.approx(energy(q, v), rel=1e-8)


def test_bristles_hold_like_a_spring_and_slide_like_coulomb_friction() -> None:
    axis = Axis(m=90.0, d=0.0, f_c=20.0, sigma_0=1e5)
    for v, z in ((1e-6, 1e-5), (0.1, 20.0 / 1e5)):
        rate = axis.equations(np.zeros(2), np.array([v, z]))[1]
        assert rate[0] == pytest.approx(-1e5 * z)
        assert rate[1] == pytest.approx(v * (1 - 1e5 * z / 20.0))


# ---------------------------------------------------------------- quadrotor


def flown(craft: Craft, seconds: float = 3.0) -> Trace:
    setting = Setting(conditions=replace(CRAFT.conditions, duration=seconds), coloured={})
    time = clock(setting.conditions, np.random.default_rng(0))
    return fly(craft, PILOT, stick("multisine", time, 1.0, PILOT, np.random.default_rng(1)), setting, (), np.random.default_rng(0))


def test_without_effects_it_flies_like_the_plant() -> None:
    values = {**CRAFT.base, **CRAFT.known}
    trace = flown(Craft(craft=with_values(values)))
    hover = values["body.m"] * G / 4
    start = {f"rotor_{i}.thrust": hover for i in (1, 2, 3, 4)}
    told = simulate(compile_model(quadrotor()), trace.time, dict(zip(Craft.inputs, trace.commands.T, strict=True)), values, start)
    for output, y in zip(Craft.outputs, trace.clean.T, strict=True):
        assert np.abs(told.outputs[output] - y).max() < 1e-6, output


def test_a_mass_beside_the_centre_tips_it_with_the_weight_times_its_lever() -> None:
    craft, n = Craft(x=0.01, y=-0.02), np.full(4, np.sqrt(1.5 * G / 4))
    force, torque = craft.wrench(n, np.zeros(4), 0.0, np.zeros(3))
    assert force[2] == pytest.approx(-1.5 * G)
    assert torque == pytest.approx([-0.02 * 1.5 * G, -0.01 * 1.5 * G, 0.0])


def test_rotors_take_angular_momentum_from_the_body_that_they_give_back() -> None:
    """About its own axis, without drag and reaction: I_z r + J_r sum s W stays as it is."""
    still = Quadrotor(torque_ratio=0.0, drag_r=0.0)
    craft, u, r, n = Craft(craft=still, J_r=2e-4), np.array([0.8, 0.6, 0.8, 0.6]), 0.0, np.full(4, 1.9)
    from backsight.data.generators.concealed.quadrotor import SPEED
    from backsight.data.generators.quadrotor import SPIN

    def momentum(n: np.ndarray, r: float) -> float:
        return still.I_z * r + craft.J_r * SPEED * float(SPIN @ n)

    before = momentum(n, r)
    for _ in range(2000):
        middle, rate = craft.spun(n, u, 5e-5)
        r += 1e-4 * craft.wrench(middle, rate, 0.0, np.zeros(3))[1][2] / still.I_z
        n = craft.spun(n, u, 1e-4)[0]
    assert abs(r) > 0.1
    assert momentum(n, r) == pytest.approx(before, abs=1e-6)


def test_rotors_slow_down_with_a_lag_of_their_own() -> None:
    craft = Craft(tau_down=0.2)
    up, _ = craft.spun(np.full(4, 1.0), np.full(4, 2.0 / craft.craft.gain), 0.1)
    down, rate = craft.spun(np.full(4, 2.0), np.full(4, 1.0 / craft.craft.gain), 0.1)
    assert up[0] == pytest.approx(2 - np.exp(-0.1 / craft.craft.tau))
    assert down[0] == pytest.approx(1 + np.exp(-0.1 / 0.2))
    assert rate[0] == pytest.approx(-np.exp(-0.1 / 0.2) / 0.2)
