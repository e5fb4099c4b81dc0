"""Evidence of models whose residual forces are held at given deviations: each with the common factor on these that suits it best.

The deviations suit the base model, wrong as it is. A model that explains more would leave forces a tenth as large, and with the same
deviations pays for what it does not need: a wrong inertia ten times too large turns the same torques into a tenth of the accelerations,
and is the more probable one though all its forces are off. One factor for all places follows what a model is worth, and wanders with
nothing; the samples' prediction errors give the likelihood for any (`validation/innovations.py`).
"""

from __future__ import annotations

import numpy as np

from backsight.ocp import Solution

from ...validation.innovations import innovations, log_likelihood

FACTOR = 10.0**-0.5  # from one to the next that is tried
TIGHTEST, LOOSEST = 1e-3, 1e3


def rescaled(solution: Solution) -> tuple[float, float]:
    """Nats of log evidence with the factor that is best, over that with none, and the factor; 0 and 1 where the solution is no chain."""
    count = len(solution.transcription.soft)

    def told(factor: float) -> float:
        found = innovations(solution, np.full(count, factor))
        return -np.inf if found is None else log_likelihood(found) + found.first_states

    if not count or not np.isfinite(first := told(1.0)):
        return 0.0, 1.0
    best, suits = first, 1.0
    for step in (FACTOR, 1.0 / FACTOR):
        factor = step
        while TIGHTEST < factor < LOOSEST and (now := told(factor)) > best:
            best, suits, factor = now, factor, factor * step
        if best > first:
            break
    return best - first, suits
