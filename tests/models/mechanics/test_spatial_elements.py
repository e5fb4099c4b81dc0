"""Drag, wind, added mass and given forces on a body in space, by closed forms and conserved momenta."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import fresnel

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.spatial import (
    AddedMass,
    BodyElement,
    ConstantBodyForce,
    ConstantForce,
    DragMoment,
    LinearDrag,
    QuadraticDrag,
    RigidBody,
)

Array = NDArray[np.float64]


def columns(states: Mapping[str, Array], *names: str) -> Array:
    return np.array([states[f"body.{name}"] for name in names]).T


def attitude(states: Mapping[str, Array]) -> Rotation:
    """Body axes to earth axes."""
    return Rotation.from_euler("ZYX", columns(states, "psi", "theta", "phi"))


def held(element: BodyElement, **body: float) -> Model:
    return Model(name="held", components={"body": RigidBody(**body), "element": element}, connections=[("body.frame", "element.frame")])


def test_linear_drag_slows_the_plane_of_the_rotors_and_the_axis_on_their_own() -> None:
    t = np.linspace(0.0, 2.0, 5)
    run = simulate(compile_model(held(LinearDrag(d=0.6, d_z=0.2), m=1.5, g=0.0)), t, initial={"body.u": 3.0, "body.v": -2.0, "body.w": 1.0})
    expected = np.outer(np.exp(-0.4 * t), [3.0, -2.0, 0.0]) + np.outer(np.exp(-0.2 / 1.5 * t), [0.0, 0.0, 1.0])
    assert columns(run.states, "u", "v", "w") == pytest.approx(expected, rel=1e-9)


def test_a_body_with_drag_drifts_with_the_wind_of_the_earth_however_it_is_turned() -> None:
    t = np.linspace(0.0, 2.0, 5)
    wind = np.array([4.0, -1.0, 0.5])
    drag = LinearDrag(d=0.6, d_z=0.6, wind_x=wind[0], wind_y=wind[1], wind_z=wind[2])
    initial = {"body.phi": 0.3, "body.theta": -0.5, "body.psi": 2.0, "body.p": 0.4, "body.r": 1.0}
    s = simulate(compile_model(held(drag, m=1.5, g=0.0)), t, initial=initial).states
    velocity = attitude(s).apply(columns(s, "u", "v", "w"))
    assert velocity == pytest.approx(np.outer(1 - np.exp(-0.4 * t), wind), rel=1e-8, abs=1e-12)


def test_a_drag_moment_turns_a_body_away_from_where_it_flies() -> None:
    """Of a sphere of inertia J that hardly turns: its rate about y is c_y u t/J, about x -c_x v t/J."""
    t = np.linspace(0.0, 0.02, 5)
    body = {"m": 1.5, "g": 0.0, "Ixx": 0.5, "Iyy": 0.5, "Izz": 0.5}
    s = simulate(
        compile_model(held(DragMoment(c_x=0.03, c_y=0.05), **body)), t, initial={"body.u": 3.0, "body.v": -2.0, "body.w": 1.0}
    ).states
    assert columns(s, "p", "q", "r") == pytest.approx(np.outer(t, [0.03 * 2.0, 0.05 * 3.0, 0.0]) / 0.5, rel=2e-3, abs=1e-9)
    moved = attitude(s).apply(columns(s, "u", "v", "w"))
    assert moved == pytest.approx(np.tile([3.0, -2.0, 1.0], (len(t), 1)), abs=1e-8)


def test_with_quadratic_drag_a_level_fall_follows_the_hyperbolic_tangent() -> None:
    t = np.linspace(0.0, 2.0, 5)
    s = simulate(compile_model(held(QuadraticDrag(c=0.4), m=1.5)), t).states
    final = np.sqrt(1.5 * 9.81 / 0.4)
    assert s["body.w"] == pytest.approx(final * np.tanh(9.81 * t / final), rel=1e-8, abs=1e-12)


def test_quadratic_drag_points_against_the_velocity() -> None:
    t = np.linspace(0.0, 2.0, 5)
    s = simulate(compile_model(held(QuadraticDrag(c=0.4), m=1.5, g=0.0)), t, initial={"body.u": 3.0, "body.v": -4.0}).states
    expected = np.outer(1 / (1 + 0.4 / 1.5 * 5.0 * t), [3.0, -4.0, 0.0])
    assert columns(s, "u", "v", "w") == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_quadratic_drag_of_what_is_flat_leaves_the_fall_alone() -> None:
    t = np.linspace(0.0, 2.0, 5)
    s = simulate(compile_model(held(QuadraticDrag(c=0.4, share_z=0.0), m=1.5)), t, initial={"body.u": 3.0, "body.v": -4.0}).states
    across = np.outer(1 / (1 + 0.4 / 1.5 * 5.0 * t), [3.0, -4.0])
    assert columns(s, "u", "v") == pytest.approx(across, rel=1e-6, abs=1e-9)
    assert s["body.w"] == pytest.approx(9.81 * t, rel=1e-6, abs=1e-9)


def test_at_rest_quadratic_drag_has_a_slope() -> None:
    dae = compile_model(held(QuadraticDrag(c=0.4)))
    slope = ca.Function("slope", [dae.dx, dae.x, dae.p, dae.w], [ca.jacobian(dae.residual, dae.x)])
    assert np.all(np.isfinite(slope(np.zeros(12), np.zeros(12), dae.parameter_values(), np.zeros(6)).full()))


def test_a_body_with_a_point_mass_moves_about_their_common_centre() -> None:
    m, extra, r = 1.5, 0.4, np.array([0.2, -0.1, 0.3])
    inertia = np.array([0.03, 0.05, 0.04])
    body = held(AddedMass(m=extra, x=r[0], y=r[1], z=r[2]), m=m, Ixx=inertia[0], Iyy=inertia[1], Izz=inertia[2])
    t = np.linspace(0.0, 1.0, 21)
    initial = {"body.p": 1.0, "body.q": -0.5, "body.r": 1.5, "body.u": 2.0, "body.w": -3.0}
    s = simulate(compile_model(body), t, initial=initial).states
    turned, omega = attitude(s), columns(s, "p", "q", "r")
    position, velocity = columns(s, "x", "y", "z"), turned.apply(columns(s, "u", "v", "w"))
    other, other_velocity = position + turned.apply(r), velocity + turned.apply(np.cross(omega, r))
    centre, centre_velocity = ((m * a + extra * b) / (m + extra) for a, b in ((position, other), (velocity, other_velocity)))
    parabola = centre[0] + np.outer(t, centre_velocity[0]) + np.outer(t**2 / 2, [0, 0, 9.81])
    assert centre == pytest.approx(parabola, abs=1e-8)
    momentum = turned.apply(inertia * omega)
    for mass, where, how in ((m, position, velocity), (extra, other, other_velocity)):
        momentum = momentum + mass * np.cross(where - centre, how - centre_velocity)
    assert momentum == pytest.approx(np.tile(momentum[0], (len(t), 1)), abs=1e-8 * np.linalg.norm(momentum[0]))


def test_a_constant_force_and_torque_act_along_the_axes_of_the_body() -> None:
    t = np.linspace(0.0, 1.0, 5)
    run = simulate(compile_model(held(ConstantBodyForce(f_x=0.6, tau_z=0.2), m=1.5, Izz=0.5, g=0.0)), t)
    assert run.states["body.psi"] == pytest.approx(0.2 * t**2, abs=1e-10)
    velocity = attitude(run.states).apply(columns(run.states, "u", "v", "w"))
    s, c = fresnel(np.sqrt(0.4 / np.pi) * t)  # int cos(0.2 t^2), int sin(0.2 t^2)
    assert velocity[:, :2] == pytest.approx(0.4 * np.sqrt(np.pi / 0.4) * np.array([c, s]).T, abs=1e-9)


def test_a_force_of_the_earth_pushes_a_tumbling_body_straight_on() -> None:
    t = np.linspace(0.0, 2.0, 5)
    initial = {"body.phi": 0.3, "body.theta": -0.5, "body.psi": 2.0, "body.p": 0.4, "body.r": 1.0}
    s = simulate(compile_model(held(ConstantForce(f=0.6, direction=0.7), m=1.5, g=0.0)), t, initial=initial).states
    velocity = attitude(s).apply(columns(s, "u", "v", "w"))
    assert velocity == pytest.approx(np.outer(0.4 * t, [np.cos(0.7), np.sin(0.7), 0.0]), rel=1e-8, abs=1e-10)
