"""What the recordings leave open, in words: parameters and start values that can move together without any effect."""

from __future__ import annotations

import numpy as np

from backsight.ocp import Solution

from ..problem import Problem
from ..wording import listed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NAMED = 6  # unknowns of a direction, and directions, that are told one by one, the largest first
NOTHING = 1e-4  # of the largest entry of a direction, each in its own size: less is rounding


def open_combinations(problem: Problem, solution: Solution) -> list[str]:
    """A sentence for every direction in which the unknowns can move unseen."""
    if solution.curvature is None or not len(solution.curvature.null):
        return []
    dae, t = problem.dae, solution.transcription
    starts = [(f"{q.name} at the start of {r.title}", q.unit, q.nominal) for r in problem.fitted for q in dae.states]
    if len(problem.fitted) == 1:
        starts = [(f"{q.name} at the start", q.unit, q.nominal) for q in dae.states]
    values = solution.solved.decisions[t.nlp.trajectory_size :]
    free = [(dae.parameters[i], abs(float(v))) for i, v in zip(problem.free, values, strict=True)]
    unknowns = starts + [(info.name, info.unit, max(value, abs(info.nominal))) for info, value in free]
    size = np.array([abs(s) or 1.0 for _, _, s in unknowns])
    said = []
    for direction in _few_at_a_time(solution.curvature.null / size) * size:
        scaled = np.abs(direction / size)
        moving = [int(k) for k in np.argsort(-scaled) if scaled[k] > NOTHING * scaled.max()]
        if len(moving) > NAMED + 1:
            moving.sort(key=lambda k: k < len(starts))  # of many, parameters are named before starts
        names = [unknowns[k][0] for k in moving]
        if len(moving) == 1:
            said.append(f"The recordings do not determine {names[0]}.")
            continue
        steps = [f"{names[j]} by {_quantity(direction[k] / direction[moving[0]], unknowns[k][1])}" for j, k in enumerate(moving)]
        more = len(moving) - NAMED
        if more > 1:
            names, steps = ([*few[:NAMED], f"{more} more"] for few in (names, steps))
        said.append(f"The recordings do not tell {listed(names)} apart: moving {listed(steps)} changes nothing that was measured.")
    if len(said) > NAMED + 1:
        said = [*said[:NAMED], f"The recordings leave {len(said) - NAMED} more combinations open."]
    if problem.free:
        said[-1] += " Fix one, give it a std, or use a richer recording; all other deviations are right."
    return said


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
