"""The rule of magnitudes: every square of the cost of order one at a sample if nothing were known, W_ii z_i^2 ~ 1 and V_cc m_c^2 ~ 1.

    std of V = rms of the reading,     std of W = rms of the largest force at the place * sqrt(sampling interval)

(of a coloured force, whose std is its own rms, without the root).

A start where nothing else is known, and nothing more: it says how large the quantities are, and not how wrong.
"""

from __future__ import annotations

import numpy as np

from backsight.ocp import Solution
from backsight.ocp.follow import Followed

from ..problem import Problem
from ..smoothing.along import forces
from .turned import Turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def sizes(problem: Problem, solution: Solution) -> dict[str, float]:
    """Place -> rms of the largest term of its balance [unit], wherever positions have their zero."""
    t, posed = solution.transcription, problem.posed
    followed = Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions)
    return {posed.dae.places[k].name: size for k, size in forces(posed, followed, solution.parameters, borne=True).items()}


def magnitudes(turned: Turned, problem: Problem, force: dict[str, float]) -> Array:
    """theta (F,) of the rule; a weight of which no magnitude is known stays as it is."""
    fitted, found = problem.fitted, np.zeros(len(turned.weights))
    step = float(np.median(np.concatenate([np.diff(r.time) for r in fitted])))
    for f, weight in enumerate(turned.weights):
        if weight.kind == "V":
            y = np.concatenate([(r.inputs if weight.measured_input else r.outputs).get(weight.name, np.empty(0)) for r in fitted])
            size = float(np.sqrt(np.nanmean(y**2)))
        elif weight.kind == "W":
            size = force.get(weight.name, np.nan) * (1.0 if weight.row in turned.coloured else step**0.5)
        else:
            size = np.nan
        if np.isfinite(size) and size > 0:
            found[f] = np.log(size / weight.std)
    return found
