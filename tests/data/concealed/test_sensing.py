"""Faulty readings of a sine, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.data.generators.concealed.sensing import SensorFault

TIME, OMEGA = np.arange(4000) * 0.002, 9.0
CLEAN = {"y": np.sin(OMEGA * TIME), "x": np.cos(OMEGA * TIME)}
LATER = TIME > 1.0


def test_a_delay_shifts_it() -> None:
    read = SensorFault(delay=0.0153).read("y", TIME, CLEAN)
    assert read[LATER] == pytest.approx(np.sin(OMEGA * (TIME[LATER] - 0.0153)), abs=1e-8)


def test_a_lag_makes_it_smaller_and_later() -> None:
    read = SensorFault(tau=0.05).read("y", TIME, CLEAN)
    expected = np.sin(OMEGA * TIME - np.arctan(OMEGA * 0.05)) / np.hypot(1, OMEGA * 0.05)
    assert read[LATER] == pytest.approx(expected[LATER], abs=1e-6)


def test_gain_bias_and_drift_add_up() -> None:
    read = SensorFault(gain=1.1, bias=0.2, rate=0.03).read("y", TIME, CLEAN)
    assert read == pytest.approx(1.1 * CLEAN["y"] + 0.2 + 0.03 * TIME)


def test_a_turned_sensor_reads_some_of_the_other_axis() -> None:
    read = SensorFault(angle=0.1, other="x").read("y", TIME, CLEAN)
    assert read == pytest.approx(np.sin(OMEGA * TIME + 0.1))


def test_an_eccentric_encoder_is_right_at_zero() -> None:
    read = SensorFault(amplitude=0.05, phase=0.8).read("y", np.zeros(2), {"y": np.array([0.0, 0.5])})
    assert read == pytest.approx([0.0, 0.5 + 0.05 * (np.sin(1.3) - np.sin(0.8))])


def test_before_its_onset_a_sensor_reads_what_is_there() -> None:
    read = SensorFault(gain=1.1, rate=0.1, onset=3.0).read("y", TIME, CLEAN)
    assert np.array_equal(read[TIME < 3.0], CLEAN["y"][TIME < 3.0])
    assert read[-1] == pytest.approx(1.1 * CLEAN["y"][-1] + 0.1 * (TIME[-1] - 3.0))


@pytest.mark.parametrize(("fault", "late"), [({"tau": 0.004}, 0.004), *(({"delay": late}, late) for late in (0.003, 0.004, 0.01))])
def test_what_jumps_at_its_rows_is_late_from_there(fault: dict[str, float], late: float) -> None:
    """A staircase: it holds from row to row, and a lag follows every step by an exponential."""
    y = np.round(3.0 * np.sin(OMEGA * TIME))
    read = SensorFault(**fault).read("y", TIME, {"y": y}, {"y": np.diff(y, prepend=y[0])})
    if "tau" in fault:
        expected, keep = y.copy(), np.exp(-0.002 / late)
        for k in range(len(y) - 1):
            expected[k + 1] = y[k] + (expected[k] - y[k]) * keep
    else:
        rows = int(np.ceil(late / 0.002 - 1e-6))  # the step before holds until its row
        expected = np.concatenate([[y[0]] * rows, y[:-rows]])
    assert read == pytest.approx(expected, abs=1e-6)
