"""A start from the data alone: trajectories through the samples, parameters that balance them, and how much is left over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.ocp import Transcription
from backsight.ocp.columnwise import Columnwise
from backsight.ocp.follow import Followed
from backsight.ocp.passing import passing_through

from ..problem import Problem

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Balance:
    """parameters (np_all,) that balance the followed trajectories best;

    force_std: place -> std density left over [unit of the place * sqrt(s)].
    """

    parameters: Array
    force_std: dict[int, float]


def balance(problem: Problem, followed: Followed, parameters: Array) -> Balance:
    """Least squares of the balances' residuals in the free parameters along the followed trajectories.

    One step where the model is linear in them, which most are; a step that does not pay is not taken. The differentiated samples carry
    noise, so this is a start and no estimate.
    """
    dae, free = problem.dae, list(problem.free)
    rows = [r for r, e in enumerate(dae.equations) if e.place is not None]
    residual = dae.residual[rows]
    now = np.hstack(_probe(dae, followed, parameters, residual))
    if free and now.size:
        slope = np.hstack(_probe(dae, followed, parameters, ca.vec(ca.jacobian(residual, dae.p)[:, free])))
        J = slope.reshape(len(free), len(rows), -1).transpose(1, 2, 0).reshape(-1, len(free))
        size = np.sqrt(np.mean(now**2, axis=1)) + 1e-300
        scaled = J / np.repeat(size, now.shape[1])[:, None]
        unit = np.sqrt(np.mean(scaled**2, axis=0))
        usable = unit > 0
        step = np.zeros(len(free))
        step[usable] = np.linalg.lstsq(scaled[:, usable] / unit[usable], -(now / size[:, None]).ravel(), rcond=1e-6)[0] / unit[usable]
        trial = parameters.copy()
        trial[free] = [_inside(problem, i, parameters[i] + s) for i, s in zip(free, step, strict=True)]
        then = np.hstack(_probe(dae, followed, trial, residual))
        if np.sum((then / size[:, None]) ** 2) < np.sum((now / size[:, None]) ** 2):
            parameters, now = trial, then
    places = [dae.equations[r].place for r in rows]
    steps = np.concatenate([h.mesh.steps for h in followed.horizons])
    left = np.sqrt(np.mean(now**2 * steps, axis=1)) if now.size else np.ones(len(rows))
    return Balance(
        parameters=parameters, force_std={int(k): max(float(s), 1e-12) for k, s in zip(places, left, strict=True) if k is not None}
    )


def start_decisions(transcription: Transcription, followed: Followed, parameters: Array) -> Array:
    """The followed trajectories as decisions of a transcription on the same or another mesh, residual forces zero; (n + np,)."""
    trajectories = passing_through(transcription, lambda number, times: followed.at(number, times)[1:])
    return np.concatenate([trajectories, parameters[list(transcription.nlp.free)]])


def _inside(problem: Problem, index: int, value: float) -> float:
    low, high = problem.parameter_range(index)
    margin = 1e-3 * abs(problem.values[index]) + 1e-9
    return float(np.clip(value, low + (margin if np.isfinite(low) else 0.0), high - (margin if np.isfinite(high) else 0.0)))


def _probe(dae: Dae, followed: Followed, parameters: Array, expression: Any) -> list[Array]:
    """`expression` of the model along every horizon's followed trajectory, at the middles of the mesh; each (rows, N)."""
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t]
    probe = Columnwise(ca.Function("probe", arguments, [ca.densify(expression)]), (4, 5))
    out = []
    for number, horizon in enumerate(followed.horizons):
        times = horizon.mesh.knots[:-1] + horizon.mesh.steps / 2
        dx, x, z = followed.at(number, times)
        u = horizon.projected_input(1, np.array([0.5]))
        out += probe(dx, x, z, u, parameters, np.zeros(dae.w.shape[0]), horizon.clock + times[None, :])
    return out
