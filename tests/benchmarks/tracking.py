"""What an estimate on-line takes, beside do-mpc and CasADi by hand: `python tests/benchmarks/tracking.py [axis] [xy_table]`.

Every line: milliseconds of a step on the clock (median, p95, p99, max) and of the processor (median, p99), the median over ours, steps of
Newton's method, solves that failed, and rms errors of states and parameters after two windows over those of ours. The machine may be busy:
the processor's time and the ratios in one run are what to look at. do-mpc is no dependency: PYTHONPATH=(where it is) has it in the table.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from tracking_cases import CASES, WINDOW, Case
from tracking_peers import DoMpc, Plain

from backsight.estimation.tracking import Estimator, Sample

SETTLED = 2 * WINDOW  # rows before any is counted


class Ours:
    """`Estimator` as a user makes it."""

    def __init__(self, case: Case, name: str, **options: Any) -> None:
        self.case, self.name = case, name
        self.estimator = Estimator(case.problem(), samples=WINDOW, **options)
        self.failed = self.iterations = 0
        self.stds: list[np.ndarray] = []

    def step(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """x, p after sample k."""
        run = self.case.run
        inputs = {name: float(u[k]) for name, u in run.inputs.items()}
        outputs = {name: float(y[k]) for name, y in run.outputs.items()}
        found = self.estimator.update(Sample(time=float(run.time[k]), inputs=inputs, outputs=outputs))
        self.failed += found.outcome.name == "FAILED"
        self.iterations += found.iterations
        x = [found.names.states.index(name) for name in self.case.states]
        p = [found.names.parameters.index(name) for name in self.case.guesses]
        self.stds.append(np.concatenate([found.states_std[x], found.parameters_std[p]]))
        return found.states[x], found.parameters[p]


@dataclass(frozen=True)
class Followed:
    """What an estimator did: [x; p] (rows, n), NaN where there is none yet; of the counted rows milliseconds on the clock and of the
    processor (m,), and Newton steps each."""

    found: np.ndarray
    clock: np.ndarray
    work: np.ndarray
    steps: float


def followed(estimator: Any, rows: int) -> Followed:
    """An estimator along the first rows of its case."""
    found, clock, work, begun = [], np.zeros(rows), np.zeros(rows), 0
    for k in range(rows):
        if k == SETTLED:
            begun = estimator.iterations
        wall, cpu = time.perf_counter(), time.process_time()
        now = estimator.step(k)
        clock[k], work[k] = 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)
        found.append(np.concatenate(now) if now else np.full(len(estimator.case.states) + len(estimator.case.guesses), np.nan))
    return Followed(np.array(found), clock[SETTLED:], work[SETTLED:], (estimator.iterations - begun) / (rows - SETTLED))


def makers(case: Case) -> list[Callable[[], Any]]:
    """The estimators of the table, ours first."""
    made: list[Callable[[], Any]] = [
        lambda: Ours(case, "ours"),
        lambda: Ours(case, "ours, 1 iteration", iterations=1),
        lambda: Plain(case, "radau"),
    ]
    if not case.stiff:
        made.append(lambda: Plain(case, "rk4"))
    if importlib.util.find_spec("do_mpc"):
        made.append(lambda: DoMpc(case))
    else:
        print("do-mpc cannot be imported here and has no line: install it anywhere and name the folder in PYTHONPATH")
    return made


def table(case: Case) -> None:
    """Print the lines of a case."""
    rows = len(case.run.time)
    truth = np.hstack([case.truth, np.tile(case.true_parameters, (rows, 1))])
    size = f"{len(case.states)} states, {len(case.guesses)} parameters"
    print(f"\n{case.name}: {rows} rows at {1 / case.step:g} Hz, window of {WINDOW}; {size}")
    columns = " ".join(f"{name:>8s}" for name in ("build s", "median", "p95", "p99", "max", "cpu", "cpu p99"))
    print(f"{'':20s} {columns} {'ratio':>6s} {'steps':>6s} failed  rms errors")
    first: tuple[Followed, np.ndarray] | None = None
    for make in makers(case):
        began = time.perf_counter()
        estimator = make()
        build = time.perf_counter() - began
        did = followed(estimator, rows)
        rms = np.sqrt(np.mean((did.found - truth)[SETTLED:] ** 2, axis=0))
        errors = " ".join(f"{e:.1e}" for e in rms) if first is None else " ".join(f"{e:7.2f}" for e in rms / first[1])
        first = first or (did, rms)
        quantiles = *np.quantile(did.clock, [0.5, 0.95, 0.99, 1.0]), *np.quantile(did.work, [0.5, 0.99])
        times = " ".join(f"{t:8.2f}" for t in quantiles)
        ratio = np.median(did.work) / np.median(first[0].work)
        print(f"{estimator.name:20s} {build:8.1f} {times} {ratio:6.2f} {did.steps:6.2f} {estimator.failed:6d}  {errors}", flush=True)
        if isinstance(estimator, Ours) and did is not first[0]:
            away = (np.abs(did.found - first[0].found) / np.array(estimator.stds))[SETTLED:].max(axis=1)
            far = f"{away.max():.2g} deviations at most, {np.quantile(away, 0.95):.2g} in 95 %"
            print(f"{'':20s} from the converged estimates: {far}")


def main() -> None:
    """Print a table for every case."""
    warnings.simplefilter("ignore", FutureWarning)  # of CasADi, in do-mpc's calls
    for name in sys.argv[1:] or CASES:
        table(CASES[name]())


if __name__ == "__main__":
    main()
