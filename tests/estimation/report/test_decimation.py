"""Fewer points, same picture."""

import base64

import numpy as np
import pytest

from backsight.estimation.report.decimation import envelope, packed, packed_time, spread, unpacked


@pytest.mark.parametrize(("n", "points"), [(1000, 100), (10_007, 64), (250_000, 4000), (101, 100)])
def test_no_peak_is_lost_and_the_rows_ascend(n: int, points: int) -> None:
    rng = np.random.default_rng(n)
    values = rng.standard_normal(n)
    peaks = rng.choice(n, 5, replace=False)
    values[peaks] = [50, -60, 70, -80, 90]
    rows = envelope(values, points)
    assert rows.size <= points + 2
    assert np.all(np.diff(rows) > 0)
    assert rows[0] == 0
    assert rows[-1] == n - 1
    width = -(-n // (points // 2 - 1))
    for start in range(0, n, width):
        block, kept = values[start : start + width], values[rows[(rows >= start) & (rows < start + width)]]
        assert kept.min() == block.min()
        assert kept.max() == block.max()


def test_short_series_keep_every_row() -> None:
    assert np.array_equal(envelope(np.zeros(50), 50), np.arange(50))
    assert np.array_equal(spread(7, 10), np.arange(7))


def test_gaps_stay_gaps_and_do_not_hide_their_neighbours() -> None:
    values = np.sin(np.linspace(0, 6, 10_000))
    values[3000:5000] = np.nan
    values[7001] = 9.0
    rows = envelope(values, 200)
    assert np.isnan(values[rows]).any()
    assert 7001 in rows
    assert envelope(np.full(9000, np.nan), 100).size <= 102
    assert not np.isnan(values[rows][(rows > 5200)]).any()


def test_packed_arrays_read_back_with_seven_digits() -> None:
    values = np.array([1.0, np.nan, -2.5e-7, 3e8])
    back = np.frombuffer(base64.b64decode(packed(values)["bdata"]), dtype="<f4")
    assert np.allclose(back, values, rtol=1e-7, equal_nan=True)


def test_a_clock_far_from_zero_keeps_its_samples_apart() -> None:
    near, far = np.arange(1000) * 1e-3, 1.7e9 + np.arange(1000) * 1e-3
    assert packed_time(near)["dtype"] == "f4"
    stored = packed_time(far)
    assert stored["dtype"] == "f8"
    assert np.array_equal(np.frombuffer(base64.b64decode(stored["bdata"]), dtype="<f8"), far)


def test_what_was_packed_comes_out_wherever_it_lies() -> None:
    values = np.array([1.5, np.nan, -2.0])
    drawing = [{"y": packed(values), "error_y": {"array": packed_time(values)}, "name": "x", "z": [[None, 1.0]]}]
    (trace,) = unpacked(drawing)
    assert np.array_equal(trace["y"], values, equal_nan=True)
    assert np.array_equal(trace["error_y"]["array"], values, equal_nan=True)
    assert (trace["name"], trace["z"]) == ("x", [[None, 1.0]])
