"""Between a command and what acts: gain, offset, limit, dead zone, delay, lag. What is recorded is the command.

The command of a row is held until the next one. What acts is a function of time in each piece of the row; a delay that is no whole number
of rows cuts a row in two.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import exp

import numpy as np

__all__ = ["Actuation", "InputFault"]

Piece = tuple[float, float, Callable[[float], np.ndarray]]


@dataclass(frozen=True, kw_only=True)
class InputFault:
    """acting = lag(dead_zone(limit(gain u(t - delay) + offset))).

    gain, offset, limit, width of the dead zone [unit of the input], delay, tau of the lag [s]; onset [s]: from this row on.
    """

    gain: float = 1.0
    offset: float = 0.0
    limit: float = np.inf
    width: float = 0.0
    delay: float = 0.0
    tau: float = 0.0
    onset: float = -np.inf

    def static(self, u: float) -> float:
        """All but delay and lag."""
        u = min(max(self.gain * u + self.offset, -self.limit), self.limit)
        return float(np.sign(u)) * max(abs(u) - self.width, 0.0)


class Actuation:
    """Commands (n,) row by row, as they act; before the first row the command was `before`."""

    def __init__(self, faults: Mapping[int, InputFault], before: np.ndarray) -> None:
        self.faults, self.times, self.commands = dict(faults), [-np.inf], [before.copy()]
        self.lagging = {i: float(before[i]) for i in faults}

    def pieces(self, t: float, end: float, u: np.ndarray) -> list[Piece]:
        """Pieces (from, until, acting(t)) of the row from t [s] to end under the command u."""
        self.times.append(t)
        self.commands.append(u.copy())
        if not self.faults:
            return [(t, end, lambda _: u)]
        cuts = {cut for fault in self.faults.values() if fault.delay > 0 for cut in self._changes(t, end, fault.delay)}
        corners = [t, *sorted(cuts), end]
        return [self._piece(a, b, t) for a, b in pairwise(corners)]

    def _changes(self, t: float, end: float, delay: float) -> list[float]:
        """When, inside the row, earlier commands arrive."""
        found, k = [], len(self.times) - 1
        while self.times[k] + delay > t + 1e-9:
            if self.times[k] + delay < end - 1e-9:
                found.append(self.times[k] + delay)
            k -= 1
        return found

    def _piece(self, begin: float, end: float, row: float) -> Piece:
        target = self.commands[-1].copy()
        start: dict[int, tuple[float, float]] = {}
        for i, fault in self.faults.items():
            if row >= fault.onset:
                target[i] = fault.static(self._at((begin + end) / 2 - fault.delay)[i])
            if fault.tau > 0 and row >= fault.onset:
                start[i] = self.lagging[i] - target[i], fault.tau
                self.lagging[i] = float(target[i]) + start[i][0] * exp((begin - end) / fault.tau)
            else:
                self.lagging[i] = float(target[i])

        def acting(t: float) -> np.ndarray:
            u = target.copy()
            for i, (gap, tau) in start.items():
                u[i] += gap * exp((begin - t) / tau)
            return u

        return begin, end, acting

    def _at(self, t: float) -> np.ndarray:
        k = len(self.times) - 1
        while self.times[k] > t:
            k -= 1
        return self.commands[k]
