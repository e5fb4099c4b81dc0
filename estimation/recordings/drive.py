"""Inputs on a clock of their own, where they change between the rows of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from backsight.models import Dae, Trajectory, simulate

if TYPE_CHECKING:
    from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Hold = Literal["zero", "linear"]


@dataclass(frozen=True)
class Drive:
    """Inputs by name, (m,) each [SI], at the times (m,) [s]."""

    time: Array
    inputs: Mapping[str, Array]


def drive_of(recording: Recording) -> Drive:
    """The inputs as they acted from the recording's first row to its last: on their own clock where they have one, else on the rows.

    An input that the clock does not know is held from row to row.
    """
    whole, time = recording.drive, recording.time
    if whole is None:
        return Drive(time, recording.inputs)
    first = max(int(np.searchsorted(whole.time, time[0], side="right")) - 1, 0)
    last = int(np.searchsorted(whole.time, time[-1])) + 1
    own = {name: whole.inputs[name][first:last] for name in recording.inputs if name in whole.inputs}
    clock = whole.time[first:last]
    row = np.clip(np.searchsorted(time, clock, side="right") - 1, 0, len(time) - 1)
    return Drive(clock, {name: own.get(name, u[row]) for name, u in recording.inputs.items()})


def acting(drive: Drive, times: Array, hold: Hold) -> dict[str, Array]:
    """The inputs at any times."""
    if hold == "linear":
        return {name: np.interp(times, drive.time, u) for name, u in drive.inputs.items()}
    row = np.clip(np.searchsorted(drive.time, times, side="right") - 1, 0, len(drive.time) - 1)
    return {name: u[row] for name, u in drive.inputs.items()}


def means(drive: Drive, rows: Array, hold: Hold) -> dict[str, Array]:
    """The mean of the inputs from every row to the next, as which they push alike, (n,); at the last row what acts there."""
    edges = np.union1d(rows, drive.time[(drive.time > rows[0]) & (drive.time < rows[-1])])
    width, owner = np.diff(edges), np.searchsorted(rows, edges[:-1], side="right") - 1
    found = {}
    for name, u in acting(drive, edges, hold).items():
        level = u[:-1] if hold == "zero" else (u[:-1] + u[1:]) / 2
        found[name] = np.append(np.bincount(owner, weights=level * width, minlength=len(rows) - 1) / np.diff(rows), u[-1])
    return found


def run(
    dae: Dae,
    recording: Recording,
    parameters: Mapping[str, float],
    initial: Mapping[str, float],
    *,
    rows: slice = slice(None),
    rtol: float = 1e-10,
) -> Trajectory:
    """The model simulated under the recording's inputs, at its rows or some that follow each other; rtol as of `simulate`."""
    at = recording.time[rows]
    times, inputs = at, {name: u[rows] for name, u in recording.inputs.items()}
    if recording.drive is not None:
        drive = drive_of(recording)
        times = np.union1d(at, drive.time[(drive.time > at[0]) & (drive.time < at[-1])])
        inputs = acting(drive, times, recording.hold)
    own = {q.name: inputs[q.name] for q in dae.inputs if q.name in inputs}
    found = simulate(dae, times, own, parameters=parameters, initial=initial, hold=recording.hold, rtol=rtol)
    if recording.drive is None:
        return found
    there = np.searchsorted(times, at)

    def kept(part: Mapping[str, Array]) -> dict[str, Array]:
        return {name: values[there] for name, values in part.items()}

    return Trajectory(
        t=at,
        states=kept(found.states),
        outputs=kept(found.outputs),
        algebraics=kept(found.algebraics),
        derivatives=kept(found.derivatives),
        events=found.events,
    )
