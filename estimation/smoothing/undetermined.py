"""What the recordings leave open, in words: parameters and start values that can move together without any effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backsight.ocp import Solution
from backsight.ocp.curvature import Curvature

from ..problem import Problem
from ..results import DETERMINED
from ..wording import listed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Unknown = tuple[str, str, float]  # name, unit, size

NAMED = 6  # unknowns of a direction, and directions, that are told one by one, the largest first
PART = 0.1  # of the largest entry of a principal axis, each in its own size: less hardly takes part
REMEDY = "Fix one, give it a std, or use a richer recording"
NOTHING = 1e-4  # of the largest entry of a direction, each in its own size: less is rounding


def open_combinations(problem: Problem, solution: Solution, curvature: Curvature) -> list[str]:
    """A sentence for every direction in which the unknowns can move unseen."""
    if not len(curvature.null):
        return []
    dae = problem.dae
    starts = [(f"{q.name} at the start of {r.title}", q.unit, q.nominal) for r in problem.fitted for q in dae.states]
    if len(problem.fitted) == 1:
        starts = [(f"{q.name} at the start", q.unit, q.nominal) for q in dae.states]
    unknowns = starts + _parameters(problem, solution)
    size = np.array([abs(s) or 1.0 for _, _, s in unknowns])
    said = []
    for direction in _few_at_a_time(curvature.null / size) * size:
        scaled = np.abs(direction / size)
        moving = [int(k) for k in np.argsort(-scaled) if scaled[k] > NOTHING * scaled.max()]
        if len(moving) > NAMED + 1:
            moving.sort(key=lambda k: k < len(starts))  # of many, parameters are named before starts
        if len(moving) == 1:
            said.append(f"The recordings do not determine {unknowns[moving[0]][0]}.")
            continue
        names, steps = _steps(unknowns, direction / direction[moving[0]], moving)
        said.append(f"The recordings do not tell {names} apart: moving {steps} changes nothing that was measured.")
    if len(said) > NAMED + 1:
        said = [*said[:NAMED], f"The recordings leave {len(said) - NAMED} more combinations open."]
    if problem.free:
        said[-1] += f" {REMEDY}; all other deviations are right."
    return said


def hardly_told(problem: Problem, solution: Solution, curvature: Curvature) -> list[str]:
    """A sentence for every combination of parameters that is determined, but no better than up to a half of what they are.

    Along principal axes of the parameters' covariance, each in units of its size, or of its deviation where that is larger: what lies at
    zero has no size.
    """
    told = np.isfinite(curvature.parameter_variance)
    if not told.any():
        return []
    unknowns = [unknown for unknown, known in zip(_parameters(problem, solution), told, strict=True) if known]
    size = np.array([abs(s) or 1.0 for _, _, s in unknowns])
    covariance = curvature.parameter_covariance[np.ix_(told, told)]
    unit = np.maximum(size, np.sqrt(np.diag(covariance)))
    variance, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    far = variance > DETERMINED**2
    said = []
    for direction in _few_at_a_time(axes.T[far]) if far.any() else ():
        moving = [int(k) for k in np.argsort(-np.abs(direction)) if abs(direction[k]) > PART * np.abs(direction).max()]
        if len(moving) > 1:
            step = direction * unit * np.sign(direction[moving[0]])
            names, steps = _steps(unknowns, step * DETERMINED * np.min(size[moving] / np.abs(step[moving])), moving)
            said.append(f"The recordings hardly tell {names} apart: moving {steps} changes next to nothing that was measured.")
    return [*said[:-1], f"{said[-1]} {REMEDY}."] if said else []


def _parameters(problem: Problem, solution: Solution) -> list[Unknown]:
    """The free ones: name, unit, size."""
    values = solution.solved.decisions[solution.transcription.nlp.trajectory_size :]
    free = [(problem.dae.parameters[i], abs(float(v))) for i, v in zip(problem.free, values, strict=True)]
    return [(info.name, info.unit, max(value, abs(info.nominal))) for info, value in free]


def _steps(unknowns: Sequence[Unknown], direction: Array, moving: Sequence[int]) -> tuple[str, str]:
    """Which ones move, and each by how much."""
    names = [unknowns[k][0] for k in moving]
    steps = [f"{unknowns[k][0]} by {_quantity(direction[k], unknowns[k][1])}" for k in moving]
    more = len(moving) - NAMED
    if more > 1:
        names, steps = ([*few[:NAMED], f"{more} more"] for few in (names, steps))
    return listed(names), listed(steps)


def _few_at_a_time(directions: Array) -> Array:
    """The same span with as few entries in each row as elimination finds, parameters (last) first; rows (r, m)."""
    rows = directions / np.abs(directions).max(axis=1, keepdims=True)
    for k in range(len(rows)):
        left = np.abs(rows[k:])
        i, j = np.unravel_index(int(np.argmax(left[:, ::-1])), left.shape)
        j = rows.shape[1] - 1 - j
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, j], rows[k])
    return np.asarray(np.where(np.abs(rows) > NOTHING * np.abs(rows).max(axis=1, keepdims=True), rows, 0.0))


def _quantity(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip() if unit != "1" else f"{value:.3g}"
