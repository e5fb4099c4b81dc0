"""Where a recording stops and goes on later: nobody knows the inputs in between, so its pieces have starts of their own."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .drive import drive_of

if TYPE_CHECKING:
    from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]

EVEN, UNEVEN = 0.95, 0.25  # share of intervals that are the usual one, to that share of it: then a longer one has lost rows
THOUSAND = 0.01  # of a factor of a thousand: how near to it two rates are that are told from two units
SLOW = 1.0  # s between rows from which on it is asked whether these are seconds
LONGEST = 20.0  # times the usual interval: a step that long is a gap when nobody says what is


def usual_interval(recording: Recording) -> float:
    """Time in which every signal is sampled once, as a rule [s]: that of the output sampled most rarely.

    But no longer than as many rows take as there are signals, and no shorter than one row: where the rows of several clocks are
    joined each has had its turn by then, and where one sensor is far slower than the rows it does not matter.
    """
    return usual_step(recording.time, recording.outputs.values(), len(recording.inputs) + len(recording.outputs))


def usual_step(time: Array, outputs: Collection[Array], count: int) -> float:
    """The same of outputs (n,), NaN where missing, on rows at time (n,); count: of the signals."""
    row = float(np.median(np.diff(time)))
    own = [time[np.isfinite(y)] for y in outputs]
    slowest = max((float(np.median(np.diff(t))) for t in own if len(t) > 1), default=row)
    all_in_turn = float(np.median(time[count:] - time[:-count])) if len(time) > count > 0 else row
    return max(row, min(slowest, all_in_turn))


def gap_limit(recording: Recording) -> float:
    """Step of the time [s] from which on it is a gap: as given, else LONGEST usual intervals."""
    return LONGEST * usual_interval(recording) if recording.gap is None else recording.gap


def runs(recording: Recording) -> list[slice]:
    """The rows between the gaps, in order; without a gap one slice of all."""
    time = recording.time
    edges = [0, *(np.flatnonzero(np.diff(time) > gap_limit(recording)) + 1).tolist(), len(time)]
    return [slice(a, b) for a, b in pairwise(edges)]


def lost_note(recording: Recording) -> str | None:
    """What rows that are not there mean for this recording; None where the clock is uneven throughout, or no row is missing."""
    time = drive_of(recording).time
    if not recording.inputs or len(time) < 2:
        return None
    steps = np.diff(time) / float(np.median(np.diff(time)))
    even, lost = np.abs(steps - 1.0) < UNEVEN, (steps > 1.0 + 2 * UNEVEN) & (np.diff(time) <= gap_limit(recording))
    if not lost.any() or np.mean(even) < EVEN:
        return None
    count, first = int(np.round(steps[lost] - 1.0).sum()), float(time[:-1][lost][0])
    rows = "1 row is missing" if count == 1 else f"{count} rows are missing, the first"
    how = "keep their value" if recording.hold == "zero" else "run straight"
    so = f"its inputs are taken to {how} until the next row, and if they did not a force is seen there"
    return f"{recording.name}: {rows} after t = {first:.9g} s; {so}."


def gap_note(recording: Recording) -> str | None:
    """What a gap means for this recording, in a sentence or two; None where there is none."""
    between = runs(recording)
    if len(between) == 1:
        return None
    steps = [(float(recording.time[b.start] - recording.time[b.start - 1]), float(recording.time[b.start - 1])) for b in between[1:]]
    longest, after = max(steps)
    limit = gap_limit(recording)
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


def seconds_note(recordings: Sequence[Recording]) -> str | None:
    """Whether rows are so far apart that a machine's time may not be in seconds; told of the slowest."""
    slowest = max(recordings, key=usual_interval)
    step, length = usual_interval(slowest), float(slowest.time[-1] - slowest.time[0])
    if step < SLOW:
        return None
    return (
        f"{slowest.name} has its rows {step:.6g} s apart and is {length:.6g} s long: is its time in seconds? If not, its entry in the "
        'study has to say so, as in time = { column = "...", unit = "ms" }.'
    )


def rates_note(recordings: Sequence[Recording]) -> str | None:
    """Whether a recording's rows are so many times as far apart as another's as a second has milliseconds, or microseconds."""
    steps = {r.name: usual_interval(r) for r in recordings}
    least, most = min(steps, key=lambda name: steps[name]), max(steps, key=lambda name: steps[name])
    factor = steps[most] / steps[least]
    unit = next((unit for unit, times in (("ms", 1e3), ("us", 1e6)) if abs(factor / times - 1.0) < THOUSAND), None)
    if unit is None:
        return None
    return (
        f"{most} has its rows {steps[most]:.6g} s apart, {least} {steps[least]:.6g} s: if the time of {most} is in {unit}, its entry in "
        f'the study has to say so, time = {{ column = "...", unit = "{unit}" }}.'
    )
