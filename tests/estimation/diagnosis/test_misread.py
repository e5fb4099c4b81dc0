"""Columns read otherwise: what belongs to one goes with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from two_inertias import posed

from backsight.estimation import Weights
from backsight.estimation.diagnosis.start.misread import _exchanged


def test_an_exchanged_column_takes_its_noise_along_also_that_of_one_recording():
    problem = replace(posed(), weights=Weights(V={"n_1": 0.1, "n_1 [fit]": 0.2, "n_2 [held_out]": 0.3}))
    there = _exchanged("n_1", "n_2")(problem)
    assert there.weights.V == {"n_2": 0.1, "n_2 [fit]": 0.2, "n_1 [held_out]": 0.3}
    for before, after in zip(problem.recordings, there.recordings, strict=True):
        assert np.array_equal(before.outputs["n_1"], after.outputs["n_2"])
        assert problem.weights.noise("n_1", before) == there.weights.noise("n_2", after)
    assert _exchanged("n_1", "n_2")(there).weights == problem.weights
