"""Fewer points, same picture: minimum and maximum of every bin, and arrays packed as the drawing library reads them."""

import base64
from typing import Any

import numpy as np

__all__ = ["envelope", "packed", "packed_time", "spread", "unpacked"]

Array = np.ndarray


def envelope(values: Array, points: int) -> Array:
    """Row numbers, ascending, of at most `points` samples that draw `values` (n,) as all n would.

    The rows are cut into points / 2 equal bins and the smallest and the largest value of each is kept, so that no peak is lost; the
    first and the last row stay. Bins without any number contribute one NaN, which interrupts the line. All rows if n <= points.
    """
    n = values.size
    if n <= points:
        return np.arange(n)
    bins = max(points // 2 - 1, 1)
    width = -(-n // bins)
    padded = np.full(bins * width, np.nan)
    padded[:n] = values
    table = padded.reshape(bins, width)
    low = np.where(np.isnan(table), np.inf, table).argmin(axis=1)
    high = np.where(np.isnan(table), -np.inf, table).argmax(axis=1)
    start = np.arange(bins) * width
    kept = np.unique(np.concatenate([[0], start + low, start + high, [n - 1]]))
    return kept[kept < n]


def spread(n: int, points: int) -> Array:
    """At most `points` row numbers out of n, evenly spaced."""
    return np.arange(n) if n <= points else np.unique(np.linspace(0, n - 1, points).astype(int))


def packed(values: Array) -> dict[str, Any]:
    """Base64 of float32: seven digits, more than a screen shows, at half the size."""
    with np.errstate(over="ignore"):
        raw = np.ascontiguousarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(raw).decode("ascii")}


def packed_time(time: Array, of: Array | None = None) -> dict[str, Any]:
    """As `packed`, in float64 where float32 would blur the samples (a clock that starts far from zero, long records).

    of: the samples, where `time` is something drawn around them.
    """
    clock = time if of is None else of
    step = float(np.median(np.diff(clock))) if clock.size > 1 else 1.0
    if np.abs(time).max(initial=0.0) * 6e-8 < 0.02 * abs(step):
        return packed(time)
    return {"dtype": "f8", "bdata": base64.b64encode(np.ascontiguousarray(time, dtype="<f8").tobytes()).decode("ascii")}


def unpacked(drawing: Any) -> Any:
    """What is drawn, of dictionaries and lists, with its packed arrays as arrays (n,) again."""
    if isinstance(drawing, dict):
        if drawing.keys() == {"dtype", "bdata"}:
            return np.frombuffer(base64.b64decode(drawing["bdata"]), dtype=f"<{drawing['dtype']}")
        return {key: unpacked(value) for key, value in drawing.items()}
    return [unpacked(value) for value in drawing] if isinstance(drawing, list) else drawing
