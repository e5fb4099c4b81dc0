"""Channels of a recording that never change: of what they would tell there is nothing in it."""

from __future__ import annotations

import numpy as np

from ..problem import Problem
from ..recordings.noise import varies
from ..wording import listed, number


def on_dead_inputs(problem: Problem) -> list[str]:
    """Inputs that are the same in every row that is fitted: a channel that was not plugged in, or a machine left to itself.

    A supply that is constant beside an input that moves says nothing against the recording.
    """
    those = [r for r in problem.recordings if r.role == "fit"]
    still: dict[float, list[str]] = {}
    for q in problem.dae.inputs:
        if all(q.name in r.inputs for r in those) and np.ptp(u := np.concatenate([r.inputs[q.name] for r in those])) == 0:
            still.setdefault(float(u[0]), []).append(q.name)
    found, moved = [], sum(map(len, still.values())) < len(problem.dae.inputs)
    for value, names in still.items():
        if value and moved:
            continue
        what = f"Input {names[0]} is" if len(names) == 1 else f"Inputs {listed(names)} are"
        told = "only what the machine does by itself tells" if value == 0 else "only the start and what the machine does by itself tell"
        doubt = " Is that so, or was a channel dead?" if value == 0 else ""
        found.append(f"{what} {number(value)} in every row: {told} of it.{doubt}")
    return found


def on_dead_outputs(problem: Problem) -> list[str]:
    """Outputs that are the same in all samples of a recording that is fitted: a sensor that was not read, or a machine that rested."""
    found = []
    for q in problem.dae.outputs:
        for r in problem.recordings:
            y = r.outputs.get(q.name, np.empty(0))
            y = y[np.isfinite(y)]
            if r.role == "fit" and y.size > 1 and not varies(y):
                found.append(
                    f"Output {q.name} is {number(float(y[0]))} {q.unit} in all {y.size} samples of {r.name}: it tells nothing of its own "
                    "noise, and of the machine no more than that it rested there. Is that so, or was the sensor dead?"
                )
    return found
