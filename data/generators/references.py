"""What machines are asked to do: strokes forth and back at several speeds, sums of sines, stick movements, levels."""

import numpy as np

__all__ = ["Reference", "circle", "joystick", "levels", "smooth_random", "strokes", "sum_of_sines", "there_and_back"]

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
    fade, fade_rate = _ease(np.clip(time / 0.5, 0.0, 1.0), 0.5)
    return fade * wave, fade * wave_rate + fade_rate * wave


def joystick(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Movements of a stick (n,): pauses, and deflections that are undone by as much to the other side; both of random size and length."""
    ends, levels = [float(time[0])], [0.0]
    while ends[-1] < time[-1]:
        size, length = amplitude * rng.uniform(0.3, 1.0) * rng.choice([-1.0, 1.0]), rng.uniform(0.25, 0.9)
        for level, duration in ((size, length), (-size, length), (0.0, rng.uniform(0.1, 0.6))):
            ends.append(ends[-1] + duration)
            levels.append(level)
    return _held(ends, levels, time)


def levels(time: np.ndarray, between: tuple[float, float], lasting: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """Random levels (n,) within the two bounds, each held for a random time within the other two [s]."""
    ends, values = [float(time[0]) + rng.uniform(*lasting)], [rng.uniform(*between)]
    while ends[-1] < time[-1]:
        ends.append(ends[-1] + rng.uniform(*lasting))
        values.append(rng.uniform(*between))
    return _held(ends, values, time)


def _held(ends: list[float], values: list[float], time: np.ndarray) -> np.ndarray:
    """At each time (n,) the value whose end [s] comes next."""
    found: np.ndarray = np.array(values)[np.searchsorted(ends, time, side="right").clip(0, len(values) - 1)]
    return found


def there_and_back(time: np.ndarray, length: float, lasting: float, begin: float = 0.02) -> Reference:
    """Strokes over `length` [m] and back without rests, each `lasting` [s]: a polynomial of fifth degree, at rest at both ends."""
    t = np.maximum(time - begin, 0.0) / lasting
    stroke = np.floor(t)
    way, rate = _ease(t - stroke, lasting)
    back = stroke % 2 == 1
    return length * np.where(back, 1 - way, way), length * np.where(back, -rate, rate)


def circle(time: np.ndarray, radius: float, frequency: float) -> tuple[Reference, Reference]:
    """A circle [m] through the start at (0, 0), its speed faded in over half a turn."""
    turn = 2 * np.pi * frequency
    s = np.clip(time * 2 * frequency, 0.0, 1.0)
    angle = turn * time - np.where(s < 1, turn * time - np.pi * (s**3 - s**4 / 2), np.pi / 2)
    rate = turn * (3 * s * s - 2 * s**3)
    return (radius * (1 - np.cos(angle)), radius * np.sin(angle) * rate), (radius * np.sin(angle), radius * np.cos(angle) * rate)


def smooth_random(time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """Six sines of random phases at random frequencies [Hz], spread over the band, the speed of each the same; of this greatest size."""
    edges = np.geomspace(*band, 7)
    omega = 2 * np.pi * rng.uniform(edges[:-1], edges[1:])
    phase, size = rng.uniform(0.0, 2 * np.pi, omega.size), 1.0 / omega
    angle = np.outer(time - time[0], omega) + phase
    fading = 1.0 / band[1]
    fade, fade_rate = _ease(np.clip((time - time[0]) / fading, 0.0, 1.0), fading)
    wave, wave_rate = np.sin(angle) @ size, np.cos(angle) @ (size * omega)
    wave, wave_rate = fade * wave, fade_rate * wave + fade * wave_rate
    scale = amplitude / np.abs(wave).max()
    return scale * wave, scale * wave_rate


def _ease(s: np.ndarray, lasting: float) -> Reference:
    """From 0 at s = 0 to 1 at s = 1 with no speed and no acceleration at either end, and its rate when that lasts so long [s]."""
    return s * s * s * (10 - 15 * s + 6 * s * s), 30 * s * s * (1 - s) * (1 - s) / lasting
