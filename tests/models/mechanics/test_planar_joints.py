"""Joints: their motions and forces against textbook equations, friction and springs on their axes, residuals at their names."""

import math

import numpy as np
import pytest

from backsight.models import Dae, Model, compile_model, simulate
from backsight.models.mechanics.planar import Body, FixedRotation, FixedTranslation, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import RotationalFriction, Torque
from backsight.models.mechanics.translational import Spring

G = 9.81
VERTICAL = World(g=G, tilt=math.pi / 2)


def accelerations(dae: Dae, initial: dict[str, float], inputs: dict[str, float] | None = None) -> dict[str, float]:
    run = simulate(dae, [0.0], inputs, initial=initial)
    return {name: float(column[0]) for name, column in run.derivatives.items()}


def double_pendulum(*, bodies_first: bool = False) -> Model:
    joints = {"shoulder": Revolute(), "elbow": Revolute()}
    bodies = {"upper": Body(m=1.1, x_c=0.2, I=0.02), "lower": Body(m=0.6, x_c=0.15, I=0.01)}
    return Model(
        name="double",
        components={
            "world": VERTICAL,
            "ground": FrameFixed(),
            **(bodies | joints if bodies_first else joints | bodies),
            "arm": FixedTranslation(r_x=0.5),
            "motor": Torque(),
        },
        connections=[
            ("ground.frame", "shoulder.frame_a"),
            ("shoulder.frame_b", "upper.frame"),
            ("upper.frame", "arm.frame_a"),
            ("arm.frame_b", "elbow.frame_a"),
            ("elbow.frame_b", "lower.frame"),
            ("motor.flange", "elbow.axis"),
        ],
        inputs={"tau": "motor.tau"},
    )


@pytest.mark.parametrize("bodies_first", [False, True])
def test_a_double_pendulum_accelerates_as_the_lagrange_equations_in_relative_angles_say(bodies_first: bool) -> None:
    (m1, c1, i1), (m2, c2, i2), l1 = (1.1, 0.2, 0.02), (0.6, 0.15, 0.01), 0.5
    dae = compile_model(double_pendulum(bodies_first=bodies_first))
    assert {q.name for q in dae.states} == {"shoulder.phi", "shoulder.omega", "elbow.phi", "elbow.omega"}
    rng = np.random.default_rng(1)
    for _ in range(3):
        q1, q2, v1, v2, tau = rng.uniform(-3, 3, 5)
        # R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, eq. (4.11)
        alpha, beta, delta = i1 + i2 + m1 * c1**2 + m2 * (l1**2 + c2**2), m2 * l1 * c2, i2 + m2 * c2**2
        mass = [[alpha + 2 * beta * np.cos(q2), delta + beta * np.cos(q2)], [delta + beta * np.cos(q2), delta]]
        coriolis = beta * np.sin(q2) * np.array([-(2 * v1 + v2) * v2, v1**2])
        weight = G * np.array([(m1 * c1 + m2 * l1) * np.cos(q1) + m2 * c2 * np.cos(q1 + q2), m2 * c2 * np.cos(q1 + q2)])
        truth = np.linalg.solve(mass, [0, tau] - coriolis - weight)
        state = {"shoulder.phi": q1, "elbow.phi": q2, "shoulder.omega": v1, "elbow.omega": v2}
        found = accelerations(dae, state, {"tau": tau})
        assert [found["shoulder.omega"], found["elbow.omega"]] == pytest.approx(truth, rel=1e-10)


def test_the_force_in_a_hinge_of_a_swinging_pendulum_is_weight_and_centripetal_force() -> None:
    model = Model(
        name="pendulum",
        components={"world": VERTICAL, "ground": FrameFixed(), "pivot": Revolute(), "bob": Body(m=0.7, x_c=1.3, I=0.0)},
        connections=[("ground.frame", "pivot.frame_a"), ("pivot.frame_b", "bob.frame")],
        outputs={"up": "ground.frame.f_y", "across": "ground.frame.f_x"},
    )
    run = simulate(compile_model(model), [0.0], initial={"pivot.phi": -np.pi / 2, "pivot.omega": 2.0})  # through the lowest point
    assert run.outputs["up"][0] == pytest.approx(-0.7 * (G + 1.3 * 2.0**2))  # the force of the pendulum on the ground
    assert run.outputs["across"][0] == pytest.approx(0.0, abs=1e-12)


def on_a_slide(direction: float) -> Model:
    return Model(
        name="slide",
        components={
            "world": VERTICAL,
            "ground": FrameFixed(phi_0=0.3),
            "slide": Prismatic(direction=direction),
            "block": Body(m=2.0, x_c=0.1, I=0.3),
        },
        connections=[("ground.frame", "slide.frame_a"), ("slide.frame_b", "block.frame")],
    )


def test_a_block_slides_down_an_incline_with_the_share_of_gravity_along_it() -> None:
    dae = compile_model(on_a_slide(0.4))
    assert [q.name for q in dae.states] == ["slide.s", "slide.v"]
    assert accelerations(dae, {})["slide.v"] == pytest.approx(-G * np.sin(0.7))


def test_a_spring_on_the_axis_of_a_slide_makes_it_oscillate_about_its_sag() -> None:
    k = 50.0
    dae = compile_model(on_a_slide(0.4).insert("slide", Spring(k=k)))
    sag = -2.0 * G * np.sin(0.7) / k
    t = np.linspace(0.0, 2.0, 41)
    assert simulate(dae, t).states["slide.s"] == pytest.approx(sag * (1 - np.cos(np.sqrt(k / 2.0) * t)), abs=1e-9)


def test_a_bead_on_a_turning_rod_keeps_angular_momentum_and_energy() -> None:
    model = Model(
        name="bead",
        components={
            "world": World(),
            "ground": FrameFixed(),
            "hub": Revolute(),
            "rod": Body(m=1.0, I=0.08),
            "slide": Prismatic(),
            "bead": Body(m=0.5, I=0.002),
        },
        connections=[
            ("ground.frame", "hub.frame_a"),
            ("hub.frame_b", "rod.frame"),
            ("rod.frame", "slide.frame_a"),
            ("slide.frame_b", "bead.frame"),
        ],
    )
    s = simulate(compile_model(model), np.linspace(0, 2, 41), initial={"slide.s": 0.1, "hub.omega": 5.0}).states
    inertia = 0.082 + 0.5 * s["slide.s"] ** 2
    assert s["slide.s"][-1] > 0.5
    assert inertia * s["hub.omega"] == pytest.approx(np.full(41, inertia[0] * 5.0), rel=1e-9)
    assert inertia * s["hub.omega"] ** 2 + 0.5 * s["slide.v"] ** 2 == pytest.approx(np.full(41, inertia[0] * 25.0), rel=1e-9)


def wheel() -> Model:
    return Model(
        name="wheel",
        components={"world": World(), "ground": FrameFixed(), "hub": Revolute(), "turn": FixedRotation(angle=0.4), "rim": Body(I=0.25)},
        connections=[("ground.frame", "hub.frame_a"), ("hub.frame_b", "turn.frame_a"), ("turn.frame_b", "rim.frame")],
        residuals=("hub",),
    )


def test_friction_inserted_at_a_joint_slows_its_motion() -> None:
    dae = compile_model(wheel().insert("hub", RotationalFriction(d=0.5)))
    t = np.linspace(0.0, 1.0, 11)
    assert simulate(dae, t, initial={"hub.omega": 3.0}).states["hub.omega"] == pytest.approx(3.0 * np.exp(-0.5 / 0.25 * t), rel=1e-8)


def test_a_rotated_frame_turns_with_its_body() -> None:
    dae = compile_model(wheel())
    assert float(dae.probe("rim.phi")(0, [0.3, 0.0], 0, 0, dae.parameter_values(), 0, 0)) == pytest.approx(0.7)


def test_a_residual_at_a_joint_is_a_torque_along_its_motion() -> None:
    dae = compile_model(wheel())
    assert [(p.name, p.unit, p.kind) for p in dae.places] == [("hub", "N.m", "law")]
    residual = dae.function()([0.0, 3.0], [0.0, 0.0], [], [], dae.parameter_values(), [0.1], 0)[0]
    assert float(residual[1]) == pytest.approx(0.25 * 3.0 - 0.1)
    assert dict(dae.merged_places)["rim.phi"] == "hub"
