"""A body whose acceleration alone is read, driven by a force of unknown size that lags: its mass cannot be told, and is no suspect."""

from __future__ import annotations

import numpy as np

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.score import Columns, Linearised
from backsight.estimation.diagnosis.scores.screen import screen, told
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.models import Model
from backsight.models.mechanics.translational import AccelerationSensor, Force, Friction, Mass
from backsight.models.signals import Gain, Lag

M, GAIN, D, TAU = 2.0, 6.0, 3.0, 0.05


def thrown() -> Model:
    model = Model(
        name="thrown",
        components={
            "amplifier": Gain(gain=GAIN),
            "lag": Lag(tau=TAU),
            "motor": Force(),
            "body": Mass(m=M),
            "sensor": AccelerationSensor(),
        },
        connections=(
            ("amplifier.y", "lag.u"),
            ("lag.y", "motor.f"),
            ("motor.flange", "body.flange"),
            ("sensor.flange", "body.flange"),
        ),
        inputs={"u": "amplifier.u"},
        outputs={"a": "sensor.a"},
        residuals=("lag",),
    )
    return model.insert("body.flange", Friction(d=D), "drag")


def recorded() -> Recording:
    """tau f' = gain u + w - f,  m v' = f - d v, in steps of a fiftieth of a row; w is a force that the model does not know."""
    rng, h, fine = np.random.default_rng(4), 0.01, 50
    t = h * np.arange(400)
    u = np.repeat(rng.standard_normal(40), 10)
    f, v, a = 0.0, 0.0, np.zeros(400)
    for k in range(400):
        a[k] = (f - D * v) / M
        w = 0.5 * rng.standard_normal()
        for _ in range(fine):
            f, v = f + (GAIN * u[k] + w - f) / TAU * h / fine, v + (f - D * v) / M * h / fine
    return Recording(name="thrown", time=t, inputs={"u": u}, outputs={"a": a + 0.01 * rng.standard_normal(400)}, output_std={"a": 0.01})


def suspects(gain: Free | float) -> tuple:
    """The problem linearised, and what is looked at of its fixed parameters."""
    parameters = {"amplifier.gain": gain, "drag.d": Free(2.0, min=0.0), "lag.tau": Free(0.04, min=1e-4), "body.m": M, "drag.f_c": 0.0}
    weights = Weights(W={"body": 0.001, "lag": 0.005})
    problem = Problem(model=thrown(), recordings=[recorded()], parameters=parameters, weights=weights)
    result = smooth(problem)
    assert result.solver.converged
    base = Linearised(result.solution)
    fixed = [c for c in library(problem, problem.model, base.solution) if c.family == "parameter"]
    looks = looked_at(problem, problem.model, base, fixed)
    (mass,) = (look for look in looks if look.candidate.strengths == ("body.m",))
    return base, looks, mass


def test_a_mass_that_only_scales_residual_forces_is_no_suspect_however_much_it_would_gain():
    base, looks, mass = suspects(Free(5.0))
    both = base.scores(Columns.joined([mass.columns, base.residual_forces]))
    assert both.b[0] ** 2 / both.G[0, 0] > 50
    assert mass not in told(base, looks)
    assert ("body", "wrong_parameter", "body.m") not in {s.candidate.key for s in screen(base, looks).found}


def test_with_a_force_of_known_size_the_mass_can_be_told_and_is_one():
    base, looks, mass = suspects(GAIN)
    assert mass in told(base, looks)
