"""Consistent values: constraints kept, closed loops assembled near their start values, branches followed, and what is refused."""

from typing import Any

import numpy as np
import pytest

from backsight.models import Component, Equation, Model, SolveError, Variable, compile_model, equal, simulate
from backsight.models.mechanics.planar import PlanarFixed, PointMass, Rod
from backsight.models.plants import five_bar


class TwoBranches(Component):
    """x' = 1,  z^2 = 1 + x: z = +-sqrt(1 + x)."""

    x = Variable("1", state=True)
    z = Variable("1", start=-1.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.x), 1.0), "square": equal(c.z**2, 1 + c.x)}


def branches() -> Any:
    return compile_model(Model(name="m", components={"a": TwoBranches()}))


def test_an_algebraic_variable_stays_on_the_branch_it_started_on() -> None:
    t = np.linspace(0.0, 10.0, 6)
    assert simulate(branches(), t).algebraics["a.z"] == pytest.approx(-np.sqrt(1 + t), abs=1e-12)
    assert simulate(branches(), t, initial={"a.z": 0.3}).algebraics["a.z"] == pytest.approx(np.sqrt(1 + t), abs=1e-12)


def test_equations_that_cannot_be_fulfilled_are_named_with_the_variable_to_start_elsewhere() -> None:
    with pytest.raises(
        SolveError, match=r"no consistent configuration of 'm' was found at t = 0 s: 'square of a' .*give a.z a start value"
    ):
        simulate(branches(), [0.0, 1.0], initial={"a.x": -3.0})


def test_a_closed_loop_is_assembled_from_rough_guesses_and_stays_closed() -> None:
    """The tips of links 3 and 56 meet; the lengths are those of the plant."""
    dae = compile_model(five_bar())
    t = np.linspace(0.0, 2.0, 41)
    given = {"joint_1.phi": 0.3, "joint_2.phi": 0.2, "joint_3.phi": 2.5, "joint_4.phi": 0.4}
    run = simulate(dae, t, {"tau_1": 0.02, "tau_2": -0.01}, initial=given)
    assert (run.states["joint_1.phi"][0], run.states["joint_2.phi"][0]) == (0.3, 0.2)
    one, two = run.states["joint_1.phi"], run.states["joint_2.phi"]
    three, four = (run.algebraics[f"joint_{k}.phi"] for k in (3, 4))
    left = 0.5 * np.exp(1j * one) + 0.20 * np.exp(1j * (one + three))
    right = 0.25 * np.exp(1j * one) + 0.10 * np.exp(1j * (one + two)) + 0.22 * np.exp(1j * (one + two + four))
    assert np.abs(left - right).max() < 1e-12
    assert np.abs(np.diff(three)).max() < 0.5  # no jump to the other way to assemble it


def test_a_pendulum_in_cartesian_coordinates_keeps_its_length_and_its_energy_for_a_hundred_seconds() -> None:
    model = Model(
        name="pendulum",
        components={"bob": PointMass(m=2.0), "rod": Rod(length=1.3), "pin": PlanarFixed()},
        connections=[("pin.point", "rod.point_a"), ("rod.point_b", "bob.point")],
    )
    start = {"bob.x": 1.3 * np.sin(2.0), "bob.y": -1.3 * np.cos(2.0)}
    s = simulate(compile_model(model), np.linspace(0.0, 100.0, 201), initial=start).states
    assert np.abs(np.hypot(s["bob.x"], s["bob.y"]) - 1.3).max() < 1e-14
    assert np.abs(s["bob.x"] * s["bob.v_x"] + s["bob.y"] * s["bob.v_y"]).max() < 1e-13
    energy = (s["bob.v_x"] ** 2 + s["bob.v_y"] ** 2) / 2 + 9.81 * s["bob.y"]
    assert np.abs(energy - energy[0]).max() < 1e-12 * 9.81 * 1.3
