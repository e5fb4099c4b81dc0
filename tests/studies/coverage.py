"""Bias, coverage and convergence of the smoother on simulated machines: `python tests/studies/coverage.py [--plants a,b] [--seeds 20]`.

Every run has a machine of its own (parameters within +-30 % of the plant's, at random), simulated under closed-loop control by
`backsight.data.generators`, which shares no code with the estimator, and recorded with white noise. Every estimated parameter starts at a
guess a factor 3 off, up or down at random. The weights of the residual forces are left to the smoother; the sensors' noise is given.

A run is a process of its own, ended after `--limit` seconds. `--out FILE.json` keeps finished runs; the same command goes on where it
stopped. Intervals of 95 % should hold the truth in 95 % of the runs, and z = (estimate - truth)/std should have spread 1.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from backsight.data.generators import actuator, drillstring, five_bar, quadrotor, xy_table
from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.whole_files import written_whole
from backsight.models import compile_model
from backsight.models.plants import PLANTS

SPREAD, OFF = 0.3, 3.0  # of the machines about the plant's values; of the guesses about the machine's
QUANTILE = 1.959964  # of the standard normal distribution, 95 % within


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is estimated on a plant, and which machines and guesses are possible.

    free        estimated parameters
    tied        parameter -> (another one, least and greatest ratio to it): drawn too, and known to the smoother
    operable    whether a machine with these values can do what the recording asks of it
    physical    whether these values are those of a body at all; guesses obey it too
    """

    generator: ModuleType
    free: tuple[str, ...]
    tied: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    operable: Callable[[Mapping[str, float]], bool] = lambda _: True
    physical: Callable[[Mapping[str, float]], bool] = lambda _: True


def flies(values: Mapping[str, float]) -> bool:
    """Whether the quadrotor hovers with room for control, up and down."""
    return 0.45 <= quadrotor.with_values(values).hover <= 0.85


def rigid(values: Mapping[str, float]) -> bool:
    """Whether link 56 has a moment of inertia about its centre of mass."""
    return values["P_6"] - values["P_5"] ** 2 / values["P_4"] > 0.05 * values["P_6"]


CASES = {
    "quadrotor": Case(
        generator=quadrotor,
        free=(
            "body.Ixx",
            "body.Iyy",
            "body.Izz",
            "body.drag_w",
            "body.drag_p",
            "body.drag_q",
            "body.drag_r",
            "rotor.tau",
            "rotor.gain",
        ),
        operable=flies,
    ),
    "drillstring": Case(
        generator=drillstring,
        free=("string.k", "bha.J", "bha.d", "bit.tau_sl"),
        tied={"bit.tau_st": ("bit.tau_sl", 1.2, 1.8)},
    ),
    "xy_table": Case(generator=xy_table, free=("spindle.k", "drive_1.J", "drive_3.J", "friction_1.tau_c", "friction_3.tau_c")),
    "five_bar": Case(generator=five_bar, free=tuple(f"P_{i}" for i in range(1, 7)), physical=rigid),
    "actuator": Case(generator=actuator, free=("carriage.m", "friction.d", "friction.f_c", "offset.f")),
}


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What a seed draws: the values to be found, the guesses of them, and values that are drawn and known."""

    truth: dict[str, float]
    guess: dict[str, float]
    known: dict[str, float]


def machine(plant: str, seed: int, info: Mapping[str, float]) -> Machine:
    """The machine and the guesses of a seed; info: the plant's parameters."""
    case, rng = CASES[plant], np.random.default_rng([seed, *plant.encode()])

    def values() -> dict[str, float]:
        return {name: info[name] * rng.uniform(1 - SPREAD, 1 + SPREAD) for name in case.free}

    def guesses() -> dict[str, float]:
        return {name: value * OFF ** rng.choice([-1.0, 1.0]) for name, value in truth.items()}

    truth = _drawn(values, lambda values: case.physical(values) and case.operable(values))
    guess = _drawn(guesses, case.physical)
    known = {name: truth[other] * rng.uniform(least, most) for name, (other, least, most) in case.tied.items()}
    return Machine(truth=truth, guess=guess, known=known)


def pose(plant: str, seed: int, process: Mapping[str, float] | None = None) -> tuple[Problem, Machine]:
    """The recording of a seed as a problem for the smoother; `process`: its white forces, place -> std, by default the generator's own."""
    dae, generator = compile_model(PLANTS[plant]()), CASES[plant].generator
    info = {p.name: p for p in dae.parameters}
    drawn = machine(plant, seed, {name: p.value for name, p in info.items()})
    conditions = generator.CONDITIONS if process is None else replace(generator.CONDITIONS, process=dict(process))
    run = generator.record(generator.with_values({**drawn.truth, **drawn.known}), seed=seed, conditions=conditions)
    recording = Recording(name=f"{plant} {seed}", time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    free = {name: Free(value, min=info[name].minimum, max=info[name].maximum) for name, value in drawn.guess.items()}
    return Problem(model=dae, recordings=[recording], parameters={**free, **drawn.known}), drawn


def _drawn(draw: Callable[[], dict[str, float]], accepted: Callable[[Mapping[str, float]], bool]) -> dict[str, float]:
    for _ in range(10_000):
        values = draw()
        if accepted(values):
            return values
    raise RuntimeError("none of 10 000 drawn sets of parameters is possible")


def estimate(plant: str, seed: int, disturbed: bool) -> dict[str, Any]:
    """The outcome of a run, as it is kept."""
    problem, drawn = pose(plant, seed, None if disturbed else {})
    began = time.perf_counter()
    result = smooth(problem)
    seconds = time.perf_counter() - began
    found = {
        name: {"truth": true, "guess": drawn.guess[name], "value": result.parameters[name].value, "std": result.parameters[name].std}
        for name, true in drawn.truth.items()
    }
    status = "converged" if result.solver.converged else f"not converged: {result.solver.status}"
    return {"status": status, "seconds": seconds, "iterations": result.solver.iterations, "parameters": found}


def worker(plant: str, seed: int, *, disturbed: bool, limit: float) -> dict[str, Any]:
    """`estimate` in a process of its own; what goes wrong there is its status."""
    command = [sys.executable, str(Path(__file__).resolve()), "--one", plant, str(seed)] + ([] if disturbed else ["--undisturbed"])
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, env=environment, check=False)
    except subprocess.TimeoutExpired:
        return {"status": f"time limit of {limit:g} s", "seconds": limit, "limit": limit}
    if done.returncode != 0:
        said = done.stderr.strip().splitlines() or ["no message"]
        where = [line.strip() for line in said if line.lstrip().startswith("File ")][-1:]
        return {"status": f"failed with exit status {done.returncode}: {said[-1]} {''.join(where)}", "seconds": None, "limit": 0.0}
    outcome: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return outcome


def table(plant: str, runs: list[dict[str, Any]]) -> str:
    """Runs, seconds and, for each parameter over the runs that converged: bias, spread of z, coverage."""
    good = [run for run in runs if run["status"] == "converged"]
    seconds = [run["seconds"] for run in runs if run["seconds"] is not None]
    timing = f"; median {statistics.median(seconds):.0f} s, longest {max(seconds):.0f} s" if seconds else ""
    lines = [f"{plant}: {len(good)} of {len(runs)} runs converged{timing}"]
    reasons = [run["status"] for run in runs if run["status"] != "converged"]
    lines += [f"    {reasons.count(reason)} x {reason}" for reason in sorted(set(reasons))]
    if not good:
        return "\n".join(lines)
    lines.append(
        f"    {'parameter':18s}{'bias %':>20s}{'worst %':>10s}{'median std %':>14s}{'mean z':>16s}{'spread z':>10s}{'95 % holds':>14s}"
    )
    for name in good[0]["parameters"]:
        rows = [run["parameters"][name] for run in good]
        error = 100 * np.array([row["value"] / row["truth"] - 1 for row in rows])
        told = [row for row in rows if row["std"]]
        z = np.array([(row["value"] - row["truth"]) / row["std"] for row in told])
        std = 100 * np.median([row["std"] / abs(row["truth"]) for row in told]) if told else math.nan
        lines.append(
            f"    {name:18s}{_mean(error):>20s}{error[np.abs(error).argmax()]:10.2f}{std:14.3f}{_mean(z):>16s}"
            f"{z.std(ddof=1) if z.size > 1 else math.nan:10.2f}{f'{int((np.abs(z) < QUANTILE).sum())} of {len(rows)}':>14s}"
        )
    return "\n".join(lines)


def _mean(values: np.ndarray) -> str:
    """Mean and its standard error."""
    if not values.size:
        return "none"
    error = f"{values.std(ddof=1) / np.sqrt(values.size):.2f}" if values.size > 1 else "?"
    return f"{values.mean():.2f} ± {error}"


def main() -> None:
    """Run what is not yet in the file, then print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plants", default=",".join(CASES), help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--seeds", type=int, default=20, help="runs per plant (default: 20)")
    parser.add_argument("--first", type=int, default=0, help="the first seed (default: 0)")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time (default: 2)")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds for a run (default: 300)")
    parser.add_argument("--undisturbed", action="store_true", help="without white forces on the machines")
    parser.add_argument("--out", type=Path, help="file that keeps the runs")
    parser.add_argument("--one", nargs=2, metavar=("PLANT", "SEED"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(estimate(asked.one[0], int(asked.one[1]), not asked.undisturbed)))
        return
    plants = asked.plants.split(",")
    if unknown := sorted(set(plants) - set(CASES)):
        parser.error(f"--plants {','.join(unknown)}: no such plant; there are {', '.join(CASES)}")
    runs: dict[str, dict[str, Any]] = json.loads(asked.out.read_text()) if asked.out and asked.out.exists() else {}
    suffix = " undisturbed" if asked.undisturbed else ""
    keys = {f"{plant} {seed}{suffix}": (plant, seed) for plant in plants for seed in range(asked.first, asked.first + asked.seeds)}
    # A run that ran out of time is tried again when it is given more, one that failed in any case.
    todo = {key: what for key, what in keys.items() if key not in runs or runs[key].get("limit", math.inf) < asked.limit}
    print(f"{len(keys)} runs, {len(keys) - len(todo)} of them done before", flush=True)
    with ThreadPoolExecutor(asked.jobs) as pool:
        started = {pool.submit(worker, *what, disturbed=not asked.undisturbed, limit=asked.limit): key for key, what in todo.items()}
        try:
            for future in as_completed(started):
                key, run = started[future], future.result()
                runs[key] = run
                if asked.out:
                    with written_whole(asked.out) as file:
                        file.write(json.dumps(runs, indent=1).encode())
                took = "" if run["seconds"] is None else f"{run['seconds']:7.1f} s"
                print(f"{key:28s} {took:10s} {run['status']}", flush=True)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise
    for plant in plants:
        print("\n" + table(plant, [runs[key] for key, what in keys.items() if what[0] == plant]))


if __name__ == "__main__":
    main()
