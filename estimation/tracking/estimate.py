"""What goes into an estimator and what comes out of it, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class Outcome(Enum):
    """How an estimate came about."""

    ESTIMATED = "estimated from the samples up to this one"
    RESTARTED = "the states started anew after a gap"
    PREDICTED = "predicted: the row has no sample"
    DOUBTED = "predicted: the sample is far from what was expected, and waits for others like it"
    FAILED = "predicted: the solve did not converge"
    FILLED = "a late sample took its place; the estimate is of the newest time"
    LATE = "too late or repeated: nothing was done with it"

    @property
    def word(self) -> str:
        """In one word, as the tables have it."""
        return self.name.lower()


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One row: the inputs hold from `time` [s] on, the outputs [SI] were taken then. What is NaN or left out is missing."""

    time: float
    inputs: Mapping[str, float] = field(default_factory=dict)
    outputs: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Names:
    """What the entries of an estimate's arrays are called."""

    outputs: tuple[str, ...]
    states: tuple[str, ...]
    forces: tuple[str, ...]
    parameters: tuple[str, ...]
    inputs: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Of the newest time [s], in the order of `names`; a std is inf where the samples do not tell, and all are SI.

    outputs    as the model has them, with std, and `measured`, NaN where missing
    states     with std
    forces     residual forces, `residual.<place>`, means over the last stage, with std
    parameters with std
    inputs     those that were measured with noise, as they acted over the last stage, with std
    surprise   the samples less their predictions over the standard deviations of those, NaN where there was none
    step       of the last Gauss-Newton step, in standard deviations: what another one would have moved at most if they shrink
    seconds    that the estimate took
    """

    time: float
    names: Names = field(repr=False)
    outputs: Array
    outputs_std: Array
    measured: Array
    states: Array
    states_std: Array
    forces: Array
    forces_std: Array
    parameters: Array
    parameters_std: Array
    inputs: Array
    inputs_std: Array
    surprise: Array
    outcome: Outcome
    iterations: int
    step: float
    seconds: float

    def __getitem__(self, name: str) -> float:
        """An output, state, parameter or `residual.<place>` by its name."""
        return self._found(name)[0]

    def std(self, name: str) -> float:
        """Its standard deviation."""
        return self._found(name)[1]

    def _found(self, name: str) -> tuple[float, float]:
        n = self.names
        for known, value, std in (
            (n.parameters, self.parameters, self.parameters_std),
            (n.states, self.states, self.states_std),
            (n.outputs, self.outputs, self.outputs_std),
            (n.forces, self.forces, self.forces_std),
            (n.inputs, self.inputs, self.inputs_std),
        ):
            if name in known:
                i = known.index(name)
                return float(value[i]), float(std[i])
        raise KeyError(f"{name}: an estimate has {', '.join((*n.outputs, *n.states, *n.forces, *n.parameters, *n.inputs))}")

    def row(self) -> list[float]:
        """t_s, every output with .measured and .std, then with .std the states, residual forces, parameters and inputs (`columns`)."""
        out = [self.time]
        for triple in zip(self.outputs.tolist(), self.measured.tolist(), self.outputs_std.tolist(), strict=True):
            out.extend(triple)
        for values, stds in (
            (self.states, self.states_std),
            (self.forces, self.forces_std),
            (self.parameters, self.parameters_std),
            (self.inputs, self.inputs_std),
        ):
            for pair in zip(values.tolist(), stds.tolist(), strict=True):
                out.extend(pair)
        return out


def columns(names: Names) -> list[str]:
    """The headings of `Estimate.row`."""
    out = ["t_s"]
    for name in names.outputs:
        out += [name, f"{name}.measured", f"{name}.std"]
    for name in (*names.states, *names.forces, *names.parameters, *names.inputs):
        out += [name, f"{name}.std"]
    return out
