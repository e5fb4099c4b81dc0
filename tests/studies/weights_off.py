"""Weights a hundred times off, studied: `python tests/studies/weights_off.py [--plants a,b] [--seeds 3]`.

A machine of `coverage.py` is recorded three times. One recording is studied (`weigh`) from weights of which each is a hundred times too
large or too small at random, the second is held out and judges. Beside it the first is smoothed with the weights that the simulator has.
Printed is by how much the errors of predicted windows of the third are larger, which has judged nothing, in the mean over outputs and
lengths (`proof.py`): it should be below 2 %; and the same of smoothing with the weights that are off. (Not of the largest output:
an accelerometer sees a body that breaks away a sample later, and that of a few windows raised the rms of one by 75 %.)
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace

import numpy as np
from coverage import CASES, pose

from backsight.estimation import Problem, Recording, Smoothing, Weights, smooth, weigh
from backsight.estimation.diagnosis.proof.proof import prove
from backsight.models import SolveError

OFF = 100.0
HELD_OUT, UNSEEN = 1000, 2000  # added to the seed of what is held out, and of what it is compared by


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plants", default="actuator,xy_table,five_bar", help=f"of {', '.join(CASES)}")
    parser.add_argument("--seeds", type=int, default=3, help="runs per plant (default: 3)")
    parser.add_argument("--jobs", type=int, default=1, help="processes of a study (default: 1)")
    asked = parser.parse_args()
    for plant in asked.plants.split(","):
        for seed in range(asked.seeds):
            began = time.perf_counter()
            _, off = problems(plant, seed, HELD_OUT)
            unseen, badly = problems(plant, seed, UNSEEN)
            found = weigh(off, jobs=asked.jobs, progress=lambda line: print(f"  {line}", file=sys.stderr, flush=True))
            right, wrong, ours = (fitted(p) for p in (unseen, badly, replace(unseen, weights=found.recommended.weights)))
            print(
                f"{plant} {seed}: {found.chosen}; unseen {further(ours, right, unseen)} "
                f"(with the weights that are off {further(wrong, right, unseen)}), {time.perf_counter() - began:.0f} s",
                flush=True,
            )


def problems(plant: str, seed: int, more: int) -> tuple[Problem, Problem]:
    """With the weights of the simulator, and with others; more: added to the seed of the recording that is held out."""
    posed, drawn = pose(plant, seed)
    generator = CASES[plant].generator
    process, rng = generator.CONDITIONS.process, np.random.default_rng([seed, *plant.encode()])
    other = generator.record(generator.with_values({**drawn.truth, **drawn.known}), seed=seed + more)
    held_out = Recording(
        name="held out", time=other.time, inputs=other.inputs, outputs=other.outputs, output_std=other.noise, role="held_out"
    )
    true = replace(posed, recordings=[*posed.recordings, held_out], weights=Weights(W=dict(process), V=dict(other.noise)))
    W = {place: std * OFF ** rng.choice([-1.0, 1.0]) for place, std in process.items()}
    V = {output: std * OFF ** rng.choice([-1.0, 1.0]) for output, std in other.noise.items()}
    return true, replace(true, weights=Weights(W=W, V=V))


def fitted(problem: Problem) -> tuple[Problem, Smoothing]:
    """Smoothed without what is held out."""
    alone = replace(problem, recordings=[r for r in problem.recordings if r.role == "fit"])
    return alone, smooth(alone)


def further(one: tuple[Problem, Smoothing], other: tuple[Problem, Smoothing], unseen: Problem) -> str:
    """By how much the errors of predicted windows of what is held out are larger, in the mean and of the output and length where most."""
    try:
        found = prove(other, one, [r for r in unseen.recordings if r.role == "held_out"])
    except SolveError as error:
        return f"not told: {error}"
    worst = max(
        (found.after[y].windows[s] / e - 1.0, y, s) for y, errors in found.before.items() for s, e in errors.windows.items() if e > 0
    )
    return f"{-found.improvement_percent:+.2f} %, at most {100 * worst[0]:+.2f} % ({worst[1]} over {worst[2]:.3g} s)"


if __name__ == "__main__":
    main()
