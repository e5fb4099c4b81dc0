"""How estimates move with their weights, from the KKT conditions and by solving again: `python tests/studies/sensitivities.py [plant ..]`.

A machine of `coverage.py` is smoothed. Every weight in turn is made a little larger and smaller, and the program solved to its last digits;
printed is the difference of the two derivatives over their size, of all unknowns in their scaled units and of the parameters, by the step
at which it is least: a large one bends, a small one drowns in what is left of the solves. Central differences of a step and of half of it,
and what both extrapolate to (Richardson).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from coverage import CASES, pose

from backsight.estimation import smooth
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.weighing.kkt import sensitivity
from backsight.estimation.weighing.likelihood import Likelihood
from backsight.estimation.weighing.turned import Turned, turned

STEPS = (4e-2, 2e-2, 1e-2, 5e-3, 2.5e-3)  # of log std
TOLERANCE = 1e-11


def exact(knobs: Turned) -> Turned:
    """The same, solved to the last digits."""
    solver = knobs.program.solver
    return replace(knobs, program=replace(knobs.program, solver=replace(solver, options=replace(solver.options, tolerance=TOLERANCE))))


def compared(plant: str) -> list[tuple[str, tuple[float, float], tuple[float, float]]]:
    """Weight, differences of all unknowns and of the parameters over their size, each with its step."""
    problem, _ = pose(plant, 0)
    knobs = exact(turned(problem, smooth(problem, settings=Settings(marginal=False))))
    count, found = len(knobs.weights), list[tuple[str, tuple[float, float], tuple[float, float]]]()
    solution = knobs.solve(np.zeros(count), newton=True)
    slopes = sensitivity(solution, Likelihood(solution, [knobs.rows(f, np.zeros(count)) for f in range(count)]).pulls)
    unit, first = solution.values.unit, solution.transcription.nlp.trajectory_size
    for f, weight in enumerate(knobs.weights):
        off, coarser = [], None
        for step in STEPS:
            shift = step * np.eye(count)[f]
            ends = [knobs.solve(s, solution.solved.decisions, newton=True).solved.decisions for s in (shift, -shift)]
            central = (ends[0] - ends[1]) / (2 * step) / unit
            for again in (central,) if coarser is None else (central, (4.0 * central - coarser) / 3.0):
                parts = (again - slopes[:, f] / unit)[first:], again[first:]
                off.append(
                    (
                        np.linalg.norm(again - slopes[:, f] / unit) / np.linalg.norm(again),
                        np.linalg.norm(parts[0]) / np.linalg.norm(parts[1]),
                        step,
                    )
                )
            coarser = central
        whole, of_parameters = min((all_of_it, step) for all_of_it, _, step in off), min((of_them, step) for _, of_them, step in off)
        found.append((weight.label, (float(whole[0]), whole[1]), (float(of_parameters[0]), of_parameters[1])))
    return found


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("plants", nargs="*", default=list(CASES), help=f"of {', '.join(CASES)} (default: all)")
    for plant in parser.parse_args().plants:
        began = time.perf_counter()
        for label, whole, of_parameters in compared(plant):
            said = (
                f"{what} {off:.1e} (a step of {step:g})" for what, (off, step) in (("all unknowns", whole), ("parameters", of_parameters))
            )
            print(f"{plant:12} {label:20}", ", ".join(said), flush=True)
        print(f"{plant:12} {time.perf_counter() - began:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
