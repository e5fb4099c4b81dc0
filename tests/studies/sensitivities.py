"""How estimates move with their weights, from the KKT conditions and by solving again: `python tests/studies/sensitivities.py [plant ..]`.

A machine of `coverage.py` is smoothed. Every weight in turn is made a little larger and smaller, and the program solved to its last digits;
printed is the difference of the two derivatives over their size, of all unknowns in their scaled units and of the parameters. A large step
bends, a small one drowns in what is left of the solves: of central differences, each with half the step of the one before, and what two of
them extrapolate to (Richardson), the extrapolation is taken that differs least from the one before. How far these two are apart is printed
beside it: what the differences are known to.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
from coverage import CASES, pose

from backsight.estimation import smooth
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.weighing.kkt import sensitivity
from backsight.estimation.weighing.likelihood import likelihood
from backsight.estimation.weighing.turned import Turned, turned

STEPS = (1.6e-1, 8e-2, 4e-2, 2e-2, 1e-2)  # of log std
TOLERANCE = 1e-11


def exact(knobs: Turned) -> Turned:
    """The same, solved to the last digits."""
    solver = knobs.program.solver
    return replace(knobs, program=replace(knobs.program, solver=replace(solver, options=replace(solver.options, tolerance=TOLERANCE))))


def compared(plant: str) -> list[tuple[str, float, float, float]]:
    """Weight, differences of all unknowns and of the parameters over their size, and what those of all unknowns are known to."""
    problem, _ = pose(plant, 0)
    knobs = exact(turned(problem, smooth(problem, settings=Settings(marginal=False))))
    count, found = len(knobs.weights), list[tuple[str, float, float, float]]()
    solution = knobs.solve(np.zeros(count), newton=True)
    slopes = sensitivity(solution, likelihood(knobs, np.zeros(count), solution).pulls)
    unit, first = solution.values.unit, solution.transcription.nlp.trajectory_size
    for f, weight in enumerate(knobs.weights):
        central = []
        for step in STEPS:
            shift = step * np.eye(count)[f]
            ends = [knobs.solve(s, solution.solved.decisions, newton=True).solved.decisions for s in (shift, -shift)]
            central.append((ends[0] - ends[1]) / (2 * step) / unit)
        better = [(4.0 * fine - coarse) / 3.0 for coarse, fine in pairwise(central)]
        apart = [float(np.linalg.norm(b - a) / np.linalg.norm(b)) for a, b in pairwise(better)]
        best = better[int(np.argmin(apart)) + 1]
        off = best - slopes[:, f] / unit
        whole, of_parameters = (float(np.linalg.norm(off[part]) / np.linalg.norm(best[part])) for part in (slice(None), slice(first, None)))
        found.append((weight.label, whole, of_parameters, min(apart)))
    return found


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("plants", nargs="*", default=list(CASES), help=f"of {', '.join(CASES)} (default: all)")
    for plant in parser.parse_args().plants:
        began = time.perf_counter()
        for label, whole, of_parameters, known in compared(plant):
            said = f"all unknowns {whole:.1e} (differences known to {known:.1e}), parameters {of_parameters:.1e}"
            print(f"{plant:12} {label:20} {said}", flush=True)
        print(f"{plant:12} {time.perf_counter() - began:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
