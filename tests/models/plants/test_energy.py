"""Every plant keeps its energy when nothing drives it, rubs or damps; the energies are written here from the geometry of each plant.

A constant or gravitational force is kept on where there is one: it has a potential.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from backsight.models import compile_model, simulate
from backsight.models.plants import PLANTS

Array = NDArray[np.float64]
States = Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class Free:
    """A plant that is left alone: what is switched off, how it starts, how long it moves, and its energy [J] at each sample."""

    values: Mapping[str, float]
    initial: Mapping[str, float]
    duration: float
    energy: Callable[[States], Array]


def of_the_axis(s: States) -> Array:
    return 95.109 * s["carriage.v"] ** 2 / 2 - 3.165 * s["carriage.s"]  # the offset is a weight that pulls forth


def of_the_gantry(s: States) -> Array:
    r, b, y = 0.010, 1.0, 0.010 * s["drive_3.phi"]
    w_1, w_2, w_3 = (s[f"drive_{i}.omega"] for i in (1, 2, 3))
    x_1, x_2, v_1, v_2 = r * s["drive_1.phi"], r * s["drive_2.phi"], r * w_1, r * w_2
    tool = v_1 + (v_2 - v_1) * y / b + (x_2 - x_1) * r * w_3 / b
    turning = 8.5 * 1.25**2 / 12 * ((v_1 - v_2) / b) ** 2
    kinetic = 2.33e-3 * w_1**2 + 2.37e-4 * w_3**2 + 3.8 * (v_1**2 + v_2**2) + 8.5 * ((v_1 + v_2) / 2) ** 2 + turning
    kinetic = kinetic + 2.3 * (tool**2 + (r * w_3) ** 2)
    return (kinetic + 0.275 * (s["drive_1.phi"] - s["drive_2.phi"]) ** 2) / 2


def of_the_drillstring(s: States) -> Array:
    magnetic, elastic = 0.116 * s["motor.i"] ** 2, 0.0868 * s["string.dphi"] ** 2
    return (magnetic + 0.3 * s["rotary_table.omega"] ** 2 + elastic + 0.0529 * s["bha.omega"] ** 2) / 2


def of_the_five_bar(s: States) -> Array:
    return np.array(
        [_of_the_links(*(float(s[f"joint_{i}.{q}"][k]) for q in ("phi", "omega") for i in (1, 2))) for k in range(len(s["joint_1.phi"]))]
    )


def _of_the_links(phi_1: float, phi_2: float, w_1: float, w_2: float) -> float:
    """Kinetic energy of the links and their height on a table tilted by 0.4, with joint 5 where two circles meet."""

    def ahead(angle: float) -> Array:
        return np.array([np.cos(angle), np.sin(angle)])

    def across(arm: Array) -> Array:
        return np.array([-arm[1], arm[0]])

    link_12, link_4, w_4 = ahead(phi_1), ahead(phi_1 + phi_2), w_1 + w_2
    joint_2, joint_3 = 0.25 * link_12, 0.50 * link_12
    joint_4 = joint_2 + 0.10 * link_4
    v_2, v_3 = w_1 * across(joint_2), w_1 * across(joint_3)
    v_4 = v_2 + w_4 * across(0.10 * link_4)
    apart = joint_3 - joint_4
    d = np.linalg.norm(apart)
    foot = (d**2 + 0.22**2 - 0.20**2) / (2 * d)
    joint_5 = joint_4 + foot * apart / d + np.sqrt(0.22**2 - foot**2) * across(apart / d)
    link_3, link_56 = joint_5 - joint_3, joint_5 - joint_4
    v_5 = np.linalg.solve([link_3, link_56], [link_3 @ v_3, link_56 @ v_4])  # neither link changes its length
    w_3, w_56 = across(link_3) @ (v_5 - v_3) / 0.20**2, across(link_56) @ (v_5 - v_4) / 0.22**2
    first_56 = 0.1442 * link_56 / 0.22
    v_centre_3, v_centre_4 = v_3 + w_3 * across(link_3) / 2, v_2 + w_4 * across(0.05 * link_4)
    kinetic = 0.1080 * w_1**2 + 0.005422 * w_3**2 + 0.25 * v_centre_3 @ v_centre_3 + 0.01029 * w_4**2 + 0.15 * v_centre_4 @ v_centre_4
    kinetic += 0.6059 * v_4 @ v_4 + 2 * w_56 * v_4 @ across(first_56) + 0.04350 * w_56**2
    moment = 0.15 * link_12 + 0.25 * (joint_3 + link_3 / 2) + 0.15 * (joint_2 + 0.05 * link_4) + 0.6059 * joint_4 + first_56
    return float(kinetic / 2 + 9.81 * np.sin(0.4) * moment[1])


def of_the_quadrotor(s: States) -> Array:
    moving = 1.5 * (s["body.u"] ** 2 + s["body.v"] ** 2 + s["body.w"] ** 2) / 2
    turning = (0.015 * s["body.p"] ** 2 + 0.020 * s["body.q"] ** 2 + 0.028 * s["body.r"] ** 2) / 2
    return moving + turning - 1.5 * 9.81 * s["body.z"]


FREE = {
    "actuator": Free(
        values={"friction.d": 0.0, "friction.f_c": 0.0},
        initial={"carriage.s": 0.01, "carriage.v": -0.2},
        duration=5.0,
        energy=of_the_axis,
    ),
    "xy_table": Free(
        values={f"friction_{i}.tau_c": 0.0 for i in (1, 2, 3)},
        initial={"drive_1.phi": 1.0, "drive_2.phi": 0.2, "drive_3.phi": 30.0, "drive_1.omega": 2.0, "drive_3.omega": 8.0},
        duration=2.0,
        energy=of_the_gantry,
    ),
    "drillstring": Free(
        values=dict.fromkeys(("motor.R", "rotary_table.d", "bha.d", "bit.tau_sl", "bit.tau_st"), 0.0),
        initial={"motor.i": 0.5, "string.dphi": 3.0, "bha.omega": -2.0},
        duration=5.0,
        energy=of_the_drillstring,
    ),
    "five_bar": Free(
        values={"world.tilt": 0.4},
        initial={"joint_1.phi": 0.3, "joint_2.phi": -0.2, "joint_1.omega": 1.0, "joint_2.omega": 0.5},
        duration=0.8,
        energy=of_the_five_bar,
    ),
    "quadrotor": Free(
        values={"body.Iyy": 0.020, **{f"body.drag_{axis}": 0.0 for axis in "uvwpqr"}},
        initial={"body.u": 2.0, "body.w": -5.0, "body.p": 3.0, "body.q": 0.8, "body.r": -2.0},
        duration=1.0,
        energy=of_the_quadrotor,
    ),
}


@pytest.mark.parametrize("name", sorted(PLANTS))
def test_a_plant_that_is_left_alone_keeps_its_energy(name: str) -> None:
    free = FREE[name]
    dae = compile_model(PLANTS[name]())
    t = np.linspace(0.0, free.duration, 41)
    run = simulate(dae, t, {q.name: 0.0 for q in dae.inputs}, free.values, free.initial)
    energy = free.energy(run.states)
    exchanged = max(float(np.ptp(column)) / max(float(np.abs(column).max()), 1e-12) for column in run.states.values())
    assert exchanged > 0.5  # it moves
    assert energy == pytest.approx(np.full(len(t), energy[0]), rel=1e-8)
