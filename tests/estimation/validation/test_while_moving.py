"""What stands still says nothing about errors: a machine that its model describes and that rests now and then, from another simulator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backsight.data.cases.case import Case
from backsight.data.cases.suite import benches, write_case
from backsight.estimation import smooth
from backsight.estimation.smoothing.rest import rows_near_rest
from backsight.estimation.study.study import Study
from backsight.estimation.validation.innovations import innovations
from backsight.estimation.validation.whiteness import whiteness


@pytest.mark.slow
def test_errors_near_rest_are_no_sign_that_something_is_left_out(tmp_path: Path) -> None:
    bench = next(b for b in benches if b.plant == "actuator")
    resting = Case(kind="clean:resting", strength="none", verdict="none", motions=("steps",))
    made = write_case(bench, resting, "resting", tmp_path / "cases", tmp_path / "truth", [1, 4])
    study = made.folder / "study.toml"
    study.write_text(study.read_text(encoding="utf-8").replace('"held_out"', '"fit"'), encoding="utf-8")
    problem = Study.read(study).problem()
    found = smooth(replace(problem, recordings=[r for r in problem.recordings if r.role == "fit"]))
    assert found.solution is not None
    filtered = innovations(found.solution)
    assert filtered is not None
    (run,) = filtered.horizons
    resting_rows = np.any([*rows_near_rest(found.solution, 0).values()], axis=0)
    assert 0.1 < resting_rows.mean() < 0.5
    everywhere = whiteness(run.errors[:, 0], 1)
    assert everywhere is not None
    assert everywhere < 1e-9  # a rounded sign creeps
    (fit,) = found.fit.values()
    assert fit["x"].whiteness_p is not None
    assert fit["x"].whiteness_p > 0.01
    assert 0.97 < (fit["x"].prediction_rms or 0.0) < 1.03
    assert (fit["x"].effective_samples or 0.0) > 0.9 * fit["x"].samples
