"""The gantry against levers and rigid-body inertias worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from backsight.models import Component, Equation, Frame, Model, SignalInput, Trajectory, compile_model, equal, simulate
from backsight.models.mechanics.gantry import Gantry
from backsight.models.mechanics.translational import Force, Mass

M_1, M_2, M_Y, B, C, M_CARRIAGE = 3.0, 5.0, 8.0, 1.6, 2.0, 1.5


class Pull(Component):
    """Force and torque on a frame, in the axes of the world."""

    f_x = SignalInput("N")
    f_y = SignalInput("N")
    tau = SignalInput("N.m")
    frame = Frame()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "force x": equal(c.frame.f_x, -c.f_x),
            "force y": equal(c.frame.f_y, -c.f_y),
            "torque": equal(c.frame.tau, -c.tau),
        }


def pushed(y: float, x: tuple[float, float] = (0.0, 0.0), **forces: float) -> Trajectory:
    """The gantry from rest with the carriage at y, under constant forces."""
    model = Model(
        name="gantry",
        components={
            "gantry": Gantry(m_y=M_Y, b=B, c=C),
            "one": Force(),
            "two": Force(),
            "three": Force(),
            "slide_1": Mass(m=M_1),
            "slide_2": Mass(m=M_2),
            "mass": Mass(m=M_CARRIAGE),
            "pull": Pull(),
        },
        connections=[
            ("slide_1.flange", "gantry.slide_1"),
            ("slide_2.flange", "gantry.slide_2"),
            ("one.flange", "gantry.slide_1"),
            ("two.flange", "gantry.slide_2"),
            ("three.flange", "gantry.carriage"),
            ("mass.flange", "gantry.carriage"),
            ("pull.frame", "gantry.tool"),
        ],
        inputs={"F_1": "one.f", "F_2": "two.f", "F_3": "three.f", "f_x": "pull.f_x", "f_y": "pull.f_y", "tau": "pull.tau"},
        outputs={"x": "gantry.tool.x", "y": "gantry.tool.y", "alpha": "gantry.tool.phi", "v_1": "gantry.v_1", "v_2": "gantry.v_2"},
        start={"slide_1.s": x[0], "slide_2.s": x[1], "mass.s": y},
    )
    inputs = {"F_1": 0.0, "F_2": 0.0, "F_3": 0.0, "f_x": 0.0, "f_y": 0.0, "tau": 0.0} | forces
    return simulate(compile_model(model), np.linspace(0.0, 1e-3, 3), inputs)


def acceleration(run: Trajectory) -> np.ndarray:
    """Of slide 1, slide 2 and the carriage, in the first millisecond from rest."""
    velocity = [run.outputs["v_1"], run.outputs["v_2"], run.outputs["y"] - run.outputs["y"][0]]
    return np.array([velocity[0][-1] / 1e-3, velocity[1][-1] / 1e-3, 2 * velocity[2][-1] / 1e-6])


def by_hand(f_1: float, f_2: float) -> list[float]:
    """Newton for the middle of the slideway and Euler about it, both slides as point masses on its ends."""
    rod = M_Y * C**2 / 12 / B**2
    matrix = [[M_1 + M_Y / 4 + rod, M_Y / 4 - rod], [M_Y / 4 - rod, M_2 + M_Y / 4 + rod]]
    return np.linalg.solve(matrix, [f_1, f_2]).tolist()


def test_forces_on_the_slides_move_them_as_point_masses_on_a_rod() -> None:
    assert acceleration(pushed(0.4, F_1=6.0, F_2=-2.0, F_3=3.0)) == pytest.approx([*by_hand(6.0, -2.0), 3.0 / M_CARRIAGE], rel=1e-6)


def test_a_force_on_the_tool_comes_to_the_slides_by_the_lever() -> None:
    assert acceleration(pushed(0.4, f_x=8.0)) == pytest.approx([*by_hand(8.0 * 0.75, 8.0 * 0.25), 0.0], rel=1e-6, abs=1e-6)


def test_a_torque_on_the_tool_is_a_couple_on_the_slides() -> None:
    assert acceleration(pushed(0.4, tau=3.2)) == pytest.approx([*by_hand(2.0, -2.0), 0.0], rel=1e-6, abs=1e-6)


def test_on_a_turned_slideway_a_force_in_x_pushes_the_carriage_along_it() -> None:
    run = pushed(0.4, x=(0.0, 0.16), f_x=8.0, f_y=1.0)
    assert acceleration(run)[2] == pytest.approx((1.0 + 8.0 * 0.16 / 1.6) / M_CARRIAGE, rel=1e-6)


def test_the_tool_is_between_the_slides_and_turns_with_the_slideway() -> None:
    run = pushed(0.4, x=(0.2, 0.04))
    assert [run.outputs[name][0] for name in ("x", "y", "alpha")] == pytest.approx([0.2 - 0.16 * 0.25, 0.4, 0.1], rel=1e-12)
