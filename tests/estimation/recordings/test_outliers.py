"""Gross outliers found without a model."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation import Recording
from backsight.estimation.recordings.outliers import outlying, screened

STD = 2e-6


def smooth_motion(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    """A fast axis read a thousand times a second, with jitter: from sample to sample it moves by hundreds of deviations."""
    rng = np.random.default_rng(seed)
    time = 1e-3 * (np.arange(n) + 0.3 * rng.uniform(size=n))
    return time, 0.1 * np.sin(2 * np.pi * 1.5 * time) + STD * rng.normal(size=n), rng


@pytest.mark.parametrize("n", [60, 500, 5000])
def test_single_outliers_are_found_while_the_signal_moves_as_fast(n):
    time, y, rng = smooth_motion(n, n)
    off = np.zeros(n, dtype=bool)
    off[rng.permutation(n)[: max(1, n // 100)]] = True
    y[off] += 1000 * STD * np.sign(rng.normal(size=off.sum()))
    found = outlying(time, y)
    assert np.all(found[off])
    assert np.mean(found[~off]) < 0.05  # neighbours of an outlier may be doubted


@pytest.mark.parametrize("places", [[50, 51], [0, 1], [0, 3], [50, 51, 52, 53], [97, 98]])
def test_outliers_side_by_side_do_not_excuse_each_other(places):
    time, missed = 0.01 * np.arange(200), 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        y = np.sin(3 * time) + 1e-3 * rng.normal(size=200)
        y[places] += 0.1 * np.sign(rng.normal(size=len(places)))
        missed += np.count_nonzero(~outlying(time, y)[places])
    assert missed <= 0.05 * 20 * len(places)


@pytest.mark.parametrize("places", [[4], [2, 5], [50, 52, 55], [95, 97]])
def test_good_samples_at_an_end_or_between_outliers_are_no_outliers(places):
    time, y, rng = smooth_motion(100, 7)
    y[places] += 1000 * STD * np.sign(rng.normal(size=len(places)))
    assert np.flatnonzero(outlying(time, y)).tolist() == places


def test_a_sound_signal_keeps_its_samples():
    for seed in range(20):
        time, y, _ = smooth_motion(1000, seed)
        assert not outlying(time, y).any()
    assert not outlying(time[:4], y[:4]).any()


def test_a_signal_of_spikes_keeps_them():
    y = np.zeros(400)
    y[::3] = 1.0
    assert not outlying(np.arange(400) * 0.01, y).any()


@pytest.mark.parametrize("seed", range(10))
def test_a_step_of_the_signal_is_no_outlier(seed):
    rng = np.random.default_rng(seed)
    y = np.where(np.arange(400) < 200, 0.0, 1.0) + 1e-3 * rng.normal(size=400)
    assert not outlying(np.arange(400) * 0.01, y).any()


def test_only_outputs_whose_loss_expects_outliers_are_screened_and_missing_samples_stay_missing():
    time, y, _ = smooth_motion(300, 2)
    y[100] += 1.0
    y[::7] = np.nan
    y[100] = 1.0
    r = Recording(name="a", time=time, inputs={}, outputs={"x": y, "v": y}, output_loss={"x": "huber"})
    kept = screened(r)
    assert np.isnan(kept.outputs["x"][100])
    assert np.array_equal(kept.outputs["v"], y, equal_nan=True)
    assert np.isnan(kept.outputs["x"][::7]).all()
