"""Drag in the plane, against how a puck slows down and how a spinning plate stops."""

import numpy as np
import pytest

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.planar import Body, LinearDrag, QuadraticDrag, World
from backsight.models.mechanics.planar.drag import Drag

M, I, V_X, V_Y = 2.0, 0.3, 3.0, -4.0
T = np.linspace(0.0, 2.0, 21)


def puck(drag: Drag, **start: float) -> dict[str, np.ndarray]:
    model = Model(
        name="puck",
        components={"world": World(), "body": Body(m=M, I=I), "drag": drag},
        connections=[("body.frame", "drag.frame")],
    )
    return simulate(compile_model(model), T, initial={f"body.{word}": value for word, value in start.items()}).states


def test_in_oil_the_velocity_decays() -> None:
    found = puck(LinearDrag(d=0.7), v_x=V_X, v_y=V_Y, omega=2.0)
    assert found["body.v_x"] == pytest.approx(V_X * np.exp(-0.7 / M * T), rel=1e-7)
    assert found["body.v_y"] == pytest.approx(V_Y * np.exp(-0.7 / M * T), rel=1e-7)
    assert found["body.omega"] == pytest.approx(np.full_like(T, 2.0), rel=1e-9)


def test_in_air_it_slows_down_by_its_square_along_its_way_whatever_direction_that_has() -> None:
    c, v = 0.4, np.hypot(V_X, V_Y)
    found = puck(QuadraticDrag(c=c, width=1e-6), v_x=V_X, v_y=V_Y)
    speed = v / (1.0 + c * v / M * T)
    assert found["body.v_x"] == pytest.approx(V_X / v * speed, rel=1e-6)
    assert found["body.v_y"] == pytest.approx(V_Y / v * speed, rel=1e-6)


def test_beside_the_centre_it_turns_the_body_too() -> None:
    """Of a plate that spins while its centre stands still: m v' = f, I omega' = r x f, all linear in a frame that turns with it."""
    r, omega = 0.25, 1e-4  # so slow that it hardly turns
    d = 0.7
    found = puck(LinearDrag(d=d, x_c=r), omega=omega)
    # along y: m v' = -d (v + r w), I w' = -d r (v + r w)
    A = -d * np.array([[1 / M, r / M], [r / I, r**2 / I]])
    rate = np.trace(A)  # the other eigenvalue is nothing: the momenta keep a combination
    slip = r * omega * np.exp(rate * T)
    assert found["body.v_y"] + r * found["body.omega"] == pytest.approx(slip, rel=1e-6)
    assert M * r * found["body.v_y"] - I * found["body.omega"] == pytest.approx(np.full_like(T, -I * omega), rel=1e-6)
