"""What filters and difference equations ask of a recording: equal steps, no sample missing, and inputs that they can take as they acted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backsight.models import Dae
from backsight.models.errors import InputError, suggestion

from ..recordings.drive import Hold, acting, drive_of, means
from ..recordings.recording import Recording
from ..wording import number

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
JITTER = 0.02  # of a step: what a clock may wander
SEVERAL = 1.5  # steps of the inputs in one of the rows, from which on they are taken to change in between


def uniform_step(recording: Recording, method: str, time: Array | None = None) -> float:
    """The mean interval of the rows, or of another `time` (n,) [s]; raises InputError where a step differs from it by more than JITTER."""
    at = recording.time if time is None else time
    steps = np.diff(at)
    mean = float(np.mean(steps))
    wrong = np.flatnonzero(np.abs(steps - mean) > JITTER * mean)
    if len(wrong):
        k = int(wrong[0])
        raise InputError(
            f"{recording.name}: {method} needs equal steps, and after {number(at[k])} s comes one of {steps[k]:.4g} s where "
            f"{mean:.4g} s is the mean; resample the recording, or use prediction_error or smooth, which take any steps."
        )
    return mean


def complete_output(recording: Recording, output: str, method: str) -> Array:
    """The samples of an output (n,); raises InputError where one is missing or the recording has no such output."""
    if output not in recording.outputs:
        raise InputError(f"{recording.name}: output = {output!r} is not recorded; {suggestion(output, recording.outputs)}")
    y = recording.outputs[output]
    missing = np.flatnonzero(~np.isfinite(y))
    if len(missing):
        raise InputError(
            f"{recording.name}: {method} needs every sample of {output}, and the one at {number(recording.time[missing[0]])} s is missing; "
            "choose a range without gaps, or use prediction_error or smooth, which pass over them."
        )
    return y


def held_inputs(dae: Dae, recording: Recording, method: str) -> Array:
    """The model's inputs in its order, (nu, n), for a method that holds them over a step; raises InputError where they change meanwhile.

    Where a step of theirs reaches from one row past the next, as under a sensor that lags, their mean is held.
    """
    if recording.hold != "zero":
        raise InputError(f'{recording.name}: {method} holds its inputs over a step; use hold = "zero", or prediction_error.')
    names = [q.name for q in dae.inputs]
    if recording.sampling > SEVERAL * recording.input_sampling and _change_between(recording, names):
        raise InputError(
            f"{recording.name}: {method} holds its inputs over a step, and they are recorded every {recording.input_sampling:.4g} s and "
            f"change between rows {recording.sampling:.4g} s apart; read it with every = 1, or use prediction_error or smooth, which take "
            "them as they acted."
        )
    return row_inputs(recording, names)[0]


def _change_between(recording: Recording, names: Sequence[str]) -> bool:
    """Whether one of these inputs leaves the value that it has at a row before the next."""
    drive = drive_of(recording)
    at_rows, row = acting(drive, recording.time, "zero"), np.searchsorted(recording.time, drive.time, side="right") - 1
    return any(bool(np.any(drive.inputs[name] != at_rows[name][np.maximum(row, 0)])) for name in names)


def row_inputs(recording: Recording, names: Sequence[str]) -> tuple[Array, Hold]:
    """These inputs at the rows, (nu, n), and how they go on to the next row: as recorded, or their mean held where they change meanwhile.

    Values of single instants would have frequencies for which the rows are too far apart turn up as others.
    """
    inputs, hold = recording.inputs, recording.hold
    if recording.drive is not None:
        inputs, hold = means(drive_of(recording), recording.time, hold), "zero"
    return np.array([inputs[name] for name in names]).reshape(len(names), len(recording.time)), hold
