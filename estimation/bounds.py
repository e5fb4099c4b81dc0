"""Bounds of states that every sample of an output contradicts which reads such a state and nothing else: y = a x + b, a and b known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from backsight.models import Dae

from .recordings.noise import noise_std
from .recordings.recording import Recording

BEYOND = 5.0  # deviations of an output's noise that its samples may lie beyond: a machine may rest on its bound
REMEDY = "give other bounds, or correct the unit or the zero of what was recorded"


@dataclass(frozen=True, kw_only=True)
class Excluded:
    """A state's bounds that all samples of an output of a recording lie outside of; low, high [unit]: what these say that the state is."""

    state: str
    output: str
    recording: str
    below: bool
    low: float
    high: float
    unit: str

    def said(self, column: str = "") -> str:
        """What is wrong, for those who know the column that was read."""
        which = f'column "{column}" of {self.recording}, output {self.output}' if column else f"output {self.output} of {self.recording}"
        seen = f"{self.low:.4g} .. {self.high:.4g} {self.unit}"
        return f"all samples of {which}, which shows it, lie {'below' if self.below else 'above'}: {seen}; {REMEDY}"


def excluded(
    dae: Dae, recordings: Sequence[Recording], bounds: Mapping[str, tuple[float, float]], parameters: Mapping[str, float | None]
) -> Iterator[Excluded]:
    """Every output of a fitted recording that has no sample within the bounds of the state that it reads.

    parameters: values of fixed ones, None for one that is free; those not named have the model's own.
    """
    for i, state in enumerate(dae.states):
        low, high = bounds.get(state.name, (-np.inf, np.inf))
        for k, output in enumerate(dae.outputs if state.name in bounds else ()):
            reading = _reading(dae, k, i, parameters)
            if reading is None:
                continue
            a, b = reading
            for r in recordings:
                y = r.outputs.get(output.name, np.empty(0))
                seen = np.sort((y[np.isfinite(y)] - b) / a)
                if r.role != "fit" or not seen.size:
                    continue
                room = BEYOND * (r.output_std.get(output.name) or noise_std(r.time, y)) / abs(a)
                if (below := bool(seen[-1] < low - room)) or seen[0] > high + room:
                    yield Excluded(
                        state=state.name,
                        output=output.name,
                        recording=r.name,
                        below=below,
                        low=float(seen[0]),
                        high=float(seen[-1]),
                        unit=state.unit,
                    )


def _reading(dae: Dae, output: int, state: int, parameters: Mapping[str, float | None]) -> tuple[float, float] | None:
    """a and b of an output y = a x + b of one state; None where it is another function, or has a free parameter."""
    y, x = dae.output[output], dae.x[state]
    a, b = ca.jacobian(y, x), ca.substitute(y, x, 0)
    values = {p.name: parameters.get(p.name, p.value) for p in dae.parameters}
    known = {dae.p[i].name() for i, value in enumerate(values.values()) if value is not None}
    if not {symbol.name() for symbol in ca.symvar(ca.vertcat(a, b))} <= known:
        return None
    p = [0.0 if value is None else value for value in values.values()]
    slope, zero = (float(v) for v in ca.Function("reading", [dae.p], [a, b])(p))
    return (slope, zero) if slope != 0 and np.isfinite([slope, zero]).all() else None
