"""Where a recording stops and goes on later: nobody knows the inputs in between, so its pieces have starts of their own."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]

LONGEST = 20.0  # times the median interval: a step that long is a gap when nobody says what is


def gap_limit(time: Array, gap: float | None) -> float:
    """Step of the time [s] from which on it is a gap: as given, else LONGEST median intervals."""
    return float(LONGEST * np.median(np.diff(time)) if gap is None else gap)


def runs(time: Array, gap: float | None) -> list[slice]:
    """The rows between the gaps, in order; without a gap one slice of all."""
    edges = [0, *(np.flatnonzero(np.diff(time) > gap_limit(time, gap)) + 1).tolist(), len(time)]
    return [slice(a, b) for a, b in pairwise(edges)]


def gap_note(recording: Recording) -> str | None:
    """What a gap means for this recording, in a sentence or two; None where there is none."""
    between = runs(recording.time, recording.gap)
    if len(between) == 1:
        return None
    steps = [(float(recording.time[b.start] - recording.time[b.start - 1]), float(recording.time[b.start - 1])) for b in between[1:]]
    longest, after = max(steps)
    limit = gap_limit(recording.time, recording.gap)
    rule = "as given" if recording.gap is not None else f"{LONGEST:g} sampling intervals"
    count = "a gap" if len(steps) == 1 else f"{len(steps)} gaps"
    found = f"{recording.name} has {count} of more than {limit:.3g} s ({rule}), the longest {longest:.3g} s after t = {after:.9g} s"
    if recording.role == "held_out":
        return f"{found}: every piece was predicted from a start of its own."
    used = recording.pieces
    left = len(recording.time) - sum(len(p.time) for p in used)
    rows = "row" if left == 1 else "rows"
    alone = f" {left} {rows} without a neighbour or without a sample of an output: left out." if left else ""
    return f"{found}: it was taken as {len(used)} pieces, each with a start of its own.{alone}"
