"""Residual forces and noise of known size, and what the data tell of them: `python tests/studies/variances.py [--plants a,b] [--seeds 20]`.

Every run has a machine of its own, as in `coverage.py`, whose recording has white forces at some places and none at others: one of the
places that the generator disturbs is left alone, in turn. All weights are left to the data (`variance_components`), parameters are free and
start where they are known to be: what is judged here are the weights. Where the generator's own forces are too small for a recording to
tell them, larger ones act (STRONGER); `--own` leaves them as they are.

Per weight: the estimated std over the true one (median), how many 95 % intervals hold the truth, and the spread of the scores
log(ratio)/std, which should be 1. Per place without a force: how often it may be none at 5 %.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from coverage import CASES, pose

from backsight.estimation import Free, variance_components
from backsight.estimation.whole_files import written_whole

# Of the 2e-3 N m sqrt(s) of a bit whose friction is .4 N m, in 40 s, the logarithm is told to .3 .. 1, or not at all: of 12 such recordings
# 7 are as probable without it (`--own`).
STRONGER = {"drillstring": {"rotary_table": 5e-3, "bha": 2e-2}}


def estimate(plant: str, seed: int, own: bool = False) -> dict[str, Any]:
    """The outcome of a run, as it is kept."""
    process = {**CASES[plant].generator.CONDITIONS.process, **({} if own else STRONGER.get(plant, {}))}
    if len(process) > 1 or seed % 2:
        process[sorted(process)[seed % len(process)]] = 0.0
    problem, drawn = pose(plant, seed, process)
    noise = problem.recordings[0].output_std
    known = {k: replace(f, guess=drawn.truth[k]) if isinstance(f, Free) else f for k, f in problem.parameters.items()}
    began = time.perf_counter()
    try:
        found = variance_components(replace(problem, parameters=known))
    except Exception as error:  # a run that fails is counted as one
        return {"plant": plant, "seed": seed, "error": f"{type(error).__name__}: {error}", "seconds": time.perf_counter() - began}
    true = {f"W of {k}": v for k, v in process.items()} | {f"V of {k}": v for k, v in noise.items()}
    weights = {
        label: {
            "true": true.get(label, 0.0),
            "std": c.std,
            "log_std": c.log_std,
            "p_zero": c.p_zero,
            "unit": c.unit,
            "interval": c.interval,
        }
        for label, c in found.items()
    }
    return {"plant": plant, "seed": seed, "weights": weights, "seconds": time.perf_counter() - began}


def table(runs: list[dict[str, Any]]) -> str:
    """Of the runs of a plant."""
    good = [r for r in runs if "error" not in r]
    seconds = sorted(r["seconds"] for r in runs)
    lines = [f"{runs[0]['plant']}: {len(good)} of {len(runs)} runs, median {np.median(seconds):.0f} s, longest {seconds[-1]:.0f} s"]
    lines += [f"    seed {r['seed']}: {r['error']}" for r in runs if "error" in r]
    lines.append(f"    {'weight':24s}{'median ratio':>14s}{'95 % hold':>12s}{'spread z':>10s}{'called none':>14s}{'p unknown':>11s}")
    for label in dict.fromkeys(label for r in good for label in r["weights"]):
        rows = [r["weights"][label] for r in good if label in r["weights"]]
        there, none = [w for w in rows if w["true"]], [w for w in rows if not w["true"]]
        untold, there = sum(not np.all(np.isfinite(w["interval"])) for w in there), [w for w in there if np.all(np.isfinite(w["interval"]))]
        ratio = np.array([w["std"] / w["true"] for w in there])
        z = np.log(ratio) / np.array([w["log_std"] for w in there]) if there else np.empty(0)
        told = [w for w in none if w["p_zero"] is not None and np.isfinite(w["p_zero"])]
        zero = sum(w["p_zero"] > 0.05 for w in told)
        missed = sum(w["p_zero"] is not None and w["p_zero"] > 0.05 for w in there)
        held = sum(w["interval"][0] <= w["true"] <= w["interval"][1] for w in there)
        right = f"{np.median(ratio):14.3f}{f'{held} of {len(z)}':>12s}" if there else " " * 26
        spread = f"{z.std(ddof=1):10.2f}" if len(z) > 1 else " " * 10
        called = f"{f'{zero} of {len(told)}':>14s}{len(none) - len(told):11d}" if none else " " * 25
        lines.append(f"    {label:24s}{right}{spread}{called}")
        lines += [f"{'':28s}{missed} of {len(there)} that are there called none"] if missed else []
        lines += [f"{'':28s}{untold} without an interval, not in the row above"] if untold else []
    return "\n".join(lines)


def main() -> None:
    """Run what is not yet in the file, then print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plants", default=",".join(CASES), help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--seeds", type=int, default=20, help="runs per plant (default: 20)")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time (default: 2)")
    parser.add_argument("--out", type=Path, help="file that keeps the runs")
    parser.add_argument("--own", action="store_true", help="the generators' own forces, also where they are too small to be told")
    asked = parser.parse_args()
    plants = asked.plants.split(",")
    if unknown := sorted(set(plants) - set(CASES)):
        parser.error(f"--plants {','.join(unknown)}: no such plant; there are {', '.join(CASES)}")
    runs: dict[str, dict[str, Any]] = json.loads(asked.out.read_text()) if asked.out and asked.out.exists() else {}
    todo = [(plant, seed) for plant in plants for seed in range(asked.seeds) if "weights" not in runs.get(f"{plant} {seed}", {})]
    with ProcessPoolExecutor(asked.jobs) as pool:
        try:
            for future in as_completed([pool.submit(estimate, *what, asked.own) for what in todo]):
                run = future.result()
                runs[f"{run['plant']} {run['seed']}"] = run
                print(f"{run['plant']} {run['seed']}: {run['seconds']:.0f} s {run.get('error', '')}", file=sys.stderr, flush=True)
                if asked.out:
                    with written_whole(asked.out) as file:
                        file.write(json.dumps(runs, indent=1).encode())
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise
    for plant in plants:
        print("\n" + table([runs[f"{plant} {seed}"] for seed in range(asked.seeds)]))


if __name__ == "__main__":
    main()
