"""Stretches of a signal that drop out, and what looks like them."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation.recordings.dropouts import blank, dropped_out, likely, stretches

N = 1000
T = 0.01 * np.arange(N)


def speed(seed: int = 0) -> np.ndarray:
    return 2000.0 + 60.0 * np.sin(3.0 * T) + 10.0 * np.random.default_rng(seed).standard_normal(N)


def test_a_counter_that_reads_nothing_for_a_while_drops_out():
    u = speed()
    u[200:212], u[500] = 0.0, 4000.0
    assert stretches(dropped_out(u)) == [(199, 212), (499, 501)]  # and a row on either side


def test_a_mean_over_the_ends_of_a_dropout_is_a_part_of_it():
    u = speed()
    u[200:212], u[199], u[212] = 0.0, 900.0, 1400.0
    rows = dropped_out(u)
    assert rows[198:214].all()
    assert rows.sum() == 16


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.05])
@pytest.mark.parametrize("w", [1.0, 2.0, 5.0, 17.0])
def test_a_smooth_signal_that_reads_nothing_for_a_while_drops_out_wherever_it_is(w, noise):
    found = 0
    for first in range(100, 900, 50):
        u = 10.0 + 4.0 * np.sin(w * T) + noise * np.random.default_rng(first).standard_normal(N)
        u[first : first + 12] = 0.0
        found += stretches(dropped_out(u)) == [(first - 1, first + 12)]
    assert found >= 12  # where it turns quickly next to one, that may be a part of it


@pytest.mark.parametrize(
    "u",
    [
        speed(),
        20.0 * np.random.default_rng(1).standard_normal(N),
        20.0 * np.sign(np.sin(9.0 * T) + 0.3 * np.random.default_rng(2).standard_normal(N)),  # held at either of two levels
        np.where(T < 5.0, 1.0, 3.0) + 0.01 * np.sin(40.0 * T),  # another level from then on
        speed() + 900.0 * np.exp(-(((T - 5.0) / 0.1) ** 2)),  # goes there by and by
        np.zeros(N),
        np.arange(5.0),
    ],
    ids=["noise", "white", "two levels", "a step", "a bump", "still", "short"],
)
def test_what_a_signal_is_like_is_no_dropout(u):
    assert not dropped_out(u).any()


def test_what_drops_out_goes_on_as_on_either_side():
    u = 2000.0 + 60.0 * np.sin(3.0 * T) + 40.0 * np.sin(17.0 * T) + 0.1 * np.random.default_rng(0).standard_normal(N)
    torn = u.copy()
    torn[200:212], torn[600:603] = 0.0, 4000.0
    assert likely(torn) == pytest.approx(u, abs=1.0)
    rest = np.r_[0:199, 213:599, 604:N]
    assert np.array_equal(likely(torn)[rest], u[rest])
    assert np.array_equal(likely(u), u)


def test_samples_that_read_one_value_are_blank_and_single_ones_far_off():
    y = speed()
    y[200:212], y[500], y[700:712] = 0.0, 4000.0, 3.0 * np.arange(12.0)
    y[[20, 205]] = np.nan
    zeros = {*range(200, 212)} - {205}
    assert {*np.flatnonzero(blank(T, y))} == zeros | {500}  # a pulse of several values may be one
    assert {*np.flatnonzero(blank(T, y, single=False))} == zeros


def test_samples_that_stay_until_the_signal_is_elsewhere_at_once_are_blank():
    y = np.round(np.sin(3.0 * T), 4)
    y[100:130], y[700:712] = y[100], -0.5
    assert {*np.flatnonzero(blank(T, y))} == {*range(101, 130), *range(700, 712)}


def test_a_machine_at_rest_that_breaks_away_is_none():
    """Quantised: it stays, and then goes faster and faster, or stays again after every step."""
    rest = np.round(np.where(T < 5.0, 0.0, 0.3 * (T - 5.0) ** 2), 4)
    stairs = np.floor(T / 0.2) * 0.01
    assert not blank(T, rest).any()
    assert not blank(T, stairs).any()
