"""A motor whose current follows its voltage at once: what its input does stands in an equation that has no force of its own."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, diagnose, smooth
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.scores.supermodel import Look, looked_at
from backsight.models import Model
from backsight.models.electrical import EMF, ElectricalGround, Resistor, Voltage
from backsight.models.mechanics.rotational import Inertia, RotationalDamper, RotationalFixed

R, K, J, D = 2.0, 0.05, 1e-4, 2e-4
STEP, PER, NOISE = 2e-3, 20, 2e-4


def machine() -> Model:
    return Model(
        name="motor",
        components={
            "amplifier": Voltage(), "winding": Resistor(R=R), "emf": EMF(k=K), "zero": ElectricalGround(),
            "rotor": Inertia(J=J), "bearing": RotationalDamper(d=D), "housing": RotationalFixed(),
        },
        connections=[
            ("amplifier.p", "winding.p"), ("winding.n", "emf.p"), ("emf.n", "amplifier.n"), ("amplifier.n", "zero.pin"),
            ("emf.flange", "rotor.flange"), ("rotor.flange", "bearing.flange_a"), ("bearing.flange_b", "housing.flange"),
        ],
        inputs={"u": "amplifier.v"},
        outputs={"phi": "rotor.phi"},
    )  # fmt: skip


def recorded(zone: float, seed: int, role: str = "fit") -> Recording:
    """Two seconds, steps of 0.1 ms; the amplifier has nothing to give below a voltage and so much less beyond it."""
    rng = np.random.default_rng(seed)
    rates, sizes, phases = rng.uniform(0.5, 4.0, 5), rng.uniform(0.5, 1.5, 5), rng.uniform(0, 6, 5)
    phi = omega = 0.0
    rows = []
    for n in range(1000):
        u = float(np.sum(sizes * np.sin(2 * np.pi * rates * n * STEP + phases)))
        rows.append((u, phi + NOISE * rng.normal()))
        given = np.sign(u) * max(abs(u) - zone, 0.0)
        for _ in range(PER):
            omega += STEP / PER * (K / R * (given - K * omega) - D * omega) / J
            phi += STEP / PER * omega
    u, phi_read = np.array(rows).T
    return Recording(
        name=role, role=role, time=np.arange(1000) * STEP, inputs={"u": u}, outputs={"phi": phi_read}, output_std={"phi": NOISE}
    )


def posed(*recordings: Recording, **W: float) -> Problem:
    free = {"rotor.J": Free(1.2e-4, min=1e-6), "bearing.d": Free(1e-4, min=0.0)}
    return Problem(model=machine(), recordings=list(recordings), parameters=free, weights=Weights(W=W))


@pytest.fixture(scope="module")
def motor() -> tuple[Recording, Sizes, list[Look], Smoothing]:
    recording = recorded(0.0, 1)
    problem = posed(recording, rotor=1e-5)
    result = smooth(problem)
    assert result.solution is not None
    base = Linearised(result.solution)
    return (
        recording,
        Sizes(problem, result, base),
        looked_at(problem, problem.model, base, library(problem, problem.model, result.solution)),
        result,
    )


def test_its_current_is_no_state_and_has_no_residual_force(motor):
    dae = motor[3].solution.transcription.dae
    assert [q.name for q in dae.algebraics] == ["winding.i"]
    assert [p.name for p in dae.places] == ["rotor"]


@pytest.mark.parametrize(("physics", "share"), [("input_gain", 0.1), ("input_offset", 0.3)])
def test_what_its_input_does_is_a_torque(motor, physics, share):
    recording, sizes, looks, _ = motor
    look = next(look for look in looks if look.candidate.physics == physics)
    u = recording.inputs["u"]
    volts = share * (u if physics == "input_gain" else np.ones_like(u))
    expected = K / R * np.sqrt(np.mean(volts**2)) / sizes.varying["rotor"]
    assert sizes.shares(look, np.array([share])) == {"rotor": pytest.approx(expected, rel=0.02)}


@pytest.mark.slow
def test_a_dead_zone_of_its_amplifier_is_found():
    found = diagnose(posed(recorded(0.4, 1), recorded(0.4, 2, "held_out")))
    (finding,) = found.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("input:u", "input_dead_zone")
    assert finding.explanation.parameters["width"].value == pytest.approx(0.4, abs=0.02)
    assert finding.share is not None
    assert finding.share > 0.05
