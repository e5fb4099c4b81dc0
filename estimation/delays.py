"""Delays of sensors, or of all inputs, as parameters of the model: what the recordings ask for (`models/augmentation/delay.py`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from backsight.models import Dae
from backsight.models.augmentation.delay import INPUTS, delayed, late_inputs
from backsight.models.errors import InputError

from .recordings.recording import Recording


def asked_for(recordings: Sequence[Recording]) -> list[str]:
    """The outputs whose delay is to be estimated, or INPUTS, in the order of the recordings.

    Raises InputError where one recording asks for it and another with the same signal does not: the parameter would delay both.
    """
    found = list(dict.fromkeys(name for r in recordings for name in r.open_delays))
    for name in found:
        which = "inputs" if name == INPUTS else f"output {name}"
        asks = next(r for r in recordings if name in r.open_delays)
        for r in recordings:
            if name not in r.open_delays and (name in r.outputs or (name == INPUTS and r.inputs)):
                raise InputError(
                    f'{r.name}: the delay of {which} is not "estimate", and in {asks.name} it is: what is estimated delays all recordings '
                    'alike. Write "estimate" in both, or estimate it from one alone and give that as a number.'
                )
    return found


def with_delays(dae: Dae, recordings: Sequence[Recording]) -> tuple[Dae, list[Recording]]:
    """The model with the delays that the recordings ask for, and the recordings without the question."""
    for name in asked_for(recordings):
        dae = late_inputs(dae) if name == INPUTS else delayed(dae, name)
    return dae, [replace(r, open_delays=()) for r in recordings]
