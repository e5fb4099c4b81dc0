"""Excitations of the concealed suite: five kinds for positions, so that a fit and what is held out differ in more than a seed.

All start at rest at zero. `reference(kind, time, amplitude, band, rng)` gives positions and velocities (n,), of this greatest size.
"""

from collections.abc import Callable

import numpy as np

from ..references import Reference, smooth_random

__all__ = ["KINDS", "reference"]


def trapezoids(time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """Strokes to random places, each with bang-bang acceleration and a time at constant speed; no rests."""
    ends, speeds, place = [float(time[0])], [0.0], 0.0
    while ends[-1] < time[-1]:
        target = rng.uniform(0.2, 1.0) * (-1.0 if place > 0 else 1.0) if place else 1.0
        lasting = 1 / (rng.uniform(0.3, 1.0) * band[1])
        ramp = lasting * rng.uniform(0.15, 0.35)
        speed = (target - place) / (lasting - ramp)
        ends += [ends[-1] + ramp, ends[-1] + lasting - ramp, ends[-1] + lasting]
        speeds += [speed, speed, 0.0]
        place = target
    return _integrated(time, np.array(ends), np.array(speeds), amplitude)


def steps(time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """Quick moves between random levels, the velocity a triangle, with short waits; a usual one is half a period of the band's middle."""
    ends, speeds, place = [float(time[0]), float(time[0]) + 0.02], [0.0, 0.0], 0.0
    while ends[-1] < time[-1]:
        target = rng.uniform(-1.0, 1.0)
        quick = (0.3 + 0.7 * abs(target - place)) * 0.45 / np.sqrt(band[0] * band[1])
        ends += [ends[-1] + quick / 2, ends[-1] + quick, ends[-1] + quick + rng.uniform(0.1, 0.5) / band[1]]
        speeds += [2 * (target - place) / quick, 0.0, 0.0]
        place = target
    return _integrated(time, np.array(ends), np.array(speeds), amplitude)


def _integrated(time: np.ndarray, corners: np.ndarray, speeds: np.ndarray, amplitude: float) -> Reference:
    """Position and velocity of a velocity that is linear between its corners, exactly."""
    places = np.concatenate([[0.0], np.cumsum(np.diff(corners) * (speeds[1:] + speeds[:-1]) / 2)])
    k = np.searchsorted(corners, time, side="right").clip(1, corners.size - 1) - 1
    slope = (speeds[k + 1] - speeds[k]) / (corners[k + 1] - corners[k])
    s = time - corners[k]
    x, v = places[k] + speeds[k] * s + slope * s * s / 2, speeds[k] + slope * s
    scale = amplitude / np.abs(x).max()
    return scale * x, scale * v


def chirp(time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """A sine whose frequency rises through the band and whose size falls, so that its acceleration stays about the same; faded in."""
    t, length = time - time[0], time[-1] - time[0]
    first, last = band[0], band[1] * rng.uniform(0.6, 0.8)
    rate = np.log(last / first) / length
    frequency = first * np.exp(rate * t)
    angle = 2 * np.pi * (frequency - first) / rate
    size = (first / frequency) ** 1.3
    x, v = size * (1 - np.cos(angle)), size * 2 * np.pi * frequency * np.sin(angle) - 1.3 * rate * size * (1 - np.cos(angle))
    scale = amplitude / np.abs(x).max()
    return scale * x, scale * v


def multisine(time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """Six sines of random phases over the band."""
    return smooth_random(time, amplitude, band, rng)


def slow(time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """The same, over the lower third of the band."""
    return smooth_random(time, amplitude, (band[0], band[0] * (band[1] / band[0]) ** 0.4), rng)


KINDS: dict[str, Callable[[np.ndarray, float, tuple[float, float], np.random.Generator], Reference]] = {
    "trapezoids": trapezoids,
    "multisine": multisine,
    "steps": steps,
    "chirp": chirp,
    "slow": slow,
}


def reference(kind: str, time: np.ndarray, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Reference:
    """The reference of this kind."""
    return KINDS[kind](time, amplitude, band, rng)
