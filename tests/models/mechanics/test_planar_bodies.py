"""Rigid bodies in the plane: free flight, the compound pendulum, gravity of the world, linearity in the moments."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.special import ellipk

from backsight.models import Model, ModelError, compile_model, simulate
from backsight.models.mechanics.planar import Body, FrameFixed, Gyro, MomentBody, Revolute, World
from backsight.models.mechanics.planar.bodies import RigidBody

VERTICAL = World(g=9.81, tilt=math.pi / 2)


def free(body: RigidBody, world: World = VERTICAL) -> Model:
    return Model(
        name="free",
        components={"world": world, "body": body, "gyro": Gyro()},
        connections=[("body.frame", "gyro.frame")],
        outputs={"omega": "gyro.omega"},
    )


def pendulum(body: RigidBody) -> Model:
    return Model(
        name="pendulum",
        components={"world": VERTICAL, "ground": FrameFixed(), "pivot": Revolute(), "body": body},
        connections=[("ground.frame", "pivot.frame_a"), ("pivot.frame_b", "body.frame")],
    )


def test_the_centre_of_mass_of_a_thrown_body_moves_on_a_parabola_while_it_turns_evenly() -> None:
    x_c, y_c, omega = 0.3, -0.2, 4.0
    t = np.linspace(0.0, 1.0, 41)
    start = {"body.v_x": 2.0, "body.v_y": 3.0, "body.omega": omega}
    run = simulate(compile_model(free(Body(m=2.0, x_c=x_c, y_c=y_c, I=0.7))), t, initial=start)
    s = run.states
    cos, sin = np.cos(s["body.phi"]), np.sin(s["body.phi"])
    assert s["body.phi"] == pytest.approx(omega * t, abs=1e-9)
    assert s["body.x"] + cos * x_c - sin * y_c == pytest.approx(x_c + (2.0 - omega * y_c) * t, abs=1e-9)
    assert s["body.y"] + sin * x_c + cos * y_c == pytest.approx(y_c + (3.0 + omega * x_c) * t - 9.81 / 2 * t**2, abs=1e-9)


def test_a_free_body_keeps_a_residual_for_each_of_its_balances() -> None:
    dae = compile_model(free(Body()))
    assert [q.name for q in dae.states] == [f"body.{q}" for q in ("x", "y", "phi", "v_x", "v_y", "omega")]
    assert [(p.name, p.unit, p.enabled) for p in dae.places] == [("body.x", "N", True), ("body.y", "N", True), ("body.phi", "N.m", True)]


def test_a_body_by_its_moments_moves_as_the_one_by_its_centre_of_mass() -> None:
    m, x_c, y_c, inertia = 1.7, 0.3, 0.1, 0.4
    by_centre = compile_model(free(Body(m=m, x_c=x_c, y_c=y_c, I=inertia)))
    by_moments = compile_model(free(MomentBody(m=m, m_x=m * x_c, m_y=m * y_c, J=inertia + m * (x_c**2 + y_c**2))))
    rng = np.random.default_rng(0)
    for _ in range(5):
        dx, x = rng.normal(size=6), rng.normal(size=6)
        rows = [dae.function()(dx, x, [], [], dae.parameter_values(), [0, 0, 0], 0)[0] for dae in (by_centre, by_moments)]
        assert rows[0].full() == pytest.approx(rows[1].full(), rel=1e-12, abs=1e-14)


def test_the_balances_are_linear_in_mass_and_moments() -> None:
    dae = compile_model(free(MomentBody()))
    names = ["body.m", "body.m_x", "body.m_y", "body.J"]
    theta = ca.vertcat(*(dae.p[[q.name for q in dae.parameters].index(name)] for name in names))
    slopes = ca.jacobian(dae.residual, theta)
    assert slopes.nnz() > 0
    assert ca.jacobian(slopes, theta).nnz() == 0


def test_a_compound_pendulum_returns_after_the_period_of_the_elliptic_integral() -> None:
    m, d, inertia, angle = 1.3, 0.4, 0.05, 2.0
    period = 4.0 * np.sqrt((inertia + m * d**2) / (m * 9.81 * d)) * ellipk(np.sin(angle / 2) ** 2)
    dae = compile_model(pendulum(Body(m=m, x_c=d, I=inertia)))
    assert [q.name for q in dae.states] == ["pivot.phi", "pivot.omega"]
    run = simulate(dae, np.array([0.0, period / 2, 3 * period]), initial={"pivot.phi": -np.pi / 2 + angle})
    assert run.states["pivot.phi"] + np.pi / 2 == pytest.approx(angle * np.array([1.0, -1.0, 1.0]), abs=1e-8)


def test_only_the_second_moment_of_a_body_that_turns_about_its_frame_matters_in_the_horizontal_plane() -> None:
    level = {"world": World(), "body": MomentBody(m=5.0, m_x=0.7, m_y=-0.3, J=0.2)}
    model = pendulum(MomentBody()).replace("world", level["world"]).replace("body", level["body"])
    dae = compile_model(model)
    row = ca.Function("row", [dae.dx, dae.x, dae.p, dae.w], [dae.residual[1]])
    assert float(row([0, 3.0], [0.4, 2.0], dae.parameter_values(), [0.0])) == pytest.approx(0.2 * 3.0)


def test_gravity_pulls_down_the_slope_of_a_tilted_plane() -> None:
    tilt, direction = 0.2, 0.7
    run = simulate(compile_model(free(Body(), World(g=9.7, tilt=tilt, direction=direction))), [0.0, 1.0])
    fall = 9.7 * np.sin(tilt) / 2
    assert run.states["body.x"][1] == pytest.approx(fall * np.cos(direction))
    assert run.states["body.y"][1] == pytest.approx(fall * np.sin(direction))


def test_the_plane_is_horizontal_by_default() -> None:
    run = simulate(compile_model(free(Body(), World())), [0.0, 1.0])
    assert (run.states["body.x"][1], run.states["body.y"][1]) == (0.0, 0.0)


def test_a_body_without_a_world_is_named() -> None:
    with pytest.raises(ModelError, match=r"Body 'body' needs the model's World, and 'pendulum' has none; add one, e.g. world=World\(\)"):
        compile_model(pendulum(Body()).without("world"))
