"""A slider crank, whose slide hangs on the crank's angle through a closed chain, on a mesh that is coarser than the samples.

Truth is the textbook's closed form, and the torque that it asks for.
"""

from __future__ import annotations

from math import pi

import casadi as ca
import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.models import Model, compile_model
from backsight.models.mechanics.planar import Body, FixedTranslation, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import RotationalFixed, RotationalFriction, Torque
from backsight.models.plants import PLANTS
from backsight.ocp.pieces import closed

CRANK, ROD = 0.05, 0.2  # m
INERTIA, MASS, DAMPING = 0.004, 0.8, 0.01
NOISE = {"th": 2e-4, "x": 1e-5}


def slider_crank() -> Model:
    return Model(
        name="slider_crank",
        components={
            "world": World(tilt=0.0),
            "base": FrameFixed(),
            "ground": RotationalFixed(),
            "motor": Torque(),
            "bearing": RotationalFriction(d=DAMPING),
            "shaft": Revolute(),
            "crank": Body(m=0.0, I=INERTIA),
            "arm": FixedTranslation(r_x=CRANK),
            "pin": Revolute(),
            "rod": FixedTranslation(r_x=ROD),
            "wrist": Revolute(),
            "rail": Prismatic(),
            "piston": Body(m=MASS),
        },
        connections=[
            ("base.frame", "shaft.frame_a"),
            ("shaft.frame_b", "crank.frame"),
            ("crank.frame", "arm.frame_a"),
            ("arm.frame_b", "pin.frame_a"),
            ("pin.frame_b", "rod.frame_a"),
            ("rod.frame_b", "wrist.frame_a"),
            ("wrist.frame_b", "piston.frame"),
            ("base.frame", "rail.frame_a"),
            ("rail.frame_b", "piston.frame"),
            ("motor.flange", "shaft.axis"),
            ("shaft.axis", "bearing.flange_a"),
            ("bearing.flange_b", "ground.flange"),
        ],
        states=("shaft.phi",),
        start={"pin.phi": -0.5, "rail.s": 0.245},
        inputs={"tau": "motor.tau"},
        outputs={"th": "shaft.phi", "x": "rail.s"},
    )


def slide(th):
    """x of the slide, and its first and second derivatives in the angle."""
    root = np.sqrt(ROD**2 - (CRANK * np.sin(th)) ** 2)
    first = -(CRANK**2) * np.sin(th) * np.cos(th) / root
    second = -(CRANK**2) * np.cos(2 * th) / root - (CRANK**2 * np.sin(th) * np.cos(th)) ** 2 / root**3
    return CRANK * np.cos(th) + root, -CRANK * np.sin(th) + first, -CRANK * np.cos(th) + second


def recorded(step: float = 2e-3, duration: float = 3.0) -> Recording:
    t = np.arange(round(duration / step)) * step
    a, w = np.array([0.6, 0.3]), np.array([5.0, 11.0])
    th = 0.4 + 9.0 * t + np.sin(t[:, None] * w) @ a
    v, acceleration = 9.0 + np.cos(t[:, None] * w) @ (a * w), -np.sin(t[:, None] * w) @ (a * w**2)
    x, x1, x2 = slide(th)
    tau = (INERTIA + MASS * x1**2) * acceleration + MASS * x1 * x2 * v**2 + DAMPING * v
    rng = np.random.default_rng(0)
    outputs = {"th": th + NOISE["th"] * rng.standard_normal(len(t)), "x": x + NOISE["x"] * rng.standard_normal(len(t))}
    return Recording(name="run", time=t, inputs={"tau": tau}, outputs=outputs, hold="linear")


def test_what_a_chain_closes_is_closed_at_every_sample():
    result = smooth(
        Problem(
            model=slider_crank(),
            recordings=[recorded()],
            parameters={"crank.I": Free(0.005, min=1e-6), "piston.m": Free(1.0, min=1e-3), "bearing.d": Free(0.008, min=0.0)},
        )
    )
    assert np.median(result.solution.transcription.nlp.steps) > 2 * 2e-3
    rows = result.estimates["run"]
    assert np.abs(rows["x"].to_numpy() - slide(rows["th"].to_numpy())[0]).max() < 0.05 * NOISE["x"]
    V = {name: fit.rms for name, fit in result.fit["run"].items()}
    assert pytest.approx(NOISE, rel=0.05) == V
    assert not any("something is left out" in note for note in result.notes)
    for name, true in (("crank.I", INERTIA), ("piston.m", MASS), ("bearing.d", DAMPING)):
        p = result.parameters[name]
        assert abs(p.value - true) < 4 * p.std < 0.01 * true


@pytest.mark.parametrize("model", [slider_crank(), PLANTS["five_bar"]()])
def test_one_step_closes_a_chain_to_second_order(model):
    dae = compile_model(model)
    both = ca.vertcat(*(dae.variables[q.name] for q in dae.algebraics))
    G = dae.residual[[k for k, e in enumerate(dae.equations) if "position" in e.name or "connection" in e.name]]
    at = [dae.x, dae.z, [p.value for p in dae.parameters]]
    solved = ca.rootfinder("solved", "newton", ca.Function("G", [dae.z, ca.vertcat(dae.x)], [ca.substitute(G, dae.p, ca.DM(at[2]))]))
    read = ca.Function("read", [dae.x, dae.z], [ca.substitute(closed(dae, both), dae.p, ca.DM(at[2]))])
    x = np.array([q.start for q in dae.states]) + 0.1
    z = np.array(solved([q.start for q in dae.algebraics], x)).ravel()
    away = np.array([1.0, -0.5])
    errors = [np.abs(np.array(read(x, z + eps * away)).ravel() - z).max() for eps in (1e-2, 1e-3)]
    assert errors[0] < 1e-2 * pi
    assert 50.0 < errors[0] / errors[1] < 200.0


def test_what_has_no_chain_is_read_as_it_is():
    dae = compile_model(PLANTS["actuator"]())
    assert closed(dae, dae.output) is dae.output
