"""A state that is saved and resumed."""

from __future__ import annotations

import json

import numpy as np
import pytest
from friction_axis import FrictionAxis

from backsight.estimation import Free
from backsight.estimation.tracking import Estimator, Sample, resumed, save
from backsight.models.errors import InputError


@pytest.fixture(scope="module")
def axis():
    return FrictionAxis()


def fed(estimator, axis, rows):
    return np.array([estimator.update(axis.sample(k)).row() for k in rows])


def test_resumed_it_goes_on_as_if_it_had_not_been_stopped_to_the_last_bit(axis, tmp_path):
    whole = Estimator(axis.problem, samples=20)
    rows = fed(whole, axis, range(300))
    first = Estimator(axis.problem, samples=20, tuning=whole.tuning)
    fed(first, axis, range(137))
    save(first, tmp_path / "state.npz")
    again = resumed(axis.problem, tmp_path / "state.npz")
    np.testing.assert_array_equal(fed(again, axis, range(137, 300)), rows[137:])
    assert again.counts == whole.counts
    assert again.latency.counts.sum() == 300
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_a_state_of_another_model_or_no_state_at_all_is_refused(axis, tmp_path):
    estimator = Estimator(axis.problem, samples=20)
    fed(estimator, axis, range(30))
    path = tmp_path / "state.npz"
    save(estimator, path)
    with pytest.raises(InputError, match="other free parameters"):
        resumed(axis.posed({"friction.f_c": 20.0, "carriage.m": Free(50.0)}), path)
    path.write_bytes(b"PK\x03\x04 nonsense")
    with pytest.raises(InputError, match="no state of an estimator"):
        resumed(axis.problem, path)
    with pytest.raises(InputError, match="no such file"):
        resumed(axis.problem, tmp_path / "other.npz")
    np.savez(path, facts=np.array(json.dumps({"version": 99})))
    with pytest.raises(InputError, match="format is 99"):
        resumed(axis.problem, path)
    with pytest.raises(InputError, match="cannot be written"):
        save(estimator, tmp_path / "no" / "state.npz")


def test_sample_is_the_public_name_of_a_row():
    assert Sample(time=1.0).inputs == {}
