"""What filters and difference equations ask of a recording: equal steps, and no sample missing."""

from __future__ import annotations

import numpy as np

from backsight.models import Dae
from backsight.models.errors import InputError, suggestion

from ..recordings.recording import Recording
from ..wording import number

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
JITTER = 0.02  # of a step: what a clock may wander


def uniform_step(recording: Recording, method: str) -> float:
    """The mean sampling interval [s]; raises InputError where a step differs from it by more than JITTER."""
    steps = np.diff(recording.time)
    mean = float(np.mean(steps))
    wrong = np.flatnonzero(np.abs(steps - mean) > JITTER * mean)
    if len(wrong):
        k = int(wrong[0])
        raise InputError(
            f"{recording.name}: {method} needs equal steps, and after {number(recording.time[k])} s comes one of {steps[k]:.4g} s where "
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


def model_inputs(dae: Dae, recording: Recording) -> Array:
    """The model's inputs in its order, (nu, n); what else was recorded is left out."""
    return np.array([recording.inputs[q.name] for q in dae.inputs]).reshape(len(dae.inputs), len(recording.time))
