"""The optimal estimation problem of the report on the xy-table, posed with its own matrices W and V and solved; then its study of weights.

    .venv/bin/python tests/studies/report_problem.py [--intervals 1]

    z = [phi (3), phi' (3), theta (5)],  p = [phi'' (3), I (2)],  z' = A z + B p + xi,  zeta = [equations of motion; x_r, y_r; x_m, y_m; I]
    min  int xi' W xi + zeta' V zeta dt      theta = spindle.k, drive_1.J, drive_3.J, friction_1.tau_c, friction_3.tau_c

W = diag(1e-4 (3), 1e-5 (3), W_theta), V = diag(1e-4 (3), 10 (2), accelerations 0 (2), 10 (2), 10 (2)), 0.8 s at 500 Hz, from the initial
values of its appendix B; W_theta of its cases 1 and 2. The report's filter took forty minutes for a run.

A common factor on W and V changes no estimate, only what its deviation is said to be; here it is such that the positions have the 0.05 mm
that the report gives for them. phi'' is eliminated: xi of phi' adds M xi to the equations' residual, with (M xi)^2 below 2e-4 of that one's
own square. The initial state is unknown: the report instead ran its filter over the interval again and again.

The machine is simulated in closed loop, with process forces of the density that the weights suppose. Without them a controller that
feeds back the sensors' noise makes inertias come out too small: what the weights call force is noise that the currents answer.
"""

from __future__ import annotations

import argparse
import time as clock
from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

import numpy as np

from backsight.data.generators import xy_table as table
from backsight.data.generators.run import Force
from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.results import Smoothing
from backsight.models.plants import xy_table

GUESSES = {"spindle.k": 0.46, "drive_1.J": 1.28e-3, "drive_3.J": 6.0e-5, "friction_1.tau_c": 0.32, "friction_3.tau_c": 0.070}
TRUTH = {"spindle.k": 0.275, "drive_1.J": 2.33e-3, "drive_3.J": 2.37e-4, "friction_1.tau_c": 0.473, "friction_3.tau_c": 0.149}
KINEMATICS, EQUATIONS, POSITIONS, CURRENTS = 1e-4, 1e-4, 10.0, 10.0
CASES = {
    1: dict(zip(GUESSES, (1e-2, 1e2, 1e4, 1e-2, 1e-2), strict=True)),
    2: dict(zip(GUESSES, (1e1, 1e5, 1e7, 1e1, 1e1), strict=True)),
}
WEIGHTS = {"case 2": (2, 1.0), "case 1, drift x 100": (1, 100.0)}  # case, factor on the drift's std
INTERVALS = ((1.7, 2.5), (2.65, 3.45))  # s; the table moves back in the first and there in the second, without a reversal
MEASURED = ("x_r", "y_r", "x_m", "y_m")
STEP, SENSOR = 0.002, 5e-5  # s, m
SCALE = SENSOR * sqrt(POSITIONS * STEP)  # std = SCALE / sqrt(weight)
LENGTH, STROKE, BEGIN, RAMP = 0.040, 0.95, 0.60, 0.06  # m, s


def strokes(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and velocity [m/s] of a line there and back at constant speed, turning within RAMP."""
    beat = np.maximum(t - BEGIN, 0.0) % (2 * STROKE)
    turning = np.interp(beat, [0.0, RAMP, STROKE, STROKE + RAMP, 2 * STROKE], [-1.0, 1.0, 1.0, -1.0, -1.0])
    velocity = LENGTH / (STROKE - RAMP / 2) * np.where(t < BEGIN + RAMP, np.clip((t - BEGIN) / RAMP, 0.0, 1.0), turning)
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (velocity[1:] + velocity[:-1]) / 2)]), velocity


def recorded(
    machine: table.Table, interval: tuple[float, float], seed: int = 1, force: Force | None = None
) -> tuple[Recording, Mapping[str, np.ndarray]]:
    """The line, six times there and back, as measured in one interval [s], and what was true there."""
    t = np.arange(0.0, interval[1] + STEP / 2, STEP)
    process = dict.fromkeys(table.PLACES, SCALE / sqrt(EQUATIONS))
    conditions = replace(table.CONDITIONS, duration=float(t[-1]), process=process)
    run = table.simulate(machine, table.SERVOS, t, (strokes(t), strokes(t)), conditions, np.random.default_rng([seed, 1]), force)
    rows = t >= interval[0] - STEP / 2
    recording = Recording(
        name="line",
        time=t[rows] - interval[0],
        inputs={name: current[rows] for name, current in run.inputs.items()},
        outputs={name: run.outputs[name][rows] for name in MEASURED},
    )
    return recording, {name: value[rows] for name, value in run.truth.items()}


def posed(recording: Recording, case: int = 1, drift_of: float = 1.0) -> Problem:
    """The report's problem with the W_theta of a case, its standard deviations `drift_of` times as large."""
    W = {f"kinematics:drive_{i}.phi": SCALE / sqrt(KINEMATICS) for i in (1, 2, 3)}
    W |= {f"drive_{i}": SCALE / sqrt(EQUATIONS) for i in (1, 2, 3)}
    V = dict.fromkeys(MEASURED, SCALE / sqrt(POSITIONS * STEP)) | dict.fromkeys(("I_x", "I_y"), SCALE / sqrt(CURRENTS * STEP))
    free = {name: Free(guess, drift=drift_of * SCALE / sqrt(CASES[case][name])) for name, guess in GUESSES.items()}
    return Problem(model=xy_table(), recordings=[recording], parameters=free, weights=Weights(W=W, V=V))


def asymmetric(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """More friction of the y-axis in its positive direction [N m], rising up to 0.01 rad/s: a step at rest stops the simulator."""
    del t, q
    return np.array([0.0, 0.0, -0.019 * np.clip(v[2] / 0.01, 0.0, 1.0)])


CONCEALED: dict[str, tuple[table.Table, Force | None]] = {
    "nothing": (table.Table(), None),
    "friction at wheel 2": (replace(table.Table(), tau_2=0.05), None),
    "asymmetric y friction": (table.Table(), asymmetric),
}


def line(result: Smoothing, name: str) -> str:
    """A parameter's mean over time, its deviation, and how far it wanders."""
    estimate, course = result.parameters[name], result.estimates["line"][name]
    return f"{estimate.value:10.4g} ± {estimate.std or np.nan:7.1g} ({np.ptp(course) / TRUTH[name]:6.2%})"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--intervals", type=int, default=2, help="of the two, in the study of weights")
    intervals = INTERVALS[: parser.parse_args().intervals]
    problem = posed(recorded(table.Table(), INTERVALS[0])[0])
    began, worked = clock.perf_counter(), clock.process_time()
    result = smooth(problem)
    seconds, worked = clock.perf_counter() - began, clock.process_time() - worked
    facts = result.solver
    print(f"{seconds:.2f} s ({worked:.2f} s of a processor): build {facts.build_seconds:.2f} s, the rest {facts.seconds:.2f} s")
    print(f"{facts.variables} variables, {facts.iterations} iterations: {facts.status}\n")
    for name, truth in TRUTH.items():
        estimate = result.parameters[name]
        std = estimate.std or np.nan
        off = (estimate.value - truth) / std
        print(f"{name:18} {GUESSES[name]:9.4g} -> {estimate.value:9.4g} ± {std:7.2g}   true {truth:9.4g} ({off:+.1f})")
    print("\nmean over time ± deviation (range over time, of the true value)")
    for concealed, (machine, force) in CONCEALED.items():
        for interval in intervals:
            recording, _ = recorded(machine, interval, force=force)
            for what, (case, drift_of) in WEIGHTS.items():
                result = smooth(posed(recording, case, drift_of))
                print(
                    f"{concealed:22} {interval[0]:.2f}-{interval[1]:.2f} s  {what:20}", *(line(result, name) for name in TRUTH), flush=True
                )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
