"""Inputs between two samples, as a moving horizon's stages take them.

A stage tests its balances with the mean and the first moment over itself (`ocp/moving/stage.py`), so of an input it sees these two,
exactly where the model is affine in the input. The straight line with the same two stands for whatever the input did:

    u(tau) = m_0 + c (2 tau - 1),     m_0 = int u dtau,     c = 3 int u (2 tau - 1) dtau,     tau from 0 to 1
"""

from __future__ import annotations

from typing import Literal

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class Driven:
    """The inputs' values (nu,) and the times [s] from which on they held, since the last sample."""

    def __init__(self, count: int, hold: Literal["zero", "linear"]) -> None:
        self.hold = hold
        self.times: list[float] = []
        self.values: list[Array] = []
        self.last = np.zeros(count)

    def put(self, time: float, values: Array) -> None:
        """Values from a time on; one that is NaN stays what it was."""
        self.last = np.where(np.isfinite(values), values, self.last)
        while self.times and self.times[-1] >= time:
            self.times.pop()
            self.values.pop()
        self.times.append(time)
        self.values.append(self.last)

    def clear(self) -> None:
        """Nothing of before; the last values go on."""
        self.times, self.values = [], []

    def forget(self, time: float) -> None:
        """Nothing before a time is asked for again."""
        while len(self.times) > 1 and self.times[1] <= time:
            self.times.pop(0)
            self.values.pop(0)

    def over(self, start: float, end: float) -> Array:
        """[value at the start; at the end] of the straight line that stands for the inputs between two times, (2 nu,)."""
        times, values = np.array(self.times), np.array(self.values)
        inside = times[(times > start) & (times < end)]
        edges = np.concatenate([[start], inside, [end]])
        if self.hold == "zero":
            left = right = values[np.maximum(np.searchsorted(times, edges[:-1], side="right") - 1, 0)]
        else:
            line = np.column_stack([np.interp(edges, times, u) for u in values.T]) if values.size else np.zeros((len(edges), 0))
            left, right = line[:-1], line[1:]
        tau = (edges - start) / (end - start)
        width, f = np.diff(tau)[:, None], 2.0 * tau[:, None] - 1.0
        mean = (width * (left + right) / 2).sum(axis=0)
        middle = (left + right) / 2 * (f[1:] + f[:-1]) / 2
        slope = 3.0 * (width / 6 * (left * f[:-1] + 4 * middle + right * f[1:])).sum(axis=0)
        return np.concatenate([mean - slope, mean + slope])
