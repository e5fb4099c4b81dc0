"""What every simulated machine gives back, and under which conditions it was recorded."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

__all__ = ["Conditions", "Force", "Run", "Sensors", "clock", "disturbance"]

# force(t, q, v): generalised forces on top of those of the machine, in the order and the units of its PLACES; None: there are none.
# The integrators suppose that it is smooth from row to row: a jump costs them their order, and one with the sign of a velocity is refused
# where bodies stick.
Force = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Run:
    """One recording and the truth behind it; every array (n,), SI.

    time, inputs, outputs   what a logger writes: row k's outputs are taken at time[k], its inputs hold until time[k + 1]
    truth                   states by the names of the plants, outputs without noise as `clean.<output>`
    noise                   standard deviation of each output's noise, quantisation not counted
    """

    time: np.ndarray
    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    truth: Mapping[str, np.ndarray]
    noise: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """How a machine is recorded.

    duration, step  [s] length of the recording and time from row to row
    jitter          every row comes late by a uniform share of the step from 0 to this; the control acts when the row is taken
    noise           output -> standard deviation of its white noise; an output that is not named is not recorded
    resolution      output -> size of the steps to which it is rounded after the noise; 0 or not named: not rounded
    process         place -> std: a white force of spectral density std^2 x 1 s, held from row to row
    """

    duration: float
    step: float
    noise: Mapping[str, float]
    jitter: float = 0.0
    resolution: Mapping[str, float] = field(default_factory=dict)
    process: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (0 < self.step < self.duration and 0 <= self.jitter < 1):
            raise ValueError(
                f"duration {self.duration} s, step {self.step} s, jitter {self.jitter}: needs 0 < step < duration, 0 <= jitter < 1"
            )
        if stray := sorted(set(self.resolution) - set(self.noise)):
            raise ValueError(f"resolution of {', '.join(stray)}: no such output among {', '.join(self.noise)}")


class Sensors:
    """Readings of true values with white noise, then rounded; the noise of all rows is drawn at once and does not depend on them."""

    def __init__(self, conditions: Conditions, rows: int, rng: np.random.Generator) -> None:
        self.error = {name: std * rng.standard_normal(rows) for name, std in conditions.noise.items()}
        self.resolution = {name: conditions.resolution.get(name, 0.0) for name in conditions.noise}

    def read(self, name: str, k: int, value: float) -> float:
        """The reading of row k; the value itself where the output is not recorded, for a control that needs it all the same."""
        if name not in self.error:
            return value
        raw, step = value + float(self.error[name][k]), self.resolution[name]
        return round(raw / step) * step if step else raw

    def recorded(self, names: tuple[str, ...], values: np.ndarray) -> dict[str, np.ndarray]:
        """Those columns of values (n, outputs) that are recorded."""
        return {name: column for name, column in zip(names, values.T, strict=True) if name in self.error}


def clock(conditions: Conditions, rng: np.random.Generator) -> np.ndarray:
    """Times of the rows (n,) [s]."""
    rows = np.arange(round(conditions.duration / conditions.step))
    late = conditions.jitter * rng.uniform(size=rows.size) if conditions.jitter else 0.0
    return (rows + late) * conditions.step


def disturbance(conditions: Conditions, places: tuple[str, ...], time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """White forces (n, places) held from row to row: std/sqrt(h) over an interval of length h [s] has the density std^2 x 1 s."""
    if stray := sorted(set(conditions.process) - set(places)):
        raise ValueError(f"process of {', '.join(stray)}: no such place; there are {', '.join(places)}")
    steps = np.diff(time, append=time[-1] + conditions.step)
    std = np.array([conditions.process.get(place, 0.0) for place in places])
    return std * rng.standard_normal((time.size, len(places))) / np.sqrt(steps)[:, None]
