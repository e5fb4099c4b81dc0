"""Evidence of models whose residual forces are held at a share of the forces at their places.

The share is that of the base model, and the forces are those of each model itself. With the same deviations in newtons a model would pay
for parameters that are smaller than the base model's, wrong as that may be: a tenth of the inertia turns the same torques into ten times
the accelerations, which samples then have to be told from.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from backsight.ocp import Solution

from ..problem import Problem
from ..smoothing.along import forces
from ..smoothing.begun import followed_by, force_stds
from ..validation.innovations import innovations, log_likelihood


def shares(problem: Problem, solution: Solution) -> dict[str, float]:
    """Place -> deviation of its residual force over the rms of the forces there."""
    sizes = _forces(problem, solution)
    return {name: std / sizes[name] for name, std in force_stds(solution).items() if name in sizes}


def gained(problem: Problem, solution: Solution, held: Mapping[str, float]) -> float:
    """Nats of log evidence with residual forces of these shares, over that with the deviations which they have."""
    sizes, stds = _forces(problem, solution), force_stds(solution)
    t = solution.transcription
    names = [t.dae.places[k].name for k in t.soft]
    factors = np.array([held[n] * sizes[n] / stds[n] if n in held and n in sizes else 1.0 for n in names])
    before, after = innovations(solution), innovations(solution, factors)
    return 0.0 if before is None or after is None else log_likelihood(after) - log_likelihood(before)


def _forces(problem: Problem, solution: Solution) -> dict[str, float]:
    found = forces(problem.posed, followed_by(solution), solution.parameters, varying=True)
    return {problem.posed.dae.places[k].name: size for k, size in found.items()}
