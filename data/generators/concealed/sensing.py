"""Faults of a sensor, applied to what it should have read; the control has sensors of its own, which are right.

reading(t) = gain y(t - delay) + bias + rate (t - t_0) + amplitude (sin(y + phase) - sin(phase)) + angle * another output,   lagging by tau

An acceleration jumps where a command is held from row to row, and half a row is a good part of a lag. So y between the rows is a spline of
what is left of it without its jumps at the rows, and these are added again.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

__all__ = ["SensorFault"]

FINER = 8  # steps of the lag in a row
SAME = 1e-9  # s: a time so little beside a row is that row


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

    def __post_init__(self) -> None:
        if self.delay and self.tau:
            raise ValueError("a sensor is late by a delay or by a lag")

    def read(
        self, name: str, time: np.ndarray, clean: Mapping[str, np.ndarray], jumps: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """What it reads (n,) of clean[name] (n,), which jumps by jumps[name] (n,) at its rows; before the first one all was as there."""
        jumped = dict.fromkeys(clean, np.zeros(time.size)) if jumps is None else jumps
        y, jump = clean[name], jumped[name]
        if self.angle:
            own, across = np.cos(self.angle), np.sin(self.angle)
            y, jump = own * y + across * clean[self.other], own * jump + across * jumped[self.other]
        steps = np.cumsum(jump)
        if self.delay:
            when = np.maximum(time - self.delay, time[0])
            y = CubicSpline(time, y - steps)(when) + steps[np.searchsorted(time, when + SAME, side="right") - 1]
        if self.tau:
            y = _lagging(time, CubicSpline(time, y - steps), steps, self.tau)
        out = self.gain * y + self.bias + self.rate * (time - max(self.onset, time[0]))
        out = out + self.amplitude * (np.sin(y + self.phase) - np.sin(self.phase))
        found: np.ndarray = np.where(time >= self.onset, out, clean[name])
        return found


def _lagging(time: np.ndarray, smooth: CubicSpline, steps: np.ndarray, tau: float) -> np.ndarray:
    """x of tau x' = y - x, from x = y; y = smooth + steps (n,), linear between FINER points in each row. It is read once y has jumped."""
    fine = np.interp(np.arange((time.size - 1) * FINER + 1) / FINER, np.arange(time.size), time)
    u, held, x = smooth(fine), np.repeat(steps[:-1], FINER), np.empty(fine.size)
    x[0] = u[0] + steps[0]
    for k, h in enumerate(np.diff(fine)):
        begin, end = u[k] + held[k], u[k + 1] + held[k]
        slope = (end - begin) / h
        x[k + 1] = end - tau * slope + np.exp(-h / tau) * (x[k] - begin + tau * slope)
    before = x[::FINER]
    read: np.ndarray = before + (1.0 - np.exp(-SAME / tau)) * (smooth(time) + steps - before)
    return read
