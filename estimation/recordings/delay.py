"""A delay of a sensor, taken out of its samples: what it said at t_k is what it saw at t_k - delay. No sample is interpolated.

A sample that falls on a row moves there; where one falls between the rows, the samples of that sensor keep times of their own, which are
rows then, and the inputs keep their clock (`drive.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drive import Drive, Hold, acting, drive_of, means
from .gaps import LONGEST, gap_limit, usual_step

if TYPE_CHECKING:
    from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Series = tuple[Array, Array]  # times [s] and values

SAME = 1e-6  # of a sampling interval: times that differ by less are one


def earlier(time: Array, values: Array, delay: float, longest: float) -> Series:
    """The samples of a sensor, (n,) with NaN where missing, moved back by a delay [s], on the rows (times `time`) where they fall on them.

    Those moved beyond the first row or the last, or into a step of the rows longer than `longest` [s], are left out.
    """
    there = np.isfinite(values)
    at, slack = time[there] - delay, SAME * float(np.median(np.diff(time)))
    row = np.clip(np.searchsorted(time, at - slack), 0, len(time) - 1)
    at = np.where(np.abs(time[row] - at) <= slack, time[row], at)
    left = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    inside = (at >= time[0]) & (at <= time[-1]) & (np.isin(at, time) | (time[left + 1] - time[left] <= longest))
    return at[inside], values[there][inside]


def on_rows(time: Array, series: Mapping[str, Series]) -> tuple[Array, dict[str, Array]]:
    """Rows at `time` and at all times of the series, and every series on these rows, NaN where it has no sample.

    `time` has no rows of its own where every series has samples between them.
    """
    between = {name: not np.isin(at, time).all() for name, (at, _) in series.items()}
    own = [at for at, _ in series.values()]
    rows = np.unique(np.concatenate(own)) if series and all(between.values()) else np.unique(np.concatenate([time, *own]))
    columns = {}
    for name, (at, values) in series.items():
        columns[name] = np.full(len(rows), np.nan)
        columns[name][np.searchsorted(rows, at)] = values
    return rows, columns


def moved(recording: Recording, delays: Mapping[str, float]) -> Recording:
    """The recording with the samples of these outputs moved back by their delays [s]."""
    late = {
        name: earlier(recording.time, y, delays[name], gap_limit(recording)) for name, y in recording.outputs.items() if delays.get(name)
    }
    rest = {name: (recording.time, y) for name, y in recording.outputs.items() if name not in late}
    rows, outputs = on_rows(recording.time, {**rest, **late})
    outputs = {name: outputs[name] for name in recording.outputs}
    if np.array_equal(rows, recording.time):
        return replace(recording, outputs=outputs)
    drive = recording.drive or drive_of(recording)
    return replace(recording, time=rows, inputs=between_rows(drive, rows, recording.hold), outputs=outputs, drive=drive)


def sampled(
    time: Array,
    kept: NDArray[np.int64],
    inputs: Mapping[str, Array],
    outputs: Mapping[str, Array],
    delays: Mapping[str, float],
    hold: Hold,
    gap: float | None,
) -> tuple[Array, dict[str, Array], dict[str, Array], Drive | None]:
    """What is kept of the rows at `time` (n,): rows, inputs and outputs on them, and the inputs' own clock where they change in between.

    kept: indices of rows, evenly spaced; of a sensor whose samples are taken between the rows as many are kept. delays: of outputs [s];
    gap: as of a `Recording`.
    """
    rows, every = time[kept], int(kept[1] - kept[0])
    longest = LONGEST * usual_step(time, outputs.values(), len(inputs) + len(outputs)) if gap is None else gap
    series = {}
    for name, y in outputs.items():
        at, values = earlier(time, y, delays.get(name, 0.0), longest)
        if np.isin(at, time).all():
            column = np.full(len(time), np.nan)
            column[np.searchsorted(time, at)] = values
            series[name] = rows, column[kept]
        else:
            thinned = np.where((np.arange(len(time)) - kept[0]) % every == 0, y, np.nan)
            at, values = earlier(time, thinned, delays[name], longest)
            inside = (at >= rows[0]) & (at <= rows[-1])
            series[name] = at[inside], values[inside]
    found, columns = on_rows(rows, series)
    there = np.all([np.isfinite(u) for u in inputs.values()], axis=0) if inputs else np.zeros(len(time), dtype=bool)
    drive = Drive(time[there], {name: u[there] for name, u in inputs.items()})
    if not np.array_equal(found, rows):
        return found, between_rows(drive, found, hold), columns, drive
    return rows, {name: u[kept] for name, u in inputs.items()}, columns, drive if every > 1 and inputs else None


def between_rows(drive: Drive, rows: Array, hold: Hold) -> dict[str, Array]:
    """Inputs for those who know the rows only: held ones by their mean from row to row, as which they push alike."""
    return acting(drive, rows, hold) if hold == "linear" else means(drive, rows, hold)
