"""What the moving horizon says of its errors, against recordings by simulators that share no code with it.

`tests/studies/tracking.py` does the same for every plant, more seeds and whole recordings.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2
from studies import tracking

RARE = 1e-4  # chance that a sound estimator fails one of these
RUNS = {"actuator": (4, 400), "five_bar": (3, 200)}  # seeds and rows


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "what"),
    [
        ("actuator", "plain"),
        ("actuator", "defective"),
        ("five_bar", "plain"),
        pytest.param("five_bar", "defective", marks=pytest.mark.long),
    ],
)
def test_errors_are_as_large_as_stated(plant: str, what: str) -> None:
    seeds, rows = RUNS[plant]
    runs = [tracking.follow(plant, seed, what, 50, rows) for seed in range(seeds)]
    for key in ("states", "parameters"):
        n = runs[0][key][-1][1]
        found = np.mean([np.mean([e for e, _ in run[key]]) for run in runs])
        # the band of one instant; the mean over time is inside it all the more
        low, high = chi2.ppf([RARE / 2, 1 - RARE / 2], n * seeds) / seeds
        assert low < found < high, f"{key}: {found / n:.2f} of {n}"
    assert sum(run["counts"]["failed"] for run in runs) == 0


@pytest.mark.slow
def test_gross_errors_are_left_out_and_hardly_cost_anything() -> None:
    plain, defective = (tracking.follow("actuator", 1, what, 50, 400) for what in ("plain", "defective"))
    assert plain["counts"]["doubted"] == 0
    assert 1 <= defective["counts"]["doubted"] <= 0.03 * 400
    assert defective["counts"]["estimated"] + defective["counts"]["doubted"] + defective["counts"]["predicted"] == 400
    last = [run["parameters"][-1][0] for run in (plain, defective)]
    assert last[1] < last[0] + 4


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["actuator", pytest.param("five_bar", marks=pytest.mark.long)])
def test_a_parameter_that_jumps_by_a_third_is_found_again_within_its_stated_deviation(plant: str) -> None:
    run = tracking.follow(plant, 0, "jump", 50)
    t, error, std = np.array(run["jumping"]).T
    half = len(t) // 2
    assert abs(error[half + 1]) > 0.15  # it did jump
    z = error[-len(t) // 8 :] / std[-len(t) // 8 :]
    assert np.abs(z).max() < 4.5
    assert np.abs(error[-len(t) // 8 :]).max() < tracking.JUMP / 2
    assert run["counts"]["failed"] == 0
