"""Algebraic variables along a trajectory, against closed forms."""

from __future__ import annotations

from math import acos, pi

import numpy as np
from examples import HARDENING, compiled, stiffening

from backsight.models import compile_model
from backsight.models.plants import five_bar
from backsight.ocp.algebraic import algebraics_along

DAE = compile_model(five_bar())
VALUES = np.array(DAE.parameter_values())


def triangles(theta_2: np.ndarray) -> dict[str, np.ndarray]:
    """Angles of joints 3 and 4: the tip of link 4 and joint 3 are the ends of a line that links 3 and 56 span as a triangle."""
    l_2, l_3, l_4, l_5 = 0.25, 0.20, 0.10, 0.22
    across, along = -l_4 * np.sin(theta_2), l_2 - l_4 * np.cos(theta_2)
    d, aim = np.hypot(across, along), np.arctan2(across, along)
    at_tip = np.arccos((l_5**2 + d**2 - l_3**2) / (2 * l_5 * d))
    at_joint_3 = np.arccos((l_3**2 + d**2 - l_5**2) / (2 * l_3 * d))
    return {"joint_4.phi": aim + at_tip - theta_2, "joint_3.phi": aim + pi - at_joint_3}


def swung(theta_2: np.ndarray, parameters: np.ndarray = VALUES) -> np.ndarray:
    """z along a motion of joint 2 with joint 1 turning beside it, which must not matter."""
    count = len(theta_2)
    x = np.zeros((len(DAE.states), count))
    names = [q.name for q in DAE.states]
    x[names.index("joint_1.phi")], x[names.index("joint_2.phi")] = np.linspace(0, 1, count), theta_2
    return algebraics_along(DAE, np.zeros_like(x), x, np.zeros((2, count)), parameters, np.arange(count) * 0.01)


def test_the_angles_inside_a_loop_are_those_of_its_triangle():
    theta_2 = 0.5 * np.sin(np.linspace(0, 9, 400))
    found, true = swung(theta_2), triangles(theta_2)
    for row, q in zip(found, DAE.algebraics, strict=True):
        np.testing.assert_allclose(row, true[q.name], atol=1e-9)


def test_the_start_values_choose_the_way_in_which_the_loop_is_closed():
    sides = acos((0.22**2 + 0.15**2 - 0.20**2) / (2 * 0.22 * 0.15)), pi - acos((0.20**2 + 0.15**2 - 0.22**2) / (2 * 0.20 * 0.15))
    found = dict(zip([q.name for q in DAE.algebraics], swung(np.zeros(1))[:, 0], strict=True))
    np.testing.assert_allclose([found["joint_4.phi"], found["joint_3.phi"]], sides, atol=1e-12)


def test_beyond_the_reach_of_the_links_the_start_values_stand():
    short = VALUES.copy()
    short[[p.name for p in DAE.parameters].index("tip_3.r_x")] = 0.10
    theta_2 = np.linspace(0, pi, 200)
    distance = np.hypot(0.10 * np.sin(theta_2), 0.25 - 0.10 * np.cos(theta_2))
    found, start = swung(theta_2, short), np.array([q.start for q in DAE.algebraics])
    away = distance > 0.22 + 0.10
    assert 0 < np.sum(away) < len(away)
    np.testing.assert_array_equal(found[:, away], np.repeat(start[:, None], np.sum(away), axis=1))
    assert np.all(found[:, distance < 0.31] != start[:, None])


def test_a_deflection_is_the_root_of_its_cubic():
    dae = compiled(stiffening())
    x = np.zeros((len(dae.states), 50))
    position = next(i for i, q in enumerate(dae.states) if q.name.endswith(".s"))
    x[position] = np.linspace(-2, 2, 50)
    z = algebraics_along(dae, np.zeros_like(x), x, np.zeros((len(dae.inputs), 50)), np.array(dae.parameter_values()), np.zeros(50))
    np.testing.assert_allclose(z[0] + HARDENING * z[0] ** 3, x[position], atol=1e-12)
