"""The rigid body in space against momentum balances in earth axes, closed forms and conserved quantities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from backsight.models import Model, ModelError, compile_model, simulate
from backsight.models.mechanics.spatial import BodyForce, BodyTorque, Gyro, LinearDrag, RigidBody

Array = NDArray[np.float64]
FORCE, TORQUE = np.array([0.7, -0.4, -9.0]), np.array([0.02, -0.03, 0.01])
INERTIA = np.array([[0.30, -0.02, 0.03], [-0.02, 0.50, 0.04], [0.03, 0.04, 0.70]])
TENSOR = {"Ixx": 0.30, "Iyy": 0.50, "Izz": 0.70, "Ixy": -0.02, "Ixz": 0.03, "Iyz": 0.04}
DOWN = np.array([0.0, 0.0, 9.81])


def free(body: RigidBody) -> Model:
    """The body with a sensor, and nothing that pushes it but gravity."""
    return Model(name="free", components={"body": body, "gyro": Gyro()}, connections=[("body.frame", "gyro.frame")])


def driven(body: RigidBody) -> Model:
    return Model(
        name="driven",
        components={"body": body, "push": BodyForce(), "turn": BodyTorque()},
        connections=[("body.frame", "push.frame"), ("body.frame", "turn.frame")],
        inputs={
            name: f"{part}.{name}" for part, names in (("push", "f_x f_y f_z"), ("turn", "tau_x tau_y tau_z")) for name in names.split()
        },
    )


def columns(states: Mapping[str, Array], *names: str) -> Array:
    return np.array([states[f"body.{name}"] for name in names]).T


def attitude(states: Mapping[str, Array]) -> Rotation:
    """Body axes to earth axes."""
    return Rotation.from_euler("ZYX", columns(states, "psi", "theta", "phi"))


def test_it_moves_as_the_balances_of_momentum_in_earth_axes_say() -> None:
    m, D, D_omega = 1.3, np.array([0.2, 0.5, 0.9]), np.array([0.3, 0.1, 0.4])
    position, nu, omega = np.array([1.0, -2.0, 0.5]), np.array([2.0, -1.0, 0.5]), np.array([0.9, -0.7, 1.1])
    turned = Rotation.from_euler("ZYX", [0.4, -0.3, 0.2]).as_matrix()

    def momentum(_: float, s: Array) -> Array:
        velocity, R, h = s[3:6], s[6:15].reshape(3, 3), s[15:18]
        omega = np.linalg.solve(INERTIA, R.T @ h)
        force = R @ (FORCE - D * (R.T @ velocity)) + m * DOWN
        torque = R @ (TORQUE - D_omega * (INERTIA @ omega))
        cross = np.array([[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]])
        return np.concatenate([velocity, force / m, (R @ cross).ravel(), torque])

    t = np.linspace(0.0, 1.5, 16)
    start = np.concatenate([position, turned @ nu, turned.ravel(), turned @ INERTIA @ omega])
    truth = solve_ivp(momentum, (0, t[-1]), start, t_eval=t, method="DOP853", rtol=1e-12, atol=1e-13).y.T
    R = truth[:, 6:15].reshape(-1, 3, 3)

    drag = dict(zip(("drag_u", "drag_v", "drag_w", "drag_p", "drag_q", "drag_r"), [*D, *D_omega], strict=True))
    inputs = dict(zip(("f_x", "f_y", "f_z", "tau_x", "tau_y", "tau_z"), [*FORCE, *TORQUE], strict=True))
    names = [f"body.{name}" for name in ("x", "y", "z", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")]
    initial = dict(zip(names, [*position, *nu, 0.2, -0.3, 0.4, *omega], strict=True))
    s = simulate(compile_model(driven(RigidBody(m=m, **TENSOR, **drag))), t, inputs, initial=initial).states
    assert np.cos(s["body.theta"]).min() > 0.3
    assert columns(s, "x", "y", "z") == pytest.approx(truth[:, :3], abs=1e-8)
    assert columns(s, "u", "v", "w") == pytest.approx(np.einsum("nji,nj->ni", R, truth[:, 3:6]), abs=1e-8)
    assert attitude(s).as_matrix() == pytest.approx(R, abs=1e-8)
    assert columns(s, "p", "q", "r") == pytest.approx(np.linalg.solve(INERTIA, np.einsum("nji,nj->ni", R, truth[:, 15:18]).T).T, abs=1e-8)


def test_a_tumbling_body_keeps_its_energy_and_its_angular_momentum_in_earth_axes() -> None:
    t = np.linspace(0.0, 6.0, 121)
    initial = {"body.p": 0.05, "body.q": 0.0, "body.r": 3.0, "body.u": 2.0, "body.v": -1.0, "body.w": 0.3}
    body = RigidBody(m=1.3, Ixx=0.30, Iyy=0.60, Izz=0.45, Ixy=-0.02, g=0.0)  # about the middle axis: unstable
    tensor = np.array([[0.30, -0.02, 0.0], [-0.02, 0.60, 0.0], [0.0, 0.0, 0.45]])
    s = simulate(compile_model(free(body)), t, initial=initial).states
    assert np.cos(s["body.theta"]).min() > 0.02
    omega, nu = columns(s, "p", "q", "r"), columns(s, "u", "v", "w")
    assert np.abs(omega[:, 0]).max() > 1.0
    spinning, moving = np.sum(omega @ tensor * omega, axis=1) / 2, 1.3 * np.sum(nu**2, axis=1) / 2
    assert spinning == pytest.approx(np.full(len(t), spinning[0]), rel=1e-8)
    assert moving == pytest.approx(np.full(len(t), moving[0]), rel=1e-8)
    for vector in (omega @ tensor, nu):
        kept = attitude(s).apply(vector)
        assert np.abs(kept - kept[0]).max() < 1e-8 * np.linalg.norm(kept[0])


def test_a_symmetric_top_without_torque_nods_and_wobbles_in_closed_form() -> None:
    across, along, p, r = 0.4, 0.7, 0.6, 5.0
    wobble, momentum = (along - across) / across * r, np.hypot(across * p, along * r)
    t = np.linspace(0.0, 5.0, 51)
    initial = {"body.p": p, "body.r": r, "body.theta": -np.arcsin(across * p / momentum)}  # its angular momentum points down
    s = simulate(compile_model(free(RigidBody(Ixx=across, Iyy=across, Izz=along))), t, initial=initial).states
    assert columns(s, "p", "q", "r") == pytest.approx(np.array([p * np.cos(wobble * t), p * np.sin(wobble * t), 0 * t + r]).T, abs=1e-8)
    assert s["body.theta"] == pytest.approx(-np.arcsin(across * p * np.cos(wobble * t) / momentum), abs=1e-8)
    assert s["body.phi"] == pytest.approx(np.arctan2(across * p * np.sin(wobble * t), along * r), abs=1e-8)


def test_a_thrown_body_flies_a_parabola_however_it_turns() -> None:
    t = np.linspace(0.0, 1.0, 11)
    initial = {"body.p": 1.0, "body.q": -0.8, "body.r": 2.0, "body.u": 3.0, "body.v": 1.0, "body.w": -4.0, "body.psi": 0.5}
    s = simulate(compile_model(free(RigidBody(m=0.2, **TENSOR))), t, initial=initial).states
    thrown = Rotation.from_euler("z", 0.5).apply([3.0, 1.0, -4.0])
    assert columns(s, "x", "y", "z") == pytest.approx(np.outer(t, thrown) + np.outer(t**2 / 2, DOWN), abs=1e-8)


def test_a_level_body_falls_towards_its_terminal_velocity() -> None:
    t = np.linspace(0.0, 3.0, 7)
    s = simulate(compile_model(free(RigidBody(m=1.5, drag_w=3.0))), t).states
    assert s["body.w"] == pytest.approx(1.5 * 9.81 / 3.0 * (1 - np.exp(-2.0 * t)), rel=1e-9, abs=1e-12)


def test_a_heavy_start_of_rotation_dies_with_the_rotational_drag() -> None:
    t = np.linspace(0.0, 2.0, 5)
    s = simulate(compile_model(free(RigidBody(Izz=0.03, drag_r=1.7))), t, initial={"body.r": 2.0}).states
    assert s["body.r"] == pytest.approx(2.0 * np.exp(-1.7 * t), rel=1e-9)


def test_six_balances_carry_a_residual_each_that_is_a_force_or_torque_in_body_axes() -> None:
    dae = compile_model(driven(RigidBody(m=2.0, **TENSOR)))
    assert [(p.name, p.unit, p.kind) for p in dae.places] == [
        *((f"body.f_{axis}", "N", "balance") for axis in "xyz"),
        *((f"body.tau_{axis}", "N.m", "balance") for axis in "xyz"),
    ]
    rng = np.random.default_rng(4)
    dx, x = rng.normal(size=12), rng.normal(size=12)
    w = np.concatenate([FORCE, TORQUE])
    pushed, _ = dae.function()(dx, x, [], w, dae.parameter_values(), np.zeros(6), 0)
    unexplained, _ = dae.function()(dx, x, [], np.zeros(6), dae.parameter_values(), w, 0)
    assert unexplained.full() == pytest.approx(pushed.full(), abs=1e-12)


def test_an_element_is_inserted_at_the_body_by_its_name() -> None:
    t = np.array([0.0, 1.0])
    still = free(RigidBody(m=2.0, g=0.0)).insert("body", LinearDrag(d=0.6))
    s = simulate(compile_model(still), t, initial={"body.u": 1.0}).states
    assert s["body.u"][1] == pytest.approx(np.exp(-0.3), rel=1e-9)


def test_the_states_keep_their_names_whatever_is_attached() -> None:
    names = [f"body.{name}" for name in ("x", "y", "z", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")]
    dae = compile_model(driven(RigidBody()))
    assert ([q.name for q in dae.states], len(dae.algebraics), dae.index) == (names, 0, 0)


def test_an_element_that_needs_the_attitude_names_the_body_it_lacks() -> None:
    lost = Model(
        name="lost",
        components={"drag": LinearDrag(), "push": BodyForce()},
        connections=[("drag.frame", "push.frame")],
        inputs={f"f_{axis}": f"push.f_{axis}" for axis in "xyz"},
    )
    with pytest.raises(ModelError, match="LinearDrag 'drag' needs the model's RigidBody, and 'lost' has none"):
        compile_model(lost)
