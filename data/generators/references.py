"""What the axis is asked to do: strokes forth and back at several speeds, or a sum of sines. Each returns position and velocity."""

import numpy as np

__all__ = ["strokes", "sum_of_sines"]

Reference = tuple[np.ndarray, np.ndarray]


def strokes(time: np.ndarray, rng: np.random.Generator) -> Reference:
    """Pairs of strokes, forth and back, with bang-bang acceleration; the speeds of the pairs come in random order.

    A stroke runs 0.31 s at its speed, so that ten pairs fill ten seconds. There are no long rests: an axis that sticks says nothing
    about its parameters.
    """
    speeds = rng.permutation([0.02, 0.04, 0.08, 0.12, 0.18, 0.25, 0.33, 0.40, 0.06, 0.30])
    accelerations = rng.permutation([1.2, 1.6, 2.0, 2.4, 2.8, 1.4, 1.8, 2.2, 2.6, 2.0])
    corners = [(0.0, 0.0), (0.01, 0.0)]  # (time, velocity): the velocity is linear between them
    for speed, acceleration in zip(speeds, accelerations, strict=True):
        for sign in (1.0, -1.0):
            t, ramp = corners[-1][0], speed / acceleration
            corners += [(t + ramp, sign * speed), (t + ramp + 0.31, sign * speed), (t + 2 * ramp + 0.31, 0.0)]
    t, v = np.array(corners).T
    velocity = np.interp(time, t, v)
    # The trapezium of a piecewise linear velocity is exact but for the few samples that contain a corner.
    return np.concatenate([[0.0], np.cumsum(np.diff(time) * (velocity[1:] + velocity[:-1]) / 2)]), velocity


def sum_of_sines(time: np.ndarray, rng: np.random.Generator) -> Reference:
    """Four sines between 0.3 and 2.3 Hz with random phases, faded in over the first half second."""
    omega = 2 * np.pi * np.array([0.31, 0.83, 1.37, 2.29])
    amplitude = np.array([0.060, 0.025, 0.014, 0.004])
    phase = rng.uniform(0.0, 2 * np.pi, omega.size)
    angle = np.outer(time, omega) + phase
    wave, wave_rate = np.sin(angle) @ amplitude, np.cos(angle) @ (amplitude * omega)
    s = np.clip(time / 0.5, 0.0, 1.0)
    fade, fade_rate = s * s * s * (10 - 15 * s + 6 * s * s), 30 * s * s * (1 - s) * (1 - s) / 0.5
    return fade * wave, fade * wave_rate + fade_rate * wave
