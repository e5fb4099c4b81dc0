"""The last steps of a smoothing: parameters of most marginal likelihood, and the most probable trajectories at these (`ocp/marginal.py`).

Near rest a law's rounded sign is steep and its creep no physics, so that those intervals say nothing of the determinants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from backsight.ocp import ParameterPrior, Solution, Solver
from backsight.ocp.marginal import Marginal

from .program import Program
from .rest import near_rest

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

WORTH = 0.05  # of a deviation: a step that no one would notice
BOLDEST = 1.0  # deviation: the longest step
STEPS = 12
TILTED = 0.01  # of a deviation: a slope at the answer that tells it from one of most probability together with a trajectory
WIDE = 1e3  # deviations of a prior that bends next to nothing
NEIGHBOURS = 2  # intervals beside those near rest between which determinants pass what they say to and fro


def marginal(program: Program, solution: Solution, say: Callable[[str], None]) -> Solution:
    """A solution of a program moved to the parameters of most marginal likelihood; as it is where that is no step or leads nowhere."""
    if not (solution.transcription.nlp.free and solution.solved.status.converged):
        return solution
    found = solution
    for _ in range(STEPS):
        there = Marginal(found, intervals_apart(found))
        if not there.determined:
            return solution
        step = there.step(program.lower, program.upper)
        length = float(np.max(np.abs(step) / there.std))
        if not np.isfinite(length):
            return solution
        if length < WORTH:
            return found
        say(f"parameters of most marginal likelihood: {length:.2g} deviations away")
        found = _at(program, found, there.moved(step * min(1.0, BOLDEST / length)), say)
        if not found.solved.status.converged:
            return solution
    return solution


def tilted(solution: Solution) -> Solution:
    """The solution in a program with a further cost, linear in the parameters, that makes `marginal`'s answer the one of least cost.

    The slope of the determinants at the answer, as priors so wide that they bend next to nothing.
    """
    there, t = Marginal(solution, intervals_apart(solution)), solution.transcription
    if not there.determined:
        return solution
    n, pull, wide = t.nlp.trajectory_size, there.pull, WIDE * there.std
    on_bound = np.isin(n + np.arange(len(wide)), solution.solved.on_bound)
    if not np.any(np.abs(there.covariance @ pull / there.std)[~on_bound] > TILTED):
        return solution
    slope = np.where(on_bound, there.determinants, pull)
    t, values = t.with_prior(solution.values, ParameterPrior(mean=solution.solved.decisions[n:] + wide**2 * slope, std=wide))
    return Solution(transcription=t, solver=Solver(t.nlp, solution.solver.options), values=values, solved=solution.solved)


def slope_of_determinants(solution: Solution) -> Array | None:
    """What the marginal likelihood's slope in the free parameters (np,) has beside the cost's; None where there is no minimum."""
    there = Marginal(solution, intervals_apart(solution))
    return there.determinants if there.determined else None


def _at(program: Program, solution: Solution, decisions: Array, say: Callable[[str], None]) -> Solution:
    """The best trajectories at the parameters of these decisions."""
    n, decisions = solution.transcription.nlp.trajectory_size, np.clip(decisions, program.lower, program.upper)
    held = replace(program.resumed(solution), start=decisions).held
    found = held.solve(decisions, held.values, True, say)
    edge = np.flatnonzero((decisions == program.lower) | (decisions == program.upper))
    on_bound = (*(k for k in found.solved.on_bound if k < n), *edge[edge >= n].tolist())
    iterations = solution.solved.iterations + found.solved.iterations
    return replace(found, solved=replace(found.solved, on_bound=on_bound, iterations=iterations))


def intervals_apart(solution: Solution) -> NDArray[np.bool_]:
    """Intervals (N,) near rest and beside it."""
    near = near_rest(solution.transcription.force_std_at(solution.values))
    return np.asarray(
        binary_dilation(np.any(near, axis=0, keepdims=True), np.ones((1, 2 * NEIGHBOURS + 1), dtype=np.bool_))[0], dtype=np.bool_
    )
