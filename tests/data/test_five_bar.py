"""The simulated manipulator against the published equations in minimal coordinates, and conserved energy."""

from dataclasses import replace

import numpy as np
import pytest

from backsight.data.generators import five_bar
from backsight.data.generators.five_bar import CONDITIONS, Arm, record

ARM = Arm()


def inner(arm: Arm, q: float) -> tuple[float, float]:
    """theta_3, theta_4 of the published closed formulas."""
    away = arm.l_4**2 + arm.l_2**2 - 2 * arm.l_2 * arm.l_4 * np.cos(q)
    aim = np.arctan2(-arm.l_4 * np.sin(q), arm.l_2 - arm.l_4 * np.cos(q))
    theta_3 = aim + np.arccos((away - arm.l_3**2 + arm.l_5**2) / (2 * arm.l_5 * np.sqrt(away)))
    return theta_3, aim + np.arccos((away + arm.l_3**2 - arm.l_5**2) / (-2 * arm.l_3 * np.sqrt(away)))


def functions(arm: Arm, q: float) -> np.ndarray:
    """f_1, f_2, f_3 of the published kinetic energy T = f_1 theta_1'^2 + f_2 theta_2'^2 + f_3 theta_1' theta_2'."""
    A_1 = arm.P_1 + arm.m_3 * ((arm.l_1 + arm.l_2) ** 2 + arm.r_3**2) + arm.P_2 + arm.m_4 * (arm.l_1**2 + arm.r_4**2) + arm.P_3
    A_1 += arm.P_4 * (arm.l_1**2 + arm.l_4**2) + arm.P_6
    A_2 = arm.m_4 * arm.l_1 * arm.r_4 + arm.P_4 * arm.l_1 * arm.l_4
    A_3, A_4, A_5 = arm.P_5 * arm.l_1, arm.m_3 * (arm.l_1 + arm.l_2) * arm.r_3, arm.P_5 * arm.l_4
    A_6, A_7, A_8 = arm.m_4 * arm.r_4**2 + arm.P_3 + arm.P_4 * arm.l_4**2, arm.P_6, arm.m_3 * arm.r_3**2 + arm.P_2
    t3, t4 = inner(arm, q)
    b = arm.l_4 / arm.l_5 * np.sin(t4 - q) / np.sin(t3 - t4)
    a = arm.l_4 / arm.l_3 * np.sin(t3 - q) / np.sin(t3 - t4)
    f_1 = A_1 / 2 + A_2 * np.cos(q) + A_3 * np.cos(t3) + A_4 * np.cos(t4) + A_5 * np.cos(q - t3)
    f_2 = A_6 / 2 + A_7 / 2 * b**2 + A_8 / 2 * a**2 + A_5 * np.cos(q - t3) * b
    f_3 = A_6 + A_2 * np.cos(q) + A_5 * np.cos(q - t3) + (A_7 + A_3 * np.cos(t3) + A_5 * np.cos(q - t3)) * b + (A_8 + A_4 * np.cos(t4)) * a
    return np.array([f_1, f_2, f_3])


@pytest.mark.parametrize("theta_2", [-0.5, -0.21, 0.0, 0.3, 0.5])
def test_the_loop_is_closed_where_the_published_formulas_close_it(theta_2: float) -> None:
    assert ARM.loop(theta_2) == pytest.approx(inner(ARM, theta_2), abs=1e-13)


@pytest.mark.parametrize("theta_2", [-0.45, -0.1, 0.2, 0.45])
def test_masses_and_centrifugal_torques_are_those_of_the_published_equations(theta_2: float) -> None:
    """Eqs 3.3 and 3.4: 2 f_1, f_3, 2 f_2 are the masses; the rest is in df_i/d theta_2, here by differences."""
    arm, h = replace(ARM, P_2=0.008, P_5=0.12, m_3=0.3), 1e-3
    rates = np.array([0.9, -1.7])
    M, torque = arm.equations(np.array([0.4, theta_2]), rates)
    f = functions(arm, theta_2)
    offsets = np.array([functions(arm, theta_2 + k * h) for k in (-2, -1, 1, 2)])
    df = (offsets[0] - 8 * offsets[1] + 8 * offsets[2] - offsets[3]) / (12 * h)
    assert np.array([[2 * f[0], f[2]], [f[2], 2 * f[1]]]) == pytest.approx(M, rel=1e-12)
    expected = [2 * df[0] * rates[0] * rates[1] + df[2] * rates[1] ** 2, -df[0] * rates[0] ** 2 + df[1] * rates[1] ** 2]
    assert torque == pytest.approx(expected, rel=1e-8)


def test_without_torques_it_keeps_its_energy_and_with_them_it_takes_up_their_work() -> None:
    run = record(seed=1, conditions=replace(CONDITIONS, duration=3.0, process={}))
    q, v = (np.column_stack([run.truth[f"joint_{i}.{name}"] for i in (1, 2)]) for name in ("phi", "omega"))
    torque = np.column_stack([run.inputs["tau_1"], run.inputs["tau_2"]])
    work = np.concatenate([[0.0], np.cumsum((torque[:-1] * np.diff(q, axis=0)).sum(1))])
    energy = np.array([ARM.energy(*at) for at in zip(q, v, strict=True)])
    assert energy.max() > 0.01
    assert np.abs(energy - work).max() < 1e-9


def test_combinations_that_no_motion_can_tell_apart_move_alike() -> None:
    """m_3 + c with P_1 - c/8, P_2 + c/100, P_4 - c/2, P_5 - 0.11 c, P_6 - 0.0242 c: the same masses in every position."""
    c = 0.05
    other = replace(
        ARM,
        m_3=ARM.m_3 + c,
        P_1=ARM.P_1 - c / 8,
        P_2=ARM.P_2 + c / 100,
        P_4=ARM.P_4 - c / 2,
        P_5=ARM.P_5 - 0.11 * c,
        P_6=ARM.P_6 - 0.0242 * c,
    )
    for theta_2 in (-0.4, 0.1, 0.4):
        at = np.array([0.0, theta_2]), np.array([1.0, -2.0])
        for mine, its in zip(ARM.equations(*at), other.equations(*at), strict=True):
            assert mine == pytest.approx(its, rel=1e-10)


def test_halving_the_step_of_the_integration_changes_nothing_that_matters(monkeypatch) -> None:
    short = replace(CONDITIONS, duration=1.0)
    coarse = record(seed=1, conditions=short).truth
    monkeypatch.setattr(five_bar, "STEPS", 2)
    fine = record(seed=1, conditions=short).truth
    assert max(np.abs(coarse[name] - fine[name]).max() for name in coarse) < 1e-10


def test_encoders_can_be_coarse_and_the_motors_keep_their_limits() -> None:
    step = 2 * np.pi / 4096
    coarse = replace(CONDITIONS, duration=1.5, noise={"theta_1": 0.0, "theta_2": 0.0}, resolution={"theta_1": step, "theta_2": step})
    run = record(seed=2, conditions=coarse)
    for name in ("theta_1", "theta_2"):
        assert np.abs(run.outputs[name] - run.truth[f"clean.{name}"]).max() <= step / 2 + 1e-12
    assert np.abs(run.inputs["tau_1"]).max() <= 2.0
    assert np.abs(run.inputs["tau_2"]).max() <= 1.0
