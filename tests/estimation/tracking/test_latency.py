"""Quantiles in constant memory."""

from __future__ import annotations

import numpy as np

from backsight.estimation.tracking.latency import Latency


def test_quantiles_are_those_of_all_times_to_a_hundredth():
    times = np.exp(np.random.default_rng(0).normal(-7.0, 1.0, 20_000))
    latency = Latency()
    for t in times:
        latency.add(float(t))
    told = latency.milliseconds()
    for name, share in (("median", 0.5), ("p95", 0.95), ("p99", 0.99)):
        assert abs(told[name] / (1e3 * np.quantile(times, share)) - 1) < 0.015
    assert told["max"] == 1e3 * times.max()
    assert latency.counts.nbytes < 20_000


def test_times_beyond_the_classes_are_not_lost():
    latency = Latency()
    latency.add(0.0)
    latency.add(1e6)
    assert latency.counts.sum() == 2
    assert latency.milliseconds()["max"] == 1e9
