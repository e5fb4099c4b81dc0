"""What every sample must satisfy: numbers of physical size, and a time that runs forward."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from backsight.models.errors import InputError

from ..wording import number

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
LARGEST = 1e100  # beyond this, squares of sums overflow; no sensor reads such numbers


def _row(k: int) -> str:
    return f"row {k + 1}"


def check_samples(
    label: str,
    time: Array,
    inputs: Mapping[str, Array],
    outputs: Mapping[str, Array],
    *,
    columns: Mapping[str, str] | None = None,
    row: Callable[[int], str] = _row,
) -> None:
    """Raise InputError at the first sample that cannot be used.

    label     the recording's name, which begins the message
    columns   what to call the values of a signal ('column "q_m"'), `row` how to call row k ("line 12")
    """
    called = columns or {}
    if time.size < 2:
        count = "one row" if time.size == 1 else "no rows"
        raise InputError(f"{label}: {count} to work with; a recording needs at least two")
    check_clock(time, label, "the time", row)
    for name, values in inputs.items():
        what = f"{called.get(name, 'the value')} of input {name}"
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            remedy = "an input needs a number in every row, fill it or cut it off with range"
            raise InputError(f"{label}, {row(int(bad[0]))}: {what} {_seen(values[bad[0]])}; {remedy}")
        _check_size(values, label, what, row)
    for name, values in outputs.items():
        what = f"{called.get(name, 'the value')} of output {name}"
        bad = np.flatnonzero(np.isinf(values))
        if len(bad):
            raise InputError(f"{label}, {row(int(bad[0]))}: {what} {_seen(values[bad[0]])}; leave the cell empty where a sample is missing")
        if np.isnan(values).all():
            raise InputError(f"{label}: {what} holds no number in any row; leave this output out")
        _check_size(values, label, what, row)


def check_clock(time: Array, label: str, what: str, row: Callable[[int], str] = _row) -> None:
    """Raise InputError where `time` is not finite or does not increase; `what` is how to call it."""
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise InputError(f"{label}, {row(int(bad[0]))}: {what} {_seen(time[bad[0]])}; every row needs its time in seconds")
    _check_size(time, label, what, row)
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        now, before = float(time[back[0] + 1]), float(time[back[0]])
        seen = f"repeats {now!r}" if now == before else f"runs back from {before!r} to {now!r}"
        raise InputError(
            f"{label}, {row(int(back[0]) + 1)}: {what} {seen}; it must increase from row to row: sort the rows, drop repeated ones"
        )


def _seen(value: float) -> str:
    return "is missing (empty or NaN)" if np.isnan(value) else f"is {value}"


def _check_size(values: Array, label: str, what: str, row: Callable[[int], str]) -> None:
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(np.abs(values) > LARGEST)
    if len(bad):
        seen = number(values[bad[0]])
        raise InputError(f"{label}, {row(int(bad[0]))}: {what} is {seen}, too large for a measurement (beyond {LARGEST:g}); correct it")
