"""Do errors of the samples grow with how fast they move? Time stamps that are off by dt make errors of the rate times dt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..problem import Problem
from ..recordings.noise import robust_std

GROWS = 1.3  # times from the slowest third of the samples to the middle one, and from there to the fastest
MOVES = 0.1  # of the rms rate: slower samples count as at rest
ALIKE = 1.5  # times that the two faster thirds may differ in how far a clock would have to be off
FEW = 300  # samples: fewer say little of thirds


@dataclass(frozen=True)
class OffClock:
    """An output of a recording whose errors are those of a clock that is off by so much [s]; sizes of the slowest and the fastest third."""

    recording: str
    output: str
    unit: str
    off: float
    slow: float
    fast: float


def off_clock(problem: Problem, estimates: Mapping[str, pd.DataFrame]) -> list[OffClock]:
    """Every output whose errors grow with its rate as those of a clock would.

    Noise of a sensor does not, nor do steps of an encoder, which are the same as soon as it moves; errors of its gain go with where it is.
    """
    found = []
    for name, table in estimates.items():
        time = table["t_s"].to_numpy(float)
        for q in problem.dae.outputs:
            if q.name not in table or f"{q.name}.measured" not in table:
                continue
            smoothed = table[q.name].to_numpy(float)
            error = table[f"{q.name}.measured"].to_numpy(float) - smoothed
            rate = np.abs(np.gradient(smoothed, time))
            there = np.isfinite(error) & np.isfinite(rate)
            if np.count_nonzero(there) < FEW:
                continue
            if not (moving := there & (rate > MOVES * np.sqrt(np.mean(rate[there] ** 2)))).any():
                continue
            size, speed, far = np.abs(error[moving]), rate[moving], np.abs(smoothed - np.mean(smoothed[there]))[moving]
            thirds = np.array_split(np.argsort(speed, kind="stable"), 3)
            slow, middle, fast = (robust_std(size[part]) for part in thirds)
            off = middle / float(np.median(speed[thirds[1]])), fast / float(np.median(speed[thirds[2]]))
            alike = max(off) < ALIKE * min(off) and np.corrcoef(size, speed)[0, 1] > np.corrcoef(size, far)[0, 1]
            if middle > GROWS * slow and fast > GROWS * middle and alike:
                found.append(OffClock(name, q.name, q.unit, off[-1], slow, fast))
    return found


def clock_notes(problem: Problem, estimates: Mapping[str, pd.DataFrame]) -> list[str]:
    """A sentence for every output whose errors are those of a clock, where nobody said that it is off."""
    told = {r.name for r in problem.recordings if r.clock_std}
    return [
        f"{f'{x.output} of {x.recording}' if len(estimates) > 1 else x.output}: measured minus smoothed grows with how fast it moves, "
        f"{x.slow:.2g} {x.unit} in the slowest third of the samples and {x.fast:.2g} in the fastest. Time stamps that are off by about "
        f"{x.off:.2g} s would make it, or a vibration that comes with motion: are they those at which the sensor was read? If they cannot "
        f"be, say clock_std = {x.off:.1g}."
        for x in off_clock(problem, estimates)
        if x.recording not in told
    ]
