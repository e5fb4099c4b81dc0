"""Smoothing of a mechanism with a closed loop, whose inner angles are algebraic variables that nobody measures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.models import compile_model
from backsight.models.plants import five_bar

TRUE = {"P_1": 0.1080, "P_2": 0.005422, "P_3": 0.01029, "P_4": 0.6059, "P_5": 0.1442, "P_6": 0.04350}
STEP, NOISE = 0.005, 1e-4
DAE = compile_model(five_bar())


def turn(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def side(angle: float) -> np.ndarray:
    return np.array([-np.sin(angle), np.cos(angle)])


def energy(q: np.ndarray, v: np.ndarray) -> float:
    """Kinetic energy of the four links in the frame of link 12; the inner rates from the loop's differentiated closure."""
    P_1, P_2, P_3, P_4, P_5, P_6 = TRUE.values()
    tip, hinge = np.array([0.25, 0.0]) + 0.10 * turn(q[1]), np.array([0.50, 0.0])
    line = hinge - tip
    d, aim = np.hypot(*line), np.arctan2(line[1], line[0])
    a_56 = aim + np.arccos((0.22**2 + d**2 - 0.20**2) / (2 * 0.22 * d))
    a_3 = aim + np.pi - np.arccos((0.20**2 + d**2 - 0.22**2) / (2 * 0.20 * d))
    w_56, w_3 = np.linalg.solve(np.column_stack([0.22 * side(a_56), -0.20 * side(a_3)]), -0.10 * side(q[1]) * v[1])

    def moving(at: np.ndarray, relative: np.ndarray) -> np.ndarray:
        return relative + v[0] * np.array([-at[1], at[0]])

    tip_speed = moving(tip, 0.10 * side(q[1]) * v[1])
    speed_3 = moving(hinge + 0.10 * turn(a_3), 0.10 * side(a_3) * w_3)
    speed_4 = moving(np.array([0.25, 0.0]) + 0.05 * turn(q[1]), 0.05 * side(q[1]) * v[1])
    links = P_1 * v[0] ** 2 + P_2 * (v[0] + w_3) ** 2 + P_3 * (v[0] + v[1]) ** 2 + P_6 * (v[0] + w_56) ** 2
    bodies = 0.25 * speed_3 @ speed_3 + 0.15 * speed_4 @ speed_4 + P_4 * tip_speed @ tip_speed
    return float(links + bodies + 2 * P_5 * (v[0] + w_56) * (side(a_56) @ tip_speed)) / 2


def acceleration(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Lagrange's equations, M q'' + M' q' - dT/dq = torque; T is a square in v, and differences of it in q are taken over 1e-5 rad."""
    e = np.eye(2)

    def inertia(q: np.ndarray) -> np.ndarray:
        single = [energy(q, e[i]) for i in range(2)]
        mixed = energy(q, e[0] + e[1]) - sum(single)
        return np.array([[2 * single[0], mixed], [mixed, 2 * single[1]]])

    slopes = [(inertia(q + 1e-5 * e[i]) - inertia(q - 1e-5 * e[i])) / 2e-5 for i in range(2)]
    along = sum(s * rate for s, rate in zip(slopes, v, strict=True))
    return np.linalg.solve(inertia(q), torque - along @ v + np.array([v @ s @ v for s in slopes]) / 2)


def moved(_: float, x: np.ndarray, torque: np.ndarray) -> np.ndarray:
    return np.concatenate([x[2:], acceleration(x[:2], x[2:], torque)])


def recording() -> Recording:
    """Two seconds under position control that holds its torques from sample to sample."""
    rng, n = np.random.default_rng(0), 400
    time, x = STEP * np.arange(n), np.zeros(4)
    angles, torques = np.zeros((n, 2)), np.zeros((n, 2))
    for k, t in enumerate(time):
        wanted = np.array([0.3 * np.sin(7 * t) + 0.15 * np.sin(17 * t), 0.3 * np.sin(11 * t) - 0.15 * np.sin(5 * t)])
        angles[k], torques[k] = x[:2], 40 * (wanted - x[:2]) - [2.0, 0.8] * x[2:]
        x = solve_ivp(moved, (0, STEP), x, rtol=1e-6, atol=1e-9, args=(torques[k],)).y[:, -1]
    measured = angles + NOISE * rng.standard_normal((n, 2))
    return Recording(
        name="arm",
        time=time,
        inputs={"tau_1": torques[:, 0], "tau_2": torques[:, 1]},
        outputs={"theta_1": measured[:, 0], "theta_2": measured[:, 1]},
        output_std={"theta_1": NOISE, "theta_2": NOISE},
    )


@pytest.mark.slow
def test_the_base_parameters_of_the_five_bar_come_back_from_guesses_three_times_off():
    factors = dict(zip(TRUE, (3.0, 0.4, 2.5, 0.5, 0.6, 2.0), strict=True))
    free = {name: Free(factors[name] * value, min=1e-6) for name, value in TRUE.items()}
    result = smooth(Problem(model=DAE, recordings=[recording()], parameters=free))
    assert result.solver.converged
    scores = []
    for name, true in TRUE.items():
        estimate = result.parameters[name]
        assert estimate.std is not None, name
        assert estimate.value == pytest.approx(true, rel=0.05), name
        scores.append((estimate.value - true) / estimate.std)
    assert np.all(np.abs(scores) < 3.5), scores
