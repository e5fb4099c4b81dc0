"""An oscillator with white noise on its force, and records of its position: for the tests of the weights."""

from __future__ import annotations

import numpy as np
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

PLANT = compiled(oscillator())
N, DT, STD, FORCE_STD = 200, 0.02, 1e-3, 1.0
MEAN, DEVIATION = np.array([0.01, -0.2]), np.array([0.05, 0.5])
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
LINEAR = truths.Plant(m=M, d=D, k=K, offset=OFFSET)


def driven(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and inputs (n,)."""
    time = DT * np.arange(n)
    return time, 20 * np.sign(np.sin(2 * np.pi * time / 1.3 + 0.2))


def simulated(seed: int, force_std: float = FORCE_STD, n: int = N) -> np.ndarray:
    """Measured positions (n,)."""
    rng = np.random.default_rng(seed)
    start = MEAN + DEVIATION * rng.standard_normal(2)
    time, u = driven(n)
    return truths.disturbed(LINEAR, time, u, start, force_std, rng)[:, 0] + STD * rng.standard_normal(n)
