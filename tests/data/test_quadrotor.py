"""The simulated quadrotor against closed forms and conserved quantities."""

from dataclasses import replace

import numpy as np
import pytest

from backsight.data.generators.quadrotor import CONDITIONS, PLACES, G, Quadrotor, angles, fly, record, rotation, spun

CRAFT = Quadrotor()
REST = np.concatenate([np.zeros(3), [1.0], np.zeros(9)])
QUIET = np.zeros(6)


def flown(craft: Quadrotor, y: np.ndarray, n: np.ndarray, u: np.ndarray, duration: float, rows: int = 100) -> np.ndarray:
    h = duration / rows
    for k in range(rows):
        y, n = fly(craft, y, n, u, k * h, h, QUIET, None), spun(craft, n, u, h)
    return y


def test_at_the_hover_command_it_stays_where_it_is() -> None:
    u = np.full(4, CRAFT.hover)
    assert flown(CRAFT, REST, CRAFT.gain * u, u, 5.0) == pytest.approx(REST, abs=1e-12)


def test_after_a_step_of_all_commands_it_climbs_as_the_linear_equation_says() -> None:
    """m w' = m g - 4 n^2 - d_w w with n = e + (n_0 - e) exp(-t/tau): a sum of exponentials."""
    u, t = np.full(4, 0.8), 0.6
    n_0, e, d = CRAFT.gain * CRAFT.hover, CRAFT.gain * 0.8, CRAFT.drag_w / CRAFT.m
    w = 0.0
    for size, rate in (
        (G - 4 * e**2 / CRAFT.m, 0.0),
        (-8 * e * (n_0 - e) / CRAFT.m, -1 / CRAFT.tau),
        (-4 * (n_0 - e) ** 2 / CRAFT.m, -2 / CRAFT.tau),
    ):
        w += size * (np.exp(rate * t) - np.exp(-d * t)) / (rate + d)
    y = flown(CRAFT, REST, np.full(4, n_0), u, t)
    assert y[9] == pytest.approx(w, rel=1e-8)
    assert y[9] < 0, "z points down"


@pytest.mark.parametrize(
    ("signs", "axis", "inertia", "drag", "torque"),
    [
        ((1, -1, -1, 1), 0, CRAFT.I_x, CRAFT.drag_p, CRAFT.arm / np.sqrt(2)),
        ((1, 1, -1, -1), 1, CRAFT.I_y, CRAFT.drag_q, CRAFT.arm / np.sqrt(2)),
        ((-1, 1, -1, 1), 2, CRAFT.I_z, CRAFT.drag_r, CRAFT.torque_ratio),
    ],
)
def test_unequal_thrusts_turn_it_about_one_axis_with_the_published_signs(signs, axis, inertia, drag, torque) -> None:
    """I p' = lever (T_phi) - D I p at constant thrusts: p = M/(D I) (1 - exp(-D t)); nothing else turns."""
    T = CRAFT.m * G / 4 + 0.1 * np.array(signs)
    u, t = np.sqrt(T) / CRAFT.gain, 0.7
    rates = flown(CRAFT, REST, np.sqrt(T), u, t)[10:]
    expected = np.zeros(3)
    expected[axis] = torque * 0.4 / (drag * inertia) * (1 - np.exp(-drag * t))
    assert rates == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_without_thrust_and_drag_it_tumbles_and_falls_with_its_momenta_and_energy() -> None:
    craft = replace(CRAFT, I_x=0.01, I_y=0.015, I_z=0.022, drag_w=0.0, drag_p=0.0, drag_q=0.0, drag_r=0.0)
    J = np.array([craft.I_x, craft.I_y, craft.I_z])
    y = REST.copy()
    y[7:] = [1.0, -0.5, -2.0, 0.3, 6.0, -0.4]
    after = flown(craft, y, np.zeros(4), np.zeros(4), 2.0, rows=200)
    assert after[:3] == pytest.approx([2.0, -1.0, -4.0 + G * 2], rel=1e-9)
    assert after[10:] @ (J * after[10:]) == pytest.approx(y[10:] @ (J * y[10:]), rel=1e-7)
    assert rotation(after[3:7]) @ (J * after[10:]) == pytest.approx(J * y[10:], abs=1e-8)
    assert not np.allclose(after[10:], y[10:], atol=0.5), "about the middle axis it does not turn steadily"


def test_the_attitude_is_a_rotation_by_the_three_angles_in_their_order() -> None:
    phi, theta, psi = 0.3, -0.5, 1.1
    about = [np.array([np.cos(a / 2), *(np.sin(a / 2) * np.eye(3)[i])]) for i, a in ((2, psi), (1, theta), (0, phi))]
    R = rotation(about[0]) @ rotation(about[1]) @ rotation(about[2])
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-15
    assert rotation(about[2]) @ [0, 1, 0] == pytest.approx([0, np.cos(phi), np.sin(phi)])
    assert angles(R) == pytest.approx([phi, theta, psi], abs=1e-14)


@pytest.mark.slow
def test_the_power_of_all_forces_is_the_change_of_energy() -> None:
    """Along a flight: d/dt (m v^2/2 + omega J omega/2 - m g z) = F v + M omega, with F and M from the recorded thrusts by the textbook."""
    run = record(seed=2, conditions=replace(CONDITIONS, duration=2.0, step=0.001, process={}))
    s = run.truth
    v, w = (np.column_stack([s[f"body.{i}"] for i in names]) for names in (("u", "v", "w"), ("p", "q", "r")))
    T = np.column_stack([s[f"rotor_{i}.thrust"] for i in (1, 2, 3, 4)])
    J, D = np.array([CRAFT.I_x, CRAFT.I_y, CRAFT.I_z]), np.array([CRAFT.drag_p, CRAFT.drag_q, CRAFT.drag_r])
    mixing = np.array([[1, -1, -1, 1], [1, 1, -1, -1], [-1, 1, -1, 1]]) * np.array(
        [[CRAFT.arm / 2**0.5], [CRAFT.arm / 2**0.5], [CRAFT.torque_ratio]]
    )
    power = (-T.sum(1) - CRAFT.drag_w * v[:, 2]) * v[:, 2] + ((T @ mixing.T - D * J * w) * w).sum(1)
    energy = (CRAFT.m * (v**2).sum(1) + (J * w**2).sum(1)) / 2 - CRAFT.m * G * s["body.z"]
    done = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * 0.001)])
    assert np.abs(power).max() > 10
    assert np.abs(energy - energy[0] - done).max() < 2e-5 * np.abs(power).max()


def test_halving_the_step_of_the_integration_changes_nothing_that_matters(monkeypatch) -> None:
    short = replace(CONDITIONS, duration=3.0)
    coarse = record(seed=1, conditions=short)
    monkeypatch.setattr("backsight.data.generators.quadrotor.LONGEST_STEP", 0.0025)
    fine = record(seed=1, conditions=short)
    assert max(np.abs(coarse.truth[name] - fine.truth[name]).max() for name in coarse.truth) < 1e-7


def test_a_force_of_the_caller_acts_in_body_axes_and_is_felt_by_the_accelerometer() -> None:
    """A side force f at hover: the body drifts with f t/m, and ay reads f/m."""

    def wind(_t: float, _q: np.ndarray, _v: np.ndarray) -> np.ndarray:
        return 0.3 * np.eye(6)[PLACES.index("body.f_y")]

    u = np.full(4, CRAFT.hover)
    y, n = REST, CRAFT.gain * u
    for k in range(50):
        y = fly(CRAFT, y, n, u, 0.02 * k, 0.02, QUIET, wind)
    assert y[8] == pytest.approx(0.3 * 1.0 / CRAFT.m, rel=1e-12)
    run = record(seed=1, conditions=replace(CONDITIONS, duration=1.0, process={}), force=wind)
    assert run.truth["clean.ay"] == pytest.approx(np.full(50, 0.2), rel=1e-12)


@pytest.mark.slow
def test_the_flight_excites_all_axes_and_stays_near_where_it_began() -> None:
    run = record(seed=3)
    assert all(run.truth[f"body.{rate}"].std() > 0.3 for rate in ("p", "q", "r"))
    assert run.truth["body.w"].std() > 0.2
    assert max(np.abs(run.truth[f"body.{i}"]).max() for i in ("phi", "theta")) < 0.8
    assert max(np.abs(run.truth[f"body.{i}"]).max() for i in ("x", "y", "z")) < 20.0
    noise = run.outputs["q"] - run.truth["clean.q"]
    assert noise.std() == pytest.approx(CONDITIONS.noise["q"], rel=0.08)
