"""How the cost of smoothing grows with the length of the record: `python tests/benchmarks/scaling.py`.

A simulated axis at 1 kHz, cut to different lengths, four free parameters, weights given. Every line: samples, unknowns, iterations,
seconds to build and to solve, peak memory of the process so far, microseconds per sample. The last line is the exponent of a power law
through the totals. Ratios in one run are what to look at: the machine may be busy.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.models import compile_model
from backsight.models.plants import actuator

LENGTHS = (2_500, 5_000, 10_000, 25_000, 50_000, 100_000)


def axis(count: int) -> Recording:
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
    return Recording(name="axis", time=t, inputs={"F": force}, outputs={"x": out + 2e-6 * noise}, output_std={"x": 2e-6})


def main() -> None:
    """Print the table."""
    dae, whole = compile_model(actuator()), axis(max(LENGTHS))
    guesses = {"carriage.m": Free(80.0), "friction.d": Free(100.0), "friction.f_c": Free(10.0), "offset.f": Free(0.0)}
    print(" samples  unknowns iterations  build s  solve s  total s     MB us/sample   mass")
    totals = []
    for count in (LENGTHS[0], *LENGTHS):  # the first run also loads the solver, and is not counted
        recording = Recording(
            name="axis",
            time=whole.time[:count],
            inputs={"F": whole.inputs["F"][:count]},
            outputs={"x": whole.outputs["x"][:count]},
            output_std={"x": 2e-6},
        )
        problem = Problem(model=dae, recordings=[recording], parameters=guesses, weights=Weights(W={"carriage": 0.05}))
        began = time.perf_counter()
        result = smooth(problem)
        total, solver = time.perf_counter() - began, result.solver
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        totals.append(total)
        print(
            f"{count:8d} {solver.variables:9d} {solver.iterations:10d} {solver.build_seconds:8.2f} {solver.seconds:8.2f} {total:8.2f} "
            f"{memory:6.0f} {1e6 * total / count:9.0f}   {result.parameters['carriage.m']}",
            flush=True,
        )
    slope = np.polyfit(np.log(LENGTHS), np.log(totals[1:]), 1)[0]
    print(f"total seconds grow as samples^{slope:.2f}")


if __name__ == "__main__":
    sys.exit(main())
