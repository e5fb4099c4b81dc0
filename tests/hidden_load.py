"""A motor with an encoder and a load behind a soft shaft, which no output shows; simulated by itself, with friction that stops the load."""

from __future__ import annotations

import numpy as np
from examples import soft_drive

from backsight.estimation import Free, Problem, Recording

MOTOR, LOAD, STIFFNESS, DAMPING, BEARING = 2e-3, 8e-3, 40.0, 0.01, 0.05
STEP, FINER, NOISE, DURATION = 0.004, 40, 1e-3, 4.0


def recorded(friction: float, seed: int = 0) -> Recording:
    """Semi-implicit Euler with forty steps a sample; friction is the impulse that stops the load, if it may be as large (Moreau)."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, DURATION, STEP)
    torque = 0.5 * np.sin(2 * np.pi * 0.8 * t) + 0.8 * np.repeat(rng.uniform(-1, 1, 41), 25)[: len(t)]
    phi, omega, angles, h = np.zeros(2), np.zeros(2), np.zeros(len(t)), STEP / FINER
    for i, u in enumerate(torque):
        angles[i] = phi[0]
        for _ in range(FINER):
            twist = STIFFNESS * (phi[0] - phi[1]) + DAMPING * (omega[0] - omega[1])
            omega[0] += h * (u - twist) / MOTOR
            free = omega[1] + h * (twist - BEARING * omega[1]) / LOAD
            omega[1] = np.sign(free) * max(abs(free) - h * friction / LOAD, 0.0)
            phi = phi + h * omega
    noisy = angles + NOISE * rng.standard_normal(len(t))
    return Recording(name="run", time=t, inputs={"tau": torque}, outputs={"phi": noisy}, output_std={"phi": NOISE})


def posed(friction: float) -> Problem:
    free = {"motor.J": Free(1.3 * MOTOR), "load.J": Free(0.8 * LOAD), "shaft.k": Free(1.2 * STIFFNESS), "bearing.d": Free(0.7 * BEARING)}
    return Problem(model=soft_drive(), recordings=[recorded(friction)], parameters=free)
