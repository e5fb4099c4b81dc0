"""Do errors of the samples grow with how fast they move? Time stamps that are off by dt make errors of the rate times dt."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from ..problem import Problem

GROWS = 1.5  # times from the slowest third of the samples to the middle one, and from there to the fastest
NORMAL = 0.6745  # median of the absolute values of a standard normal, which single outliers leave alone
FEW = 300  # samples: fewer say little of thirds


def clock_notes(problem: Problem, estimates: Mapping[str, pd.DataFrame]) -> list[str]:
    """A sentence for every output whose errors grow with its rate as those of a clock would.

    Errors of a sensor do not, nor do steps of an encoder, which are the same as soon as it moves.
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
            error, rate = error[there], rate[there]
            thirds = np.array_split(np.argsort(rate, kind="stable"), 3)
            slow, middle, fast = (float(np.median(np.abs(error[part]))) / NORMAL for part in thirds)
            if middle > GROWS * slow and fast > GROWS * middle:
                which = f"{q.name} of {name}" if len(estimates) > 1 else q.name
                found.append(
                    f"{which}: measured minus smoothed grows with how fast it moves, {slow:.2g} {q.unit} in the slowest third of the "
                    f"samples and {fast:.2g} in the fastest. Time stamps that are off by about {fast / np.median(rate[thirds[2]]):.2g} s "
                    "would make it: are they those at which the sensor was read?"
                )
    return found
