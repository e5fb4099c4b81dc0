"""What charts of outputs draw, on clocks of several kinds."""

from __future__ import annotations

import base64

import numpy as np
import pandas as pd
import pytest

from backsight.estimation.report.chart import Chart
from backsight.estimation.report.figures import output_chart, own_rows, whiteness_chart


def drawn(chart: Chart, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """x and y of the curves of that name, as the drawing library reads them."""

    def unpacked(array: dict[str, str]) -> np.ndarray:
        return np.frombuffer(base64.b64decode(array["bdata"]), dtype=f"<{array['dtype']}").astype(float)

    return [(unpacked(t["x"]), unpacked(t["y"])) for t in chart.data if t["name"].startswith(name)]


def table(time: np.ndarray, measured: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"t_s": time, "s": np.sin(time), "s.std": np.full(len(time), 0.01), "s.measured": measured})


def chart(frame: pd.DataFrame) -> Chart:
    return output_chart(frame, "s", "m", 0.01, points=5000, group="time")


def slow(n: int = 2000, every: int = 20) -> np.ndarray:
    measured = np.full(n, np.nan)
    measured[::every] = np.sin(1e-3 * np.arange(0, n, every)) + 0.1
    return measured


def test_a_sensor_slower_than_the_rows_is_drawn_from_sample_to_sample_and_misses_none():
    time, measured = 1e-3 * np.arange(2000), slow()
    np.testing.assert_array_equal(own_rows(measured), np.arange(0, 2000, 20))
    found = chart(table(time, measured))
    assert "missing" not in found.caption
    for name, values in (("measured", measured[::20]), ("error", measured[::20] - np.sin(time[::20]))):
        ((x, y),) = drawn(found, name)
        np.testing.assert_allclose(x, time[::20], atol=1e-6)
        np.testing.assert_allclose(y / y.max(), values / values.max(), rtol=1e-5)


def test_its_autocorrelation_is_in_its_own_samples():
    time, measured = 1e-3 * np.arange(2000), slow()
    measured[::20] += np.tile([1.0, -1.0], 50)
    found = whiteness_chart(table(time, measured), ["s"], label="white")
    assert found is not None
    ((_, r),) = drawn(found, "error of s")
    assert np.isfinite(r).all()
    assert r[0] == pytest.approx(-1.0, abs=0.05)
    assert "20" in found.layout["xaxis"]["title"]["text"]


def test_rows_of_another_clock_are_no_missing_samples_and_lost_ones_are_counted():
    own = np.setdiff1d(np.arange(1000), [300, 301, 500])
    time = np.sort(np.concatenate([1e-3 * own, 1e-3 * np.arange(0, 1000, 50) + 4e-4]))
    measured = np.where(np.isin(np.round(time / 1e-3, 3), own), np.sin(time), np.nan)
    assert "3 samples are missing" in chart(table(time, measured)).caption


def test_a_gap_interrupts_every_line():
    time = np.concatenate([1e-3 * np.arange(500), 2.0 + 1e-3 * np.arange(500)])
    found = chart(table(time, np.sin(time)))
    for name in ("measured", "error", "smoothed"):
        x, y = drawn(found, name)[-1]
        (gap,) = np.flatnonzero(np.isnan(y))
        assert x[gap - 1] < x[gap] < x[gap + 1]
    x, y = drawn(found, "smoothed")[0]  # the band: two pieces, there and back
    assert np.isnan(y).sum() == 2
    assert not np.any((x > 0.5) & (x < 2.0))
