"""The gantry table: its equations and modes against Lagrange's equations worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from backsight.models import compile_model, simulate
from backsight.models.analysis.linearise import linearise
from backsight.models.mechanics.rotational import EccentricRack
from backsight.models.mechanics.translational import Spring
from backsight.models.plants import PLANTS, xy_table

Array = NDArray[np.float64]
J = np.array([2.33e-3, 0.0, 2.37e-4])
TAU_C = np.array([0.473, 0.0, 0.149])
K, R, B, K_X, K_Y, M_E = 0.275, 0.010, 1.0, 0.258, 0.056, 2.3
SLIDEWAY = 8.5 * 1.25**2 / 12 / B**2
RIGID = np.array([[3.8 + 8.5 / 4 + SLIDEWAY, 8.5 / 4 - SLIDEWAY, 0], [8.5 / 4 - SLIDEWAY, 3.8 + 8.5 / 4 + SLIDEWAY, 0], [0, 0, 0]])
NAMES = ["drive_1", "drive_2", "drive_3"]
SMOOTH = {f"friction_{i}.tau_c": 0.0 for i in (1, 2, 3)}
START = np.array([1.0, 0.8, 30.0, 0.5, -1.0, 2.0])


def lever(q: Array) -> Array:
    """d x_r / d phi."""
    eta = R * q[2] / B
    return R * np.array([1 - eta, eta, R * (q[1] - q[0]) / B])


def mass(q: Array) -> Array:
    return np.diag(J) + R**2 * RIGID + M_E * (np.outer(lever(q), lever(q)) + R**2 * np.diag([0, 0, 1.0]))


def turning(v: Array) -> float:
    """The part of x_r'' that is there without angular accelerations: the slideway turns while the carriage moves along it."""
    return float(2 * R**2 * v[2] * (v[1] - v[0]) / B)


def acceleration(q: Array, v: Array, torque: Array, k: float = K, d: float = 0.0) -> Array:
    twist = k * (q[0] - q[1]) + d * (v[0] - v[1])
    return np.linalg.solve(mass(q), torque - twist * np.array([1, -1, 0]) - M_E * lever(q) * turning(v))


def stacked(states: Any) -> Array:
    return np.array([states[f"{name}.{word}"] for word in ("phi", "omega") for name in NAMES])


def named(x: Array) -> dict[str, float]:
    return {f"{name}.{word}": float(x[i + 3 * j]) for j, word in enumerate(("phi", "omega")) for i, name in enumerate(NAMES)}


def test_the_table_is_registered_under_its_name() -> None:
    assert PLANTS["xy_table"]() == xy_table()


def test_names_units_and_defaults_are_the_published_ones() -> None:
    dae = compile_model(xy_table())
    assert sorted((q.name, q.unit) for q in dae.states) == sorted(
        [(f"{n}.phi", "rad") for n in NAMES] + [(f"{n}.omega", "rad/s") for n in NAMES]
    )
    assert [(q.name, q.unit) for q in dae.inputs] == [("I_x", "A"), ("I_y", "A")]
    assert [(q.name, q.unit, q.noise_std) for q in dae.outputs] == [
        *(("x_r", "m", 5e-5), ("y_r", "m", 5e-5), ("ax_r", "m/s2", 0.05), ("ay_r", "m/s2", 0.05), ("x_m", "m", 5e-5), ("y_m", "m", 5e-5)),
    ]
    values = {p.name: p.value for p in dae.parameters}
    expected = {"spindle.k": K, "spindle.d": 0.0, "r": R, "gantry.b": B, "gantry.c": 1.25, "end_effector.m": M_E, "gantry.m_y": 8.5}
    expected |= {f"drive_{i + 1}.J": J[i] for i in range(3)} | {f"friction_{i + 1}.tau_c": TAU_C[i] for i in range(3)}
    expected |= {"slide_1.m": 3.8, "slide_2.m": 3.8, "motor_x.K": K_X, "motor_y.K": K_Y}
    assert {name: values[name] for name in expected} == pytest.approx(expected)
    assert [(p.name, p.unit) for p in dae.places] == [(name, "N.m") for name in NAMES]
    assert {"spindle", "belt_1", "belt_2", "belt_3"} <= {p.name for p in dae.dormant_places}
    assert (len(dae.algebraics), dae.index, dae.invariants.shape[0], len(dae.kinematics)) == (0, 0, 0, 3)


def test_its_rows_are_lagranges_equations_with_friction() -> None:
    dae = compile_model(xy_table())
    values = {"spindle.d": 0.01, "friction_2.tau_c": 0.05, "friction_1.d": 0.02}
    order = [q.name for q in dae.states]
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v, a, u, w = rng.normal(size=3) * [1, 1, 40], rng.normal(size=3), rng.normal(size=3) * 50, rng.normal(size=2), rng.normal(size=3)
        x, dx = named(np.concatenate([q, v])), named(np.concatenate([v, a]))
        residual, _ = dae.function()([dx[n] for n in order], [x[n] for n in order], [], u, dae.parameter_values(values), w, 0.0)
        widths = [p.value for n in (1, 2, 3) for p in dae.parameters if p.name == f"friction_{n}.width"]
        friction = np.array([TAU_C[0], 0.05, TAU_C[2]]) * np.tanh(v / widths) + [0.02 * v[0], 0, 0]
        twist = (K * (q[0] - q[1]) + 0.01 * (v[0] - v[1])) * np.array([1, -1, 0])
        torque = np.array([K_X * u[0], 0, K_Y * u[1]]) - friction + w
        expected = mass(q) @ a + M_E * lever(q) * turning(v) + twist - torque
        rows = {e.component: float(residual[i]) for i, e in enumerate(dae.equations) if e.place is not None}
        assert [rows[name] for name in NAMES] == pytest.approx(expected.tolist(), rel=1e-10, abs=1e-12)


def test_without_friction_it_follows_the_textbook_equations_and_its_sensors_read_what_they_should() -> None:
    t = np.linspace(0.0, 0.2, 21)
    u = np.array([3.0, -2.0])

    def textbook(_: float, x: Array) -> Array:
        return np.concatenate([x[3:], acceleration(x[:3], x[3:], np.array([K_X * u[0], 0, K_Y * u[1]]))])

    truth = solve_ivp(textbook, (0, 0.2), START, t_eval=t, rtol=1e-11, atol=1e-12, method="DOP853").y
    run = simulate(compile_model(xy_table()), t, {"I_x": u[0], "I_y": u[1]}, SMOOTH, named(START))
    assert stacked(run.states) == pytest.approx(truth, rel=1e-8, abs=1e-8)
    x_1, x_2, y = R * truth[:3]
    readings = {"x_r": x_1 + (x_2 - x_1) * y / B, "y_r": y, "x_m": x_1, "y_m": y}
    alpha = (x_1 - x_2) / B
    forward, along = np.empty(len(t)), np.empty(len(t))
    for i, x in enumerate(truth.T):
        a = textbook(0.0, x)[3:]
        forward[i], along[i] = lever(x[:3]) @ a + turning(x[3:]), R * a[2]
    readings |= {"ax_r": np.cos(alpha) * forward + np.sin(alpha) * along, "ay_r": np.cos(alpha) * along - np.sin(alpha) * forward}
    for name, reading in readings.items():
        assert run.outputs[name] == pytest.approx(reading, rel=1e-7, abs=1e-7 * np.abs(reading).max())


def test_energy_is_kept_when_nothing_rubs_and_nothing_drives() -> None:
    t = np.linspace(0.0, 1.0, 41)
    run = simulate(compile_model(xy_table()), t, {"I_x": 0.0, "I_y": 0.0}, SMOOTH, named(START))
    x = stacked(run.states)
    energy = [v @ mass(q) @ v / 2 + K * (q[0] - q[1]) ** 2 / 2 for q, v in zip(x[:3].T, x[3:].T, strict=True)]
    assert energy == pytest.approx(np.full(len(t), energy[0]), rel=1e-8)


def test_the_spindle_mode_with_wheel_1_held_is_near_4_hz() -> None:
    dae = compile_model(xy_table().with_values(drive_1={"J": 1e9}))
    poles = linearise(dae, {"drive_3.phi": 50.0}, parameters={**SMOOTH, "spindle.k": 0.46}).poles
    assert np.abs(poles).max() / 2 / np.pi == pytest.approx(np.sqrt(0.46 / mass(np.array([0, 0, 50.0]))[1, 1]) / 2 / np.pi, rel=1e-6)
    assert np.abs(poles).max() / 2 / np.pi == pytest.approx(4.0, abs=0.15)


def test_below_the_friction_of_the_wheels_it_stands() -> None:
    t = np.linspace(0.0, 0.5, 26)
    run = simulate(compile_model(xy_table()), t, {"I_x": 0.9 * TAU_C[0] / K_X, "I_y": -0.9 * TAU_C[2] / K_Y}, initial={"drive_3.phi": 50.0})
    assert np.abs(stacked(run.states) - np.array([[0], [0], [50.0], [0], [0], [0]])).max() < 1e-4


def test_a_compliant_belt_lets_its_slide_move_by_itself() -> None:
    stiffness = 33000.0
    model = xy_table().replace("belt_1", Spring(k=stiffness))
    dae = compile_model(model)
    assert len(dae.states) == 8
    assert [p.name for p in dae.places] == [*NAMES, "slide_1"]
    assert (len(dae.algebraics), [q.name for q in dae.states][-2:]) == (0, ["slide_1.s", "slide_1.v"])
    poles = linearise(dae, {"drive_3.phi": 50.0}, parameters=SMOOTH).poles
    q = np.array([0, 0, 50.0])
    to_slide = np.diag([1 / R, 1, 1])  # slide 1 [m], wheels 2 and 3 [rad]
    moving = to_slide @ (mass(q) - np.diag([J[0], 0, 0])) @ to_slide
    inertia = np.zeros((4, 4))
    inertia[:3, :3], inertia[3, 3] = moving, J[0]
    belt, twist = np.array([1, 0, 0, -R]), np.array([0, -1, 0, 1])
    modes = np.sqrt(np.maximum(eigh(stiffness * np.outer(belt, belt) + K * np.outer(twist, twist), inertia, eigvals_only=True), 0))
    assert np.sort(np.abs(poles))[[-1, -3]] == pytest.approx(modes[[-1, -2]], rel=1e-6)


def test_an_eccentric_wheel_moves_the_end_effector_and_not_the_encoder() -> None:
    model = xy_table().replace("wheel_1", EccentricRack(amplitude=1e-3, phase=0.4))
    dae = compile_model(model)
    t = np.linspace(0.0, 0.5, 11)
    run = simulate(dae, t, {"I_x": 2.0, "I_y": 0.0}, SMOOTH, {"drive_3.phi": 50.0, "drive_1.omega": 5.0, "drive_2.omega": 5.0})
    phi = stacked(run.states)[:3]
    x_1 = R * phi[0] + 1e-3 * (np.sin(phi[0] + 0.4) - np.sin(0.4))
    assert np.ptp(phi[0]) > 2.0
    assert run.outputs["x_m"] == pytest.approx(R * phi[0], rel=1e-12)
    assert run.outputs["x_r"] == pytest.approx(x_1 + (R * phi[1] - x_1) * R * phi[2] / B, rel=1e-10)
    assert [p.name for p in dae.places] == NAMES
