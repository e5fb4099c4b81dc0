"""The quadrotor: its equations of motion written out, hover, its linearisation in closed form, and edits of the model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from backsight.models import Model, compile_model, simulate
from backsight.models.analysis.linearise import StateSpace, linearise
from backsight.models.analysis.operating_point import equilibrium
from backsight.models.mechanics.spatial import AsymmetricPropeller, LinearDrag, PropellerInertia
from backsight.models.plants import PLANTS, quadrotor
from backsight.models.signals import Lag

Array = NDArray[np.float64]
BODY = [f"body.{name}" for name in ("x", "y", "z", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")]
ROTORS = [f"rotor_{i}" for i in (1, 2, 3, 4)]
NAMES = [*BODY, *(f"{rotor}.thrust" for rotor in ROTORS)]
M, G, ARM, TAU, GAIN, RATIO = 1.5, 9.81, 0.30, 0.05, 2.74, 0.016
INERTIA, DRAG_W, DRAG = np.array([0.015, 0.015, 0.028]), 0.3, np.array([0.5, 0.5, 0.2])
MIX = np.array([[1, 1, 1, 1], [1, -1, -1, 1], [1, 1, -1, -1], [-1, 1, -1, 1]])  # collective, roll, pitch, yaw of rotors 1 .. 4
HOVER = np.sqrt(M * G / 4) / GAIN
AT_REST = {f"{rotor}.thrust": M * G / 4 for rotor in ROTORS}


def motion(x: Array, command: Array, inertia: Array = INERTIA) -> Array:
    """The right-hand side, component by component (M. Back 2015, eq. 4.37, with its approximations undone)."""
    u, v, w, phi, theta, psi, p, q, r = x[3:12]
    thrust = x[12:]
    c, s, t = np.cos, np.sin, np.tan
    lift, roll, pitch, yaw = MIX @ thrust
    Ix, Iy, Iz = inertia
    return np.array(
        [
            c(theta) * c(psi) * u + (s(phi) * s(theta) * c(psi) - c(phi) * s(psi)) * v + (c(phi) * s(theta) * c(psi) + s(phi) * s(psi)) * w,
            c(theta) * s(psi) * u + (s(phi) * s(theta) * s(psi) + c(phi) * c(psi)) * v + (c(phi) * s(theta) * s(psi) - s(phi) * c(psi)) * w,
            -s(theta) * u + s(phi) * c(theta) * v + c(phi) * c(theta) * w,
            r * v - q * w - G * s(theta),
            p * w - r * u + G * s(phi) * c(theta),
            q * u - p * v + G * c(phi) * c(theta) - lift / M - DRAG_W / M * w,
            p + s(phi) * t(theta) * q + c(phi) * t(theta) * r,
            c(phi) * q - s(phi) * r,
            (s(phi) * q + c(phi) * r) / c(theta),
            (Iy - Iz) / Ix * q * r + ARM / np.sqrt(2) * roll / Ix - DRAG[0] * p,
            (Iz - Ix) / Iy * p * r + ARM / np.sqrt(2) * pitch / Iy - DRAG[1] * q,
            (Ix - Iy) / Iz * p * q + RATIO * yaw / Iz - DRAG[2] * r,
            *(2 / TAU * (GAIN * np.sqrt(thrust) * command - thrust)),
        ]
    )


def columns(mapping: Mapping[str, Array], names: list[str] = NAMES) -> Array:
    return np.array([mapping[name] for name in names]).T


def commanded(value: float = HOVER) -> dict[str, float]:
    return {f"u_{i}": value for i in (1, 2, 3, 4)}


def near_hover(model: Model | None = None) -> StateSpace:
    return linearise(compile_model(model or quadrotor()), AT_REST, commanded())


def test_the_quadrotor_is_registered_under_its_name() -> None:
    assert PLANTS["quadrotor"]() == quadrotor()


def test_names_units_and_defaults_are_the_agreed_ones() -> None:
    dae = compile_model(quadrotor())
    assert sorted(q.name for q in dae.states) == sorted(NAMES)
    units = {q.name: q.unit for q in dae.states}
    assert [units[name] for name in NAMES] == ["m"] * 3 + ["m/s"] * 3 + ["rad"] * 3 + ["rad/s"] * 3 + ["N"] * 4
    assert [q.name for q in dae.inputs] == ["u_1", "u_2", "u_3", "u_4"]
    assert [(q.name, q.unit) for q in dae.outputs] == [(a, "m/s2") for a in ("ax", "ay", "az")] + [(a, "rad/s") for a in "pqr"]
    values = {p.name: p.value for p in dae.parameters}
    expected = {"body.m": M, "body.g": G, "body.Ixx": 0.015, "body.Iyy": 0.015, "body.Izz": 0.028, "body.drag_w": DRAG_W}
    expected |= {"body.drag_u": 0.0, "body.drag_v": 0.0, "body.drag_p": 0.5, "body.drag_q": 0.5, "body.drag_r": 0.2}
    expected |= {"rotor.tau": TAU, "rotor.gain": GAIN, "rotor.torque_ratio": RATIO, "arm": ARM}
    assert {name: values.get(name) for name in expected} == expected
    assert not [name for name in values if name.startswith("rotor_") and name.rpartition(".")[2] not in ("azimuth", "spin")]
    balances = [(f"body.f_{a}", "N") for a in "xyz"] + [(f"body.tau_{a}", "N.m") for a in "xyz"]
    assert [(p.name, p.unit) for p in dae.places] == [*balances, *((rotor, "N") for rotor in ROTORS)]
    assert (len(dae.algebraics), dae.index, dae.invariants.shape[0]) == (0, 0, 0)


def test_it_flies_as_the_equations_of_motion_say_under_held_commands() -> None:
    t = np.linspace(0.0, 1.5, 31)
    rng = np.random.default_rng(8)
    command = HOVER + np.repeat(rng.uniform(-0.02, 0.02, (7, 4)), 5, axis=0)[: len(t)]
    inertia = np.array([0.015, 0.019, 0.028])
    start = np.array([1.0, 2.0, -3.0, 0.5, -0.3, 0.2, 0.05, -0.04, 0.3, 0.3, -0.2, 0.1, 3.5, 3.7, 3.6, 3.8])
    truth = [start]
    for a, b, u in zip(t[:-1], t[1:], command[:-1], strict=True):

        def rate(_: float, x: Array, u: Array = u) -> Array:
            return motion(x, u, inertia)

        truth.append(solve_ivp(rate, (a, b), truth[-1], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1])
    flown = np.array(truth)
    run = simulate(
        compile_model(quadrotor()),
        t,
        {f"u_{i + 1}": command[:, i] for i in range(4)},
        {"body.Iyy": 0.019},
        dict(zip(NAMES, start, strict=True)),
    )
    assert np.abs(flown[:, 6:9]).max() > 0.2
    assert columns(run.states) == pytest.approx(flown, rel=1e-8, abs=1e-8)
    assert columns(run.outputs, ["ax", "ay"]) == pytest.approx(np.zeros((len(t), 2)), abs=1e-10)
    assert run.outputs["az"] == pytest.approx(-(flown[:, 12:].sum(axis=1) + DRAG_W * flown[:, 5]) / M, rel=1e-8)
    assert columns(run.outputs, ["p", "q", "r"]) == pytest.approx(flown[:, 9:12], abs=1e-8)


def test_a_hovering_quadrotor_stands_in_the_air() -> None:
    assert pytest.approx(0.70, abs=1e-4) == HOVER
    t = np.linspace(0.0, 2.0, 5)
    run = simulate(compile_model(quadrotor()), t, commanded(), initial=AT_REST)
    assert columns(run.states, BODY) == pytest.approx(np.zeros((5, 12)), abs=1e-9)
    assert run.outputs["az"] == pytest.approx(np.full(5, -G), abs=1e-9)


def test_hover_is_found_from_a_guess_of_the_commands() -> None:
    guess = dict.fromkeys(AT_REST, 3.0) | commanded(0.6)
    point = equilibrium(compile_model(quadrotor()), guess=guess, held={"body.psi": 0.4, "body.w": 0.0})
    assert [point.x[name] for name in AT_REST] == pytest.approx([M * G / 4] * 4)
    assert list(point.u.values()) == pytest.approx([HOVER] * 4)
    assert (point.x["body.phi"], point.x["body.theta"], point.x["body.psi"]) == pytest.approx((0.0, 0.0, 0.4), abs=1e-9)


def test_near_hover_each_axis_is_a_chain_of_two_lags_of_its_own() -> None:
    """The form of M. Back 2015, eqs. 4.44 - 4.48: (w, p, q, r) and (T, T_phi, T_theta, T_psi) against (u_T, u_phi, u_theta, u_psi).

    About T = (gain u)^2 the root halves the decay: 2/tau (gain u / (2 sqrt(T)) - 1) = -1/tau, the time constant of the speed.
    """
    system = near_hover()
    order = [q.name for q in system.states]
    body, thrusts = [order.index(f"body.{q}") for q in "wpqr"], [order.index(f"{rotor}.thrust") for rotor in ROTORS]
    unmix = np.linalg.inv(MIX)
    assert system.A[np.ix_(body, body)] == pytest.approx(-np.diag([DRAG_W / M, *DRAG]), abs=1e-10)
    lift = np.diag([-1 / M, *(ARM / np.sqrt(2) / INERTIA[:2]), RATIO / INERTIA[2]])
    assert system.A[np.ix_(body, thrusts)] @ unmix == pytest.approx(lift, abs=1e-10)
    assert MIX @ system.A[np.ix_(thrusts, thrusts)] @ unmix == pytest.approx(-np.eye(4) / TAU, abs=1e-8)
    commands = MIX @ system.B[thrusts] @ MIX.T  # u = MIX.T (u_T, u_phi, u_theta, u_psi)
    assert commands == pytest.approx(np.eye(4) * 8 / TAU * GAIN * np.sqrt(M * G / 4), rel=1e-9, abs=1e-7)
    assert np.abs(system.A[np.ix_(thrusts, [i for i in range(16) if i not in thrusts])]).max() == 0.0
    assert np.abs(system.B[body]).max() == 0.0


def test_its_poles_near_hover_are_those_of_rotors_and_drags_and_free_integrators() -> None:
    poles = np.sort(near_hover().poles.real)
    expected = np.sort([*[-1 / TAU] * 4, -DRAG_W / M, *-DRAG, *[0.0] * 8])
    assert poles == pytest.approx(expected, abs=2e-3)  # the integrators are a chain of four: rounding moves them
    assert np.linalg.det(near_hover().A) == pytest.approx(0.0, abs=1e-9)


def test_it_accelerates_sideways_by_tilting_only() -> None:
    system = near_hover()
    order = [q.name for q in system.states]
    row = {name: system.A[order.index(name)] for name in ("body.u", "body.v")}
    assert row["body.u"] == pytest.approx(np.eye(16)[order.index("body.theta")] * -G)
    assert row["body.v"] == pytest.approx(np.eye(16)[order.index("body.phi")] * G)


def test_drag_of_the_rotors_shows_in_the_accelerometer_and_nowhere_else_at_first() -> None:
    dae = compile_model(quadrotor().insert("body", LinearDrag(d=0.6), "rotor_drag"))
    run = simulate(dae, [0.0], commanded(), initial={**AT_REST, "body.u": 2.0, "body.v": -1.0})
    assert [run.outputs[a][0] for a in ("ax", "ay", "az")] == pytest.approx([-0.8, 0.4, -G])
    assert [run.derivatives[f"body.{a}"][0] for a in "pqr"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_it_can_be_given_brakeless_rotors_with_momentum_and_lagging_commands() -> None:
    model = quadrotor().insert("input:u_1", Lag(tau=0.02), "input_lag")
    for i, spin in enumerate((1.0, -1.0, 1.0, -1.0), start=1):
        azimuth = model.component(f"rotor_{i}").parameters["azimuth"]
        model = model.replace(f"rotor_{i}", AsymmetricPropeller(azimuth=azimuth, spin=spin, tau_down=0.08))
        inertia = PropellerInertia(J=6e-5, k_r=1e-5, spin=spin)
        model = model.insert("body", inertia, f"inertia_{i}").connect(f"rotor_{i}.thrust", f"inertia_{i}.thrust")
    dae = compile_model(model)
    assert sorted(q.name for q in dae.states) == sorted([*NAMES, "input_lag.y"])
    run = simulate(dae, np.linspace(0.0, 0.5, 3), commanded(), initial={**AT_REST, "input_lag.y": HOVER, "body.p": 1.0})
    assert run.states["body.q"] == pytest.approx(np.zeros(3), abs=1e-9)  # rotors against each other: no gyroscopic torque in all
    slow = {rotor + ".thrust": 4.0 for rotor in ROTORS}
    falling = simulate(dae, np.array([0.0, 0.08]), commanded(0.0), initial=slow)
    assert columns(falling.states, list(slow))[1] == pytest.approx([4.0 * np.exp(-2.0)] * 4, rel=1e-7)
