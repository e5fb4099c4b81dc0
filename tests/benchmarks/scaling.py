"""How the cost of smoothing grows with the length of the record: `python tests/benchmarks/scaling.py [axis|xy_table] [--long]`.

A simulated axis at 1 kHz with four free parameters, or an xy-table at 500 Hz with five, cut to different lengths, weights given. Every
line: samples, unknowns, iterations, seconds to build and to solve, peak memory of the process so far, microseconds per sample. The last
lines are the exponents of power laws through the totals and the memory. Ratios in one run are what to look at: the machine may be busy.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from backsight.data.generators import xy_table as table
from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.models import compile_model
from backsight.models.plants import PLANTS

LENGTHS = {"axis": (2_500, 5_000, 10_000, 25_000, 50_000, 100_000), "xy_table": (1_000, 2_000, 5_000, 10_000)}
LONG = {"axis": (250_000,), "xy_table": (25_000, 50_000)}


def axis(count: int) -> Problem:
    """An axis under a sum of sines, its friction by fine explicit steps: good enough for timing."""
    t = np.arange(count) * 1e-3
    force = 70 * np.sin(5.0 * t) + 60 * np.sin(13.0 * t + 1.0) + 30 * np.sign(np.sin(1.7 * t))
    x, v, step, fine = 0.0, 0.0, 1e-3, 5
    out = np.empty(count)
    for k in range(count):
        out[k] = x
        for _ in range(fine):
            v += step / fine * (force[k] - 203.5 * v - 20.4 * np.tanh(v / 5e-3) + 3.2) / 95.1
            x += step / fine * v
    noise = np.random.default_rng(0).standard_normal(count)
    recording = Recording(name="axis", time=t, inputs={"F": force}, outputs={"x": out + 2e-6 * noise}, output_std={"x": 2e-6})
    guesses = {"carriage.m": Free(80.0), "friction.d": Free(100.0), "friction.f_c": Free(10.0), "offset.f": Free(0.0)}
    return Problem(
        model=compile_model(PLANTS["actuator"]()), recordings=[recording], parameters=guesses, weights=Weights(W={"carriage": 0.05})
    )


def xy_table(count: int) -> Problem:
    """A table in closed loop."""
    conditions = replace(table.CONDITIONS, duration=count * table.CONDITIONS.step)
    run = table.record(table.Table(), seed=0, conditions=conditions)
    recording = Recording(name="table", time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    guesses = {"spindle.k": 0.4, "drive_1.J": 2e-3, "drive_3.J": 2e-4, "friction_1.tau_c": 0.4, "friction_3.tau_c": 0.1}
    return Problem(
        model=compile_model(PLANTS["xy_table"]()),
        recordings=[recording],
        parameters={name: Free(guess) for name, guess in guesses.items()},
        weights=Weights(W=conditions.process),
    )


MAKERS: dict[str, Callable[[int], Problem]] = {"axis": axis, "xy_table": xy_table}


def cut(problem: Problem, count: int) -> Problem:
    """The problem with the first `count` samples."""
    (r,) = problem.recordings
    inputs, outputs = ({name: y[:count] for name, y in columns.items()} for columns in (r.inputs, r.outputs))
    return replace(
        problem, recordings=[Recording(name=r.name, time=r.time[:count], inputs=inputs, outputs=outputs, output_std=r.output_std)]
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("plant", nargs="?", choices=list(MAKERS), default="axis")
    parser.add_argument("--long", action="store_true", help="longer records too")
    asked = parser.parse_args()
    lengths = LENGTHS[asked.plant] + (LONG[asked.plant] if asked.long else ())
    whole = MAKERS[asked.plant](max(lengths))
    print(" samples  unknowns iterations  build s  solve s  total s     MB us/sample   estimates")
    totals, memories = [], []
    for count in (lengths[0], *lengths):  # the first run also loads the solver, and is not counted
        problem = cut(whole, count)
        began = time.perf_counter()
        result = smooth(problem)
        total, solver = time.perf_counter() - began, result.solver
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        totals.append(total)
        memories.append(memory)
        free = "; ".join(str(p) for p in result.parameters.values() if not p.fixed)
        print(
            f"{count:8d} {solver.variables:9d} {solver.iterations:10d} {solver.build_seconds:8.2f} {solver.seconds:8.2f} {total:8.2f} "
            f"{memory:6.0f} {1e6 * total / count:9.0f}   {free}",
            flush=True,
        )
    for what, sizes in (("total seconds", totals), ("peak memory", memories)):
        slope = np.polyfit(np.log(lengths), np.log(sizes[1:]), 1)[0]
        print(f"{what} grow as samples^{slope:.2f}")


if __name__ == "__main__":
    sys.exit(main())
