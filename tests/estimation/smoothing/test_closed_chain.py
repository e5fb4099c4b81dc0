"""A slider crank, whose slide hangs on the crank's angle through a closed chain.

Truth is the textbook's closed form, and the torque that it asks for.
"""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.smoothing.mesh_error import ALLOWED
from backsight.models import Model, compile_model
from backsight.models.mechanics.planar import Accelerometer, Body, FixedTranslation, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import RotationalFixed, RotationalFriction, Torque
from backsight.ocp.pieces import direct

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


def test_a_chain_is_closed_at_the_samples_as_far_as_their_noise_asks():
    """Between the points of its mesh a chain is not closed; no force acts on a reading of it at once, and the mesh may be refined."""
    result = smooth(
        Problem(
            model=slider_crank(),
            recordings=[recorded()],
            parameters={"crank.I": Free(0.005, min=1e-6), "piston.m": Free(1.0, min=1e-3), "bearing.d": Free(0.008, min=0.0)},
        )
    )
    rows = result.estimates["run"]
    away = rows["x"].to_numpy() - slide(rows["th"].to_numpy())[0]
    assert np.sqrt(np.mean(away**2)) < 2 * ALLOWED * NOISE["x"]
    V = {name: fit.rms for name, fit in result.fit["run"].items()}
    assert pytest.approx(NOISE, rel=0.05) == V
    assert not any("something is left out" in note for note in result.notes)
    for name, true in (("crank.I", INERTIA), ("piston.m", MASS), ("bearing.d", DAMPING)):
        p = result.parameters[name]
        assert abs(p.value - true) < 4 * p.std < 0.01 * true


def test_no_force_and_no_input_is_read_at_once_through_a_chain_of_positions():
    dae = compile_model(slider_crank())
    assert {q.name for q in dae.algebraics} == {"pin.phi", "rail.s"}
    assert [part.nnz() for part in direct(dae, range(len(dae.places)))] == [0, 0]


def test_an_accelerometer_beside_it_reads_both_at_once():
    model = slider_crank()
    parts = {**model.components, "sensor": Accelerometer()}
    shaken = Model(
        name="shaken",
        components=parts,
        connections=[*model.connections, ("sensor.frame", "piston.frame")],
        states=model.states,
        start=model.start,
        inputs=model.inputs,
        outputs={**model.outputs, "a": "sensor.a_x"},
    )
    dae = compile_model(shaken)
    E, D = direct(dae, range(len(dae.places)))
    read = [q.name == "a" for q in dae.outputs]
    assert [E[i, :].nnz() > 0 for i in range(E.shape[0])] == read
    assert [D[i, :].nnz() > 0 for i in range(D.shape[0])] == read
