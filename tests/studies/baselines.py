"""Every classical method that applies to the recorded EMPS axis, beside the smoother, and what each predicts of the record with pulses.

    BACKSIGHT_DATA=/path/to/recordings .venv/bin/python tests/studies/baselines.py [--seconds 12.4]

Parameters from the first seconds of emps/emps_estimation.csv; held out: emps/emps_pulses_validation.csv, in which pulses of force excite
a flexible mode that no model here has. Published (A. Janot, M. Gautier, M. Brunot 2019): 95.11 kg, 203.5 N.s/m, 20.39 N, -3.165 N.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd

from backsight.estimation import (
    Baseline,
    Free,
    Problem,
    Recording,
    compare,
    filtered_least_squares,
    harmonic,
    prediction_error,
    smooth,
    state_variable_filter,
    two_stage,
    zoh_prediction_error,
)
from backsight.models.plants import actuator

FREE = {"carriage.m": Free(80.0), "friction.d": Free(100.0), "friction.f_c": Free(10.0), "offset.f": Free(0.0)}
METHODS = {
    "filtered least squares, 25 Hz": partial(filtered_least_squares, cutoff=25.0),
    "filtered least squares, decimated": partial(filtered_least_squares, cutoff=100.0, poles=2, decimate=10),
    "state-variable filter, 25 Hz": partial(state_variable_filter, cutoff=25.0),
    "output error, whole": prediction_error,
    "output error, 1 s": partial(prediction_error, segment=1.0),
    "zero-order hold, about 0.1 m/s": partial(zoh_prediction_error, point={"carriage.v": 0.1}),
    "two stages, then output error of 1 s": partial(
        two_stage, references=["q_ref"], order=400, first="fir", second=partial(prediction_error, segment=1.0)
    ),
    "harmonics": partial(harmonic, frequency=1.0),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=24.9, help="of the record that is fitted")
    seconds = parser.parse_args().seconds
    folder = Path(os.environ.get("BACKSIGHT_DATA", "")) / "emps"
    if not (folder / "emps_estimation.csv").is_file():
        print("needs emps/emps_estimation.csv and emps/emps_pulses_validation.csv in the folder that BACKSIGHT_DATA names")
        return 1
    columns = {"time": "t_s", "inputs": {"F": "u_force_N", "q_ref": "q_ref_m"}, "outputs": {"x": "q_m"}, "std": {"x": 2e-6}}
    fitted = Recording.read(folder / "emps_estimation.csv", range=(0.0, seconds), name="fit", **columns)
    pulses = Recording.read(folder / "emps_pulses_validation.csv", role="held_out", name="pulses", **columns)
    problem = Problem(model=actuator(), recordings=[fitted, pulses], parameters=FREE)
    bare = replace(problem, recordings=[replace(r, inputs={"F": r.inputs["F"]}) for r in problem.recordings])
    took = {}
    start = time.perf_counter()
    result = smooth(bare)
    took["smooth"] = time.perf_counter() - start
    table = compare(problem, [timed(name, method, took) for name, method in METHODS.items()], result)
    table["seconds"] = pd.Series(took)
    shown = [*FREE, *(f"{name}.std" for name in FREE), "fit.x.rms", "pulses.x.simulated", "pulses.x.ahead", "seconds"]
    with pd.option_context("display.width", 300, "display.max_columns", None, "display.precision", 4):
        print(table[[c for c in shown if c in table]].to_string())
    for name, note in table["note"].items():
        if note:
            print(f"{name}: {note}")
    return 0


def timed(name: str, method, took: dict[str, float]):  # type: ignore[no-untyped-def]
    """The method under the name that the table shows; its time goes into `took`."""

    def run(problem: Problem) -> Baseline:
        start = time.perf_counter()
        try:
            return replace(method(problem), method=name)
        finally:
            took[name] = time.perf_counter() - start

    run.__name__ = name
    return run


if __name__ == "__main__":
    sys.exit(main())
