"""A slide of which only the speed is measured, with a force that waves along its way. Simulated here by scipy."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from backsight.estimation import Free, Problem, Recording
from backsight.models import Model
from backsight.models.mechanics.translational import Fixed, Force, Friction, Mass, VelocitySensor

M, D, NOISE, STEP = 4.0, 4.0, 2e-3, 4e-3


def slide() -> Model:
    return Model(
        name="slide",
        components={"drive": Force(), "mass": Mass(m=M), "friction": Friction(d=D), "base": Fixed(), "speed": VelocitySensor()},
        connections=[
            ("drive.flange", "mass.flange"), ("mass.flange", "friction.flange_a"), ("friction.flange_b", "base.flange"),
            ("speed.flange", "mass.flange"),
        ],
        inputs={"F": "drive.f"},
        outputs={"v": "speed.v"},
    )  # fmt: skip


def recorded(seed: int, role: str, start: float, *, amplitude: float, period: float) -> Recording:
    """Six seconds of a held random force, from a place [m] of the wave on, whose amplitude is in N and period in m."""
    rng, n = np.random.default_rng(seed), 1500
    force, x, speeds = np.repeat(rng.uniform(-6.0, 6.0, n // 25), 25), np.array([start, 0.3]), []

    def rates(_: float, y: np.ndarray, f: float) -> list[float]:
        return [y[1], (f - D * y[1] - amplitude * np.sin(2 * np.pi * y[0] / period)) / M]

    for f in force:
        speeds.append(x[1])
        moved = solve_ivp(rates, (0, STEP), x, rtol=1e-8, atol=1e-10, args=(f,))
        x = moved.y[:, -1]
    v = np.array(speeds) + NOISE * rng.standard_normal(n)
    return Recording(name=f"{role}_{seed}", role=role, time=STEP * np.arange(n), inputs={"F": force}, outputs={"v": v})


def posed(**wave: float) -> Problem:
    """Two recordings that begin half a period from each other, and one that is held out."""
    half = wave["period"] / 2
    recordings = [recorded(1, "fit", 0.0, **wave), recorded(2, "fit", half, **wave), recorded(3, "held_out", 0.6 * half, **wave)]
    return Problem(model=slide(), recordings=recordings, parameters={"mass.m": Free(3.0), "friction.d": Free(6.0)})
