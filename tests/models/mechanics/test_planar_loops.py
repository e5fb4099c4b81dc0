"""Closed loops in minimal coordinates: a slider-crank in closed form, a four-bar linkage by Freudenstein's equation."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.models import Dae, Model, compile_model, simulate
from backsight.models.mechanics.planar import Accelerometer, Body, FixedTranslation, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import Torque

G = 9.81
R, L = 0.1, 0.3
CRANK, ROD, PISTON = {"m": 0.8, "x_c": 0.05, "I": 2e-3}, {"m": 0.5, "x_c": 0.12, "I": 4e-3}, {"m": 1.2, "I": 0.0}


def slider_crank(states: tuple[str, ...] = ("crank_joint.phi",)) -> Model:
    """In the vertical plane, the piston moving horizontally."""
    return Model(
        name="slider_crank",
        components={
            "world": World(g=G, tilt=math.pi / 2),
            "ground": FrameFixed(),
            "crank_joint": Revolute(),
            "pin": Revolute(),
            "wrist": Revolute(),
            "guide": Prismatic(),
            "crank": Body(**CRANK),
            "rod": Body(**ROD),
            "piston": Body(**PISTON),
            "crank_tip": FixedTranslation(r_x=R),
            "rod_tip": FixedTranslation(r_x=L),
            "motor": Torque(),
            "imu": Accelerometer(gravity=0.0),
        },
        connections=[
            ("ground.frame", "crank_joint.frame_a"),
            ("crank_joint.frame_b", "crank.frame"),
            ("crank.frame", "crank_tip.frame_a"),
            ("crank_tip.frame_b", "pin.frame_a"),
            ("pin.frame_b", "rod.frame"),
            ("rod.frame", "rod_tip.frame_a"),
            ("rod_tip.frame_b", "wrist.frame_a"),
            ("wrist.frame_b", "piston.frame"),
            ("ground.frame", "guide.frame_a"),
            ("guide.frame_b", "piston.frame"),
            ("motor.flange", "crank_joint.axis"),
            ("imu.frame", "piston.frame"),
        ],
        inputs={"tau": "motor.tau"},
        outputs={"s": "guide.s", "v": "guide.v", "a": "imu.a_x"},
        states=states,
        start={"guide.s": R + L},
        residuals=("crank_joint",),
    )


def position(phi: ca.SX) -> ca.SX:
    return R * ca.cos(phi) + ca.sqrt(L**2 - (R * ca.sin(phi)) ** 2)


def by_energies() -> ca.Function:
    """(phi, omega, tau) -> acceleration of the crank, from d/dt dT/domega - dT/dphi = tau - dV/dphi with one coordinate."""
    phi, omega, tau = ca.SX.sym("phi"), ca.SX.sym("omega"), ca.SX.sym("tau")
    lean = -ca.asin(R * ca.sin(phi) / L)  # of the rod
    share = ROD["x_c"]
    centres = [
        (CRANK, CRANK["x_c"] * ca.cos(phi), CRANK["x_c"] * ca.sin(phi), phi),
        (ROD, R * ca.cos(phi) + share * ca.cos(lean), R * ca.sin(phi) + share * ca.sin(lean), lean),
        (PISTON, position(phi), ca.SX(0), ca.SX(0)),
    ]
    inertia = sum(
        b["m"] * (ca.jacobian(x, phi) ** 2 + ca.jacobian(y, phi) ** 2) + b["I"] * ca.jacobian(angle, phi) ** 2 for b, x, y, angle in centres
    )
    weight = sum(b["m"] * G * ca.jacobian(y, phi) for b, _, y, _ in centres)
    return ca.Function("truth", [phi, omega, tau], [(tau - weight - ca.jacobian(inertia, phi) * omega**2 / 2) / inertia])


def test_a_slider_crank_has_one_coordinate_no_invariant_and_two_loop_unknowns() -> None:
    dae = compile_model(slider_crank())
    assert [q.name for q in dae.states] == ["crank_joint.phi", "crank_joint.omega"]
    assert [q.name for q in dae.algebraics] == ["pin.phi", "guide.s"]
    assert (dae.invariants.shape[0], dae.kinematics, dae.index) == (0, ((0, 1, 0),), 3)
    assert [p.name for p in dae.places] == ["crank_joint"]
    assert ca.DM(ca.jacobian(dae.residual, dae.w)).full()[:, 0].tolist() == [0.0, -1.0, 0.0, 0.0]


def test_a_slider_crank_turns_right_round_as_its_closed_form_says() -> None:
    t = np.linspace(0.0, 1.0, 201)
    run = simulate(compile_model(slider_crank()), t, {"tau": 0.5}, initial={"crank_joint.phi": 0.3, "crank_joint.omega": 15.0})
    phi, omega, alpha = run.states["crank_joint.phi"], run.states["crank_joint.omega"], run.derivatives["crank_joint.omega"]
    acceleration = by_energies()
    truth = solve_ivp(
        lambda _, q: [q[1], float(acceleration(*q, 0.5))], (0, 1), [0.3, 15.0], method="DOP853", rtol=1e-11, atol=1e-12, t_eval=t
    ).y
    assert phi[-1] > 4 * np.pi
    assert phi == pytest.approx(truth[0], abs=1e-7)
    assert omega == pytest.approx(truth[1], abs=1e-6)
    assert alpha == pytest.approx([float(acceleration(p, w, 0.5)) for p, w in zip(phi, omega, strict=True)], rel=1e-9, abs=1e-9)
    q = ca.SX.sym("q")
    first = ca.jacobian(position(q), q)
    shape = ca.Function("shape", [q], [position(q), first, ca.jacobian(first, q)]).map(len(t))
    s, by_phi, twice = (column.full()[0] for column in shape(phi))
    assert run.outputs["s"] == pytest.approx(s, abs=1e-12)
    assert run.outputs["v"] == pytest.approx(by_phi * omega, abs=1e-10)
    assert run.outputs["a"] == pytest.approx(by_phi * alpha + twice * omega**2, rel=1e-9, abs=1e-8)


def test_a_slider_crank_in_the_position_of_its_piston_moves_the_same_between_dead_centres() -> None:
    dae = compile_model(slider_crank(("guide.s",)))
    assert [q.name for q in dae.states] == ["guide.s", "guide.v"]
    phi, omega = 1.0, 2.0
    s = float(ca.evalf(position(ca.DM(phi))))
    v = -omega * R * np.sin(phi) * s / (s - R * np.cos(phi))
    run = simulate(dae, [0.0], {"tau": 0.5}, initial={"guide.s": s, "guide.v": v, "crank_joint.phi": 0.9, "pin.phi": -1.2})
    assert run.algebraics["crank_joint.phi"][0] == pytest.approx(phi)
    q = ca.SX.sym("q")
    first = ca.jacobian(position(q), q)
    by_phi, twice = (float(e) for e in ca.Function("shape", [q], [first, ca.jacobian(first, q)])(phi))
    assert run.derivatives["guide.v"][0] == pytest.approx(by_phi * float(by_energies()(phi, omega, 0.5)) + twice * omega**2, rel=1e-9)


def test_without_named_states_a_loop_keeps_its_coordinates_and_its_invariants_and_moves_the_same() -> None:
    dae = compile_model(slider_crank(()))
    assert [q.name for q in dae.states] == [
        f"{j}" for j in ("crank_joint.phi", "crank_joint.omega", "pin.phi", "pin.omega", "guide.s", "guide.v")
    ]
    assert dae.invariants.shape[0] == 4
    phi, omega = 0.8, 5.0
    s = float(ca.evalf(position(ca.DM(phi))))
    lean = -np.arcsin(R * np.sin(phi) / L)
    turn = -R * np.cos(phi) / (L * np.cos(lean)) * omega
    v = -R * np.sin(phi) * omega - L * np.sin(lean) * turn
    initial = {
        "crank_joint.phi": phi,
        "crank_joint.omega": omega,
        "pin.phi": lean - phi,
        "pin.omega": turn - omega,
        "guide.s": s,
        "guide.v": v,
    }
    run = simulate(dae, [0.0, 0.05], {"tau": 0.5}, initial=initial)
    least = simulate(compile_model(slider_crank()), [0.0, 0.05], {"tau": 0.5}, initial={"crank_joint.phi": phi, "crank_joint.omega": omega})
    assert run.derivatives["crank_joint.omega"][0] == pytest.approx(float(by_energies()(phi, omega, 0.5)), rel=1e-9)
    assert run.states["crank_joint.phi"][1] == pytest.approx(least.states["crank_joint.phi"][1], rel=1e-8)


A, B, C, D = 0.10, 0.26, 0.20, 0.30  # crank, coupler, rocker, ground of a crank-rocker


def four_bar() -> Model:
    return Model(
        name="four_bar",
        components={
            "world": World(),
            "ground": FrameFixed(),
            "far": FrameFixed(x_0=D),
            "input": Revolute(),
            "coupler_joint": Revolute(),
            "rocker_joint": Revolute(),
            "closing": Revolute(),
            "crank": Body(m=0.3, x_c=A / 2, I=3e-4),
            "coupler": Body(m=0.5, x_c=B / 2, y_c=0.02, I=3e-3),
            "rocker": Body(m=0.4, x_c=C / 2, I=2e-3),
            "crank_tip": FixedTranslation(r_x=A),
            "coupler_tip": FixedTranslation(r_x=B),
            "rocker_tip": FixedTranslation(r_x=C),
        },
        connections=[
            ("ground.frame", "input.frame_a"),
            ("input.frame_b", "crank.frame"),
            ("crank.frame", "crank_tip.frame_a"),
            ("crank_tip.frame_b", "coupler_joint.frame_a"),
            ("coupler_joint.frame_b", "coupler.frame"),
            ("coupler.frame", "coupler_tip.frame_a"),
            ("far.frame", "rocker_joint.frame_a"),
            ("rocker_joint.frame_b", "rocker.frame"),
            ("rocker.frame", "rocker_tip.frame_a"),
            ("coupler_tip.frame_b", "closing.frame_a"),
            ("rocker_tip.frame_b", "closing.frame_b"),
        ],
        outputs={"rocker": "rocker.phi", "rate": "rocker_joint.omega", "closing": "closing.phi"},
        states=("input.phi",),
        start={"rocker_joint.phi": 1.5, "coupler_joint.phi": 0.5},
    )


def energy(dae: Dae, x: np.ndarray, z: np.ndarray) -> float:
    """Kinetic energy from the centres' velocities, of the declared variables."""
    bodies = {"crank": (0.3, A / 2, 0.0, 3e-4), "coupler": (0.5, B / 2, 0.02, 3e-3), "rocker": (0.4, C / 2, 0.0, 2e-3)}
    words = ("phi", "v_x", "v_y", "omega")
    values = dae.probe(*(f"{b}.{w}" for b in bodies for w in words))(
        np.zeros(2), x, z, [], dae.parameter_values(), np.zeros(len(dae.places)), 0
    )
    total = 0.0
    for (m, x_c, y_c, inertia), (phi, v_x, v_y, omega) in zip(bodies.values(), values.full().reshape(3, 4), strict=True):
        across_x, across_y = -np.sin(phi) * x_c - np.cos(phi) * y_c, np.cos(phi) * x_c - np.sin(phi) * y_c
        total += 0.5 * (m * ((v_x + omega * across_x) ** 2 + (v_y + omega * across_y) ** 2) + inertia * omega**2)
    return total


def test_a_four_bar_linkage_follows_the_freudenstein_equation_and_keeps_its_energy() -> None:
    dae = compile_model(four_bar())
    assert [q.name for q in dae.states] == ["input.phi", "input.omega"]
    run = simulate(dae, np.linspace(0.0, 2.0, 101), initial={"input.phi": 0.2, "input.omega": 8.0})
    crank, rocker = run.states["input.phi"], run.outputs["rocker"]
    assert crank[-1] > 2 * np.pi
    assert np.ptp(rocker) > 0.5
    # F. Freudenstein, Trans. ASME 77, 1955: K1 cos(rocker) - K2 cos(crank) + K3 = cos(crank - rocker)
    k1, k2, k3 = D / A, D / C, (A**2 - B**2 + C**2 + D**2) / (2 * A * C)
    assert k1 * np.cos(rocker) - k2 * np.cos(crank) + k3 == pytest.approx(np.cos(crank - rocker), abs=1e-11)
    slope = (np.sin(crank - rocker) + k2 * np.sin(crank)) / (np.sin(crank - rocker) + k1 * np.sin(rocker))  # d rocker / d crank
    assert run.outputs["rate"] == pytest.approx(slope * run.states["input.omega"], rel=1e-9, abs=1e-9)
    x, z = np.array(list(run.states.values())), np.array(list(run.algebraics.values()))
    kept = [energy(dae, x[:, k], z[:, k]) for k in range(0, 101, 10)]
    assert kept == pytest.approx(np.full(11, kept[0]), rel=1e-8)


def test_the_angle_of_the_joint_that_closes_a_loop_follows_from_the_others() -> None:
    run = simulate(compile_model(four_bar()), [0.0, 0.3], initial={"input.phi": 0.2, "input.omega": 8.0})
    others = run.states["input.phi"] + run.algebraics["coupler_joint.phi"]
    assert run.outputs["closing"] == pytest.approx(run.algebraics["rocker_joint.phi"] - others)
