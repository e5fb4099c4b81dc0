"""The trajectory-pattern method on torques worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.classical import filtered_least_squares, harmonic
from backsight.models.errors import InputError
from backsight.models.plants import five_bar

OSCILLATOR = compiled(oscillator())
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(1.0), "spring.k": Free(10.0), "damper.d": Free(0.0), "offset.f": Free(0.0)}
W = 4.0


def pattern(t: np.ndarray, amplitude: float, w: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """amplitude (cos w t - cos(3 w t)/9) and its derivatives."""
    return (
        amplitude * (np.cos(w * t) - np.cos(3 * w * t) / 9),
        amplitude * w * (-np.sin(w * t) + np.sin(3 * w * t) / 3),
        amplitude * w**2 * (-np.cos(w * t) + np.cos(3 * w * t)),
    )


def recorded(seed: int, noise: float, periods: int = 6, dt: float = 0.01) -> Recording:
    """The force that moves the oscillator along the pattern, m a + d v + k s + offset, and the noisy position."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(int(periods * 2 * np.pi / W / dt))
    s, v, a = pattern(t, 0.1, W)
    y = s + noise * rng.normal(size=len(t))
    return Recording(name="run", time=t, inputs={"F": M * a + D * v + K * s + OFFSET}, outputs={"x": y}, hold="linear")


def test_an_exact_motion_gives_the_parameters_in_one_step_whatever_the_guess():
    found = harmonic(Problem(model=OSCILLATOR, recordings=[recorded(1, 0.0)], parameters=FREE), frequency=W)
    assert [found.parameters[name].value for name in TRUE] == pytest.approx(list(TRUE.values()), rel=2e-4)


@pytest.mark.slow
def test_estimates_scatter_as_the_periods_say():
    """20 repetitions of 8 periods: scatter over the rms of the stated deviations within 0.6 .. 1.6 (fails by chance below 1e-3)."""
    values, stated = [], []
    for seed in range(20):
        run = recorded(seed, 1e-3, periods=8)
        p = harmonic(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE), frequency=W, harmonics=4).parameters
        values.append([p[name].value for name in TRUE])
        stated.append([p[name].std for name in TRUE])
    ratio = np.std(values, axis=0, ddof=1) / np.sqrt(np.mean(np.square(stated), axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.6))
    assert np.all(np.abs(np.mean(values, axis=0) - list(TRUE.values())) < 5 * np.std(values, axis=0, ddof=1) / np.sqrt(20))


def test_noise_that_ruins_differences_leaves_harmonics():
    problem = Problem(model=OSCILLATOR, recordings=[recorded(2, 5e-3, periods=8)], parameters=FREE)
    assert harmonic(problem, frequency=W).parameters["mass.m"].value == pytest.approx(M, rel=0.05)
    assert abs(filtered_least_squares(problem, cutoff=20.0).parameters["mass.m"].value - M) > 0.3 * M


def test_a_held_force_is_taken_for_the_staircase_that_it_is():
    """The motion under a staircase of the force, from its own harmonics: the pattern's hold costs a delay of half a step if forgotten."""
    dt, n = 0.02, 2000
    w = 2 * np.pi / (100 * dt)
    t = dt * np.arange(n)
    F = 20 * np.sin(w * t)
    # steady motion under the first harmonic of the staircase: sinc and half a step's delay
    g = np.sinc(w * dt / 2 / np.pi) * np.exp(-0.5j * w * dt) / (K - M * w**2 + 1j * D * w)
    s = np.imag(20 * g * np.exp(1j * w * t))
    free = {"mass.m": M, "spring.k": Free(10.0), "damper.d": Free(0.0), "offset.f": 0.0}
    run = Recording(name="run", time=t, inputs={"F": F}, outputs={"x": s})
    found = harmonic(Problem(model=OSCILLATOR, recordings=[run], parameters=free), frequency=w, harmonics=2, motion_harmonics=2).parameters
    assert found["spring.k"].value == pytest.approx(K, rel=1e-6)
    assert found["damper.d"].value == pytest.approx(D, rel=1e-5)


@pytest.mark.slow
def test_the_manipulator_is_found_with_three_trajectories_from_ones_everywhere():
    """Torques by a Lagrangian written here: the loop closed by the cosine rule."""
    values = [0.1080, 0.005422, 0.01029, 0.6059, 0.1442, 0.04350]
    recordings, frequency = [], {}
    for name, l1, k0, l2, w in (("1", 0.2, 0.0, 0.196, 0.5), ("2", 0.295, -0.262, 0.295, 1.0), ("3", 0.3, -0.262, 0.295, 2.0)):
        n = 300
        t = 2 * np.pi / w * np.arange(n) / n
        q1, q2 = pattern(t, l1, w), pattern(t, l2, w)
        tau = torques(values, (q1[0] - 8 / 9 * l1, *q1[1:]), (q2[0] + k0, *q2[1:]))
        recordings.append(
            Recording(
                name=name, time=t, inputs={"tau_1": tau[0], "tau_2": tau[1]},
                outputs={"theta_1": q1[0] - 8 / 9 * l1, "theta_2": q2[0] + k0}, hold="linear",
            )
        )  # fmt: skip
        frequency[name] = w
    free = {f"P_{i}": Free(1.0) for i in range(1, 7)}
    found = harmonic(Problem(model=five_bar(), recordings=recordings, parameters=free), frequency=frequency)
    assert [found.parameters[name].value for name in free] == pytest.approx(values, rel=5e-3)
    assert "no standard deviations" in " ".join(found.notes)


def shape(q2: np.ndarray) -> tuple[np.ndarray, ...]:
    """At theta_1 = 0: centres of mass of links 3 and 4, joint 4 (each (2, n)), absolute angles of links 3 and 56."""
    l_1, l_2, l_3, l_4, l_5, r_3, r_4 = 0.25, 0.25, 0.20, 0.10, 0.22, 0.10, 0.05
    along = np.array([np.cos(q2), np.sin(q2)])
    origin, joint_3 = np.array([[l_1], [0.0]]), np.array([[l_1 + l_2], [0.0]])
    joint_4 = origin + l_4 * along
    base = joint_3 - joint_4
    length = np.hypot(*base)
    phi_56 = np.arctan2(base[1], base[0]) + np.arccos((l_5**2 + length**2 - l_3**2) / (2 * l_5 * length))
    joint_5 = joint_4 + l_5 * np.array([np.cos(phi_56), np.sin(phi_56)])
    phi_3 = np.arctan2(*(joint_5 - joint_3)[::-1])
    return joint_3 + r_3 * np.array([np.cos(phi_3), np.sin(phi_3)]), origin + r_4 * along, joint_4, phi_3, phi_56


def inertia(P: list[float], q2: np.ndarray) -> np.ndarray:
    """Mass matrix (2, 2, n) from the kinetic energy of the four links; rates by theta_2 by differences."""
    h, m_3, m_4 = 1e-6, 0.25, 0.15
    here, ahead, back = shape(q2), shape(q2 + h), shape(q2 - h)
    by_2 = [(a - b) / (2 * h) for a, b in zip(ahead, back, strict=True)]
    turn = [np.array([-p[1], p[0]]) for p in here[:3]]  # theta_1 turns everything about joint 1
    one, zero = np.ones_like(q2), np.zeros_like(q2)
    c_3, c_4, joint_4 = ((a, b) for a, b in zip(turn, by_2[:3], strict=True))
    w_12, w_4, w_3, w_56 = (one, zero), (one, one), (one, by_2[3]), (one, by_2[4])
    across = np.array([-np.sin(here[4]), np.cos(here[4])])
    out = np.empty((2, 2, len(q2)))
    for i in range(2):
        for j in range(2):
            moment = w_56[i] * np.sum(joint_4[j] * across, axis=0) + w_56[j] * np.sum(joint_4[i] * across, axis=0)
            out[i, j] = (
                P[0] * w_12[i] * w_12[j]
                + P[1] * w_3[i] * w_3[j] + m_3 * np.sum(c_3[i] * c_3[j], axis=0)
                + P[2] * w_4[i] * w_4[j] + m_4 * np.sum(c_4[i] * c_4[j], axis=0)
                + P[3] * np.sum(joint_4[i] * joint_4[j], axis=0) + P[4] * moment + P[5] * w_56[i] * w_56[j]
            )  # fmt: skip
    return out


def torques(P: list[float], q1: tuple[np.ndarray, ...], q2: tuple[np.ndarray, ...]) -> np.ndarray:
    """Lagrange: tau = M q'' + M' q' q2' - (0, q'^T M_2 q'/2), M a function of theta_2 only."""
    rate, twice = np.array([q1[1], q2[1]]), np.array([q1[2], q2[2]])
    slope = (inertia(P, q2[0] + 1e-4) - inertia(P, q2[0] - 1e-4)) / 2e-4
    tau = np.einsum("ijk,jk->ik", inertia(P, q2[0]), twice) + np.einsum("ijk,jk->ik", slope, rate) * rate[1]
    tau[1] -= 0.5 * np.einsum("ik,ijk,jk->k", rate, slope, rate)
    return tau


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"frequency": 0.1}, "hold no whole period"),
        ({"frequency": {"other": 1.0}}, "run has none"),
        ({"frequency": 60.0}, "too few for 12 harmonics"),
        ({"frequency": -1.0}, "positive angular frequency"),
        ({"frequency": W, "harmonics": 0}, "whole number from 1 on"),
    ],
)
def test_periods_that_cannot_be_used_are_refused(how, message):
    with pytest.raises(InputError, match=message):
        harmonic(Problem(model=OSCILLATOR, recordings=[recorded(3, 0.0)], parameters=FREE), **how)
