"""Delays of sensors, or of all inputs, as parameters of the model: what the recordings ask for (`models/augmentation/delay.py`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from backsight.models import Dae
from backsight.models.augmentation.delay import INPUTS, delayed, late_inputs

from .recordings.recording import Recording


def asked_for(recordings: Sequence[Recording]) -> list[str]:
    """The outputs whose delay is to be estimated, or INPUTS, in the order of the recordings."""
    return list(dict.fromkeys(name for r in recordings for name in r.open_delays))


def with_delays(dae: Dae, recordings: Sequence[Recording]) -> tuple[Dae, list[Recording]]:
    """The model with the delays that the recordings ask for, and the recordings without the question."""
    for name in asked_for(recordings):
        dae = late_inputs(dae) if name == INPUTS else delayed(dae, name)
    return dae, [replace(r, open_delays=()) for r in recordings]
