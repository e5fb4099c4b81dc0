"""The study of stick and slip: how it judges, and what its recordings are."""

from __future__ import annotations

import numpy as np
import pytest
from studies import stick_slip as study


def test_changes_are_dated_by_the_nearest_of_their_kind() -> None:
    stuck = np.array([1, 1, 1, 0, 0, 0, 0, 1, 1, 1], dtype=bool)
    told = np.array([1, 1, 1, 1, 0, 0, 0, 0, 0, 1], dtype=bool)
    assert study.dated(told, stuck) == [1, 2]
    assert study.changes(told) == 2
    assert study.dated(np.ones(10, dtype=bool), stuck) == [10, 10]


@pytest.mark.parametrize(("regime", "least", "most"), [("15 V", 0.3, 0.8), ("50 V", 0.03, 0.4), ("never sticks", 0.0, 0.0)])
def test_recordings_stick_as_often_as_they_are_to(regime: str, least: float, most: float) -> None:
    drilled = study.REGIMES[regime](1e-3, 0)
    assert len(drilled.stuck) == len(drilled.recording.time) == study.ROWS
    assert least <= drilled.stuck.mean() <= most


def test_a_stuck_bit_is_what_the_difference_equation_of_a_stuck_bit_foretells() -> None:
    """Without noise to speak of its offset is small where the bit sticks; the limit that is best finds most of it."""
    drilled = study.REGIMES["15 V"](1e-5, 0)
    assert np.mean(study.recursive(drilled.recording, drilled.stuck) == drilled.stuck) > 0.85
