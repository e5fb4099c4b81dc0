"""Derivatives at all points of a program: NumPy, an operation at a time, against CasADi's map: `python tests/benchmarks/columns.py`.

The xy-table's balances with their derivatives, at points in different number. Every line: points, seconds of a call by the
map and by ours (best of five), their ratio, and what the first call of ours costs more.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from backsight.ocp.columnwise import REPAYS, Columnwise
from backsight.ocp.pointwise import COMMON
from backsight.ocp.polynomials import Array


def best(call: Callable[[], object], runs: int = 5) -> float:
    """Seconds of the fastest of a few calls."""
    seconds = []
    for _ in range(runs):
        began = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def main() -> None:
    function = linearised_balances()
    rng = np.random.default_rng(0)
    print("  points     map s    ours s   ratio   first s")
    for count in (100, 400, 1000, 4000, 16000):
        arguments: list[Array] = [
            rng.uniform(0.5, 1.0, function.numel_in(i) if i in COMMON else (function.numel_in(i), count)) for i in range(function.n_in())
        ]
        ours = Columnwise(function, COMMON)
        by_map = best(partial(ours._by_casadi, arguments, count))
        ours._seen = REPAYS
        first, wide = best(partial(ours, *arguments), runs=1), best(partial(ours, *arguments))
        print(f"{count:8d} {by_map:9.4f} {wide:9.4f} {by_map / wide:7.1f} {first - wide:9.3f}", flush=True)


def linearised_balances() -> Any:
    """The function of the balances of a transcribed xy-table."""
    from report_problem import posed, recorded, table  # of tests/studies

    from backsight.estimation.smoothing.horizons import output_stds
    from backsight.estimation.smoothing.meshing import follow_closely
    from backsight.ocp import ParameterPrior, transcribe

    problem = posed(recorded(table.Table(), (1.7, 2.5))[0]).plain
    followed = follow_closely(problem, output_stds(problem)[0], None)
    std = dict.fromkeys(range(len(problem.dae.places)), 1.0)
    prior = ParameterPrior(mean=np.zeros(len(problem.free)), std=np.full(len(problem.free), np.inf))
    t = transcribe(problem.dae, followed.horizons, free=problem.free, prior=prior, force_std=std, degree=2)
    number = next(k for k, term in enumerate(t.nlp.terms) if term.name == t.force_term)
    return t.nlp.evaluated._blocks[number]._point.linearised._function


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
    main()
