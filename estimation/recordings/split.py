"""Holding a part of what was recorded out, where nobody recorded anything to test on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..wording import number
from .recording import Recording

LAST = 2 / 3  # of the rows: what comes after is held out
LEAST = 30  # rows on either side


def with_held_out(recordings: Sequence[Recording]) -> tuple[list[Recording], str | None]:
    """The recordings, some of them held out, and a sentence if that was decided here.

    Where none is: of several fitted ones the last; of one its last third. As they are, with a sentence, where it is too short for that.
    """
    found = list(recordings)
    if any(r.role == "held_out" for r in found):
        return found, None
    if len(found) > 1:
        found[-1] = replace(found[-1], role="held_out")
        return found, f"No recording was held out: for this study {found[-1].name} is."
    (whole,) = found
    cut = round(LAST * len(whole.time))
    if min(cut, len(whole.time) - cut) < LEAST:
        return found, f"{whole.name} is too short for a part of it to be held out."
    at = f"t = {number(whole.time[cut])} s"
    held = replace(rows_of(whole, slice(cut, None)), name=f"{whole.name} from {at}", role="held_out", part=1)
    return [rows_of(whole, slice(0, cut)), held], f"No recording was held out: for this study the last third of {whole.name} is, from {at}."


def rows_of(recording: Recording, rows: slice) -> Recording:
    """Some of its rows, one after the other."""
    inputs = {name: u[rows] for name, u in recording.inputs.items()}
    return replace(recording, time=recording.time[rows], inputs=inputs, outputs={name: y[rows] for name, y in recording.outputs.items()})
