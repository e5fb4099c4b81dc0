"""Faults of a sensor, applied to what it should have read; the control has sensors of its own, which are right.

reading(t) = gain y(t - delay) + bias + rate (t - t_0) + amplitude (sin(y + phase) - sin(phase)) + angle * another output,   lagging by tau
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

__all__ = ["SensorFault"]

FINER = 8  # steps of the lag in a row


@dataclass(frozen=True, kw_only=True)
class SensorFault:
    """gain, bias [unit], rate [unit/s], delay and lag tau [s], eccentricity amplitude and phase [rad]; angle [rad] towards `other`."""

    gain: float = 1.0
    bias: float = 0.0
    rate: float = 0.0
    delay: float = 0.0
    tau: float = 0.0
    amplitude: float = 0.0
    phase: float = 0.0
    angle: float = 0.0
    other: str = ""
    onset: float = -np.inf

    def read(self, name: str, time: np.ndarray, clean: Mapping[str, np.ndarray]) -> np.ndarray:
        """What it reads (n,) instead of clean[name] (n,); before the first row all was as in it."""
        y = clean[name]
        if self.angle:
            y = np.cos(self.angle) * y + np.sin(self.angle) * clean[self.other]
        if self.delay:
            y = CubicSpline(time, y)(np.maximum(time - self.delay, time[0]))
        if self.tau:
            y = _lagging(time, y, self.tau)
        out = self.gain * y + self.bias + self.rate * (time - max(self.onset, time[0]))
        out = out + self.amplitude * (np.sin(y + self.phase) - np.sin(self.phase))
        found: np.ndarray = np.where(time >= self.onset, out, clean[name])
        return found


def _lagging(time: np.ndarray, y: np.ndarray, tau: float) -> np.ndarray:
    """x of tau x' = y - x, from x = y; exact where y is linear between FINER points in each row."""
    fine = np.interp(np.arange((time.size - 1) * FINER + 1) / FINER, np.arange(time.size), time)
    u, x = CubicSpline(time, y)(fine), np.empty(fine.size)
    x[0] = u[0]
    for k, h in enumerate(np.diff(fine)):
        keep, slope = np.exp(-h / tau), (u[k + 1] - u[k]) / h
        x[k + 1] = u[k + 1] - tau * slope + keep * (x[k] - u[k] + tau * slope)
    return x[::FINER]
