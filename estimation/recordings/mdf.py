"""Channels of an ASAM MDF file as columns, by asammdf.

A file holds groups of channels, each sampled at times of its own (its master channel). The rows of a recording are the times at which
any of the wanted channels was sampled: an output is missing where it was not, an input keeps its value or runs straight, as inputs do
between rows anyhow. No value is made up: rows before the first sample of an input, or past its last, are left out.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from backsight.models.errors import InputError, suggestion

from ..wording import quoted
from .table import Table, check_kind

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Hold = Literal["zero", "linear"]

MARKS = (b"MDF     ", b"UnFinMF ")  # how such a file begins
SAME = 1e-6  # of a sampling interval: times of two groups that differ by less are one


def read_mdf(data: bytes, clock: str, wanted: Sequence[str], held: Mapping[str, Hold], label: str) -> Table:
    """The channels `wanted` and the time `clock`: a group's master, or a channel beside all the others.

    held: those of `wanted` that are inputs, and what they do between their samples. Raises InputError.
    """
    try:
        from asammdf import MDF
    except ImportError:
        raise InputError(
            f"{label}: MDF files need asammdf; install it by `pip install backsight[mdf]`, or save the recording as csv"
        ) from None
    if not data.startswith(MARKS):
        raise InputError(f"{label}: this is no MDF file, it does not begin as one; export it again")
    try:
        with MDF(io.BytesIO(data)) as file:
            where = {name: _place(file, name, label) for name in wanted}
            own = None if _is_master(file, clock, label) else _place(file, clock, label)
            if own is not None:
                where[clock] = own
                apart = [name for name, (group, _) in where.items() if group != own[0]]
                if apart:
                    raise InputError(
                        f'{label}: the channel {quoted(apart)} has times of its own, so "{clock}" is not its time; '
                        f"name the master channel instead, {quoted(_masters(file), last='or')}"
                    )
            series = {name: file.get(name, group=group, index=index) for name, (group, index) in where.items()}
    except InputError:
        raise
    except (ValueError, KeyError, IndexError, TypeError, OSError, struct.error, zlib.error, MemoryError, OverflowError) as error:
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
        raise InputError(f"{label}: this is no readable MDF file ({reason}); export it again") from None
    for name, signal in series.items():
        check_kind(signal.samples, name, label)
    sampled = {name: (np.asarray(s.timestamps, dtype=np.float64), np.asarray(s.samples, dtype=np.float64)) for name, s in series.items()}
    empty = [name for name, (times, _) in sampled.items() if not len(times)]
    if empty:
        raise InputError(f"{label}: the channel {quoted(empty)} holds no valid sample; leave it out")
    time = sampled[clock][0] if own is not None else _joined([times for times, _ in sampled.values()])
    columns = {name: _at(time, times, values, held.get(name)) for name, (times, values) in sampled.items()}
    keep = np.all([_acts(time, sampled[name][0], hold) for name, hold in held.items()], axis=0) if held else np.ones(len(time), dtype=bool)
    columns = {name: values[keep] for name, values in columns.items()}
    kept = time[keep]
    return Table(columns={clock: kept, **columns}, row=lambda k: f"t = {kept[k]:.9g} s")


def _place(file: Any, name: str, label: str) -> tuple[int, int]:
    """Group and index of the one channel of that name."""
    found = file.channels_db.get(name, ())
    if not found:
        raise InputError(f'{label}: no channel "{name}"; {suggestion(name, sorted(file.channels_db))}')
    if len(found) > 1:
        raise InputError(f'{label}: the channel "{name}" occurs in {len(found)} groups; rename it, or export one group alone')
    return int(found[0][0]), int(found[0][1])


def _is_master(file: Any, clock: str, label: str) -> bool:
    found = file.channels_db.get(clock, ())
    if not found:
        raise InputError(f'{label}: no channel "{clock}" for the time; the master channel is {quoted(_masters(file), last="or")}')
    return all(file.masters_db.get(group) == index for group, index in found)


def _masters(file: Any) -> list[str]:
    return sorted({file.groups[group].channels[index].name for group, index in file.masters_db.items()})


def _joined(series: Sequence[Array]) -> Array:
    """All times in order, those that differ by rounding once."""
    times = np.sort(np.concatenate(series))
    finest = min((float(np.median(np.diff(t))) for t in series if len(t) > 1), default=0.0)
    return np.asarray(times[np.insert(np.diff(times) > SAME * finest, 0, True)])


def _acts(time: Array, times: Array, hold: Hold) -> Array:
    """At which rows an input sampled at `times` acts: from its first sample to its last, and if it is held for one more interval."""
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    end = times[-1] + (step if hold == "zero" else 0.0)
    return np.asarray((time >= times[0] - SAME * step) & (time <= end + SAME * step))


def _at(time: Array, times: Array, values: Array, hold: Hold | None) -> Array:
    """A channel at the rows: NaN where it was not sampled; an input as it acts between its samples, NaN where it does not."""
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    slack = SAME * step
    last = np.clip(np.searchsorted(times, time + slack, side="right") - 1, 0, len(times) - 1)
    before = np.abs(times[last] - time)
    if hold is None:
        return np.where(before <= slack, values[last], np.nan)
    return np.where(_acts(time, times, hold), np.interp(time, times, values) if hold == "linear" else values[last], np.nan)
