"""The last steps of a smoothing: parameters of most marginal likelihood, and the most probable trajectories at these (`ocp/marginal.py`).

Near rest a law's rounded sign is steep and its creep no physics, so that those intervals say nothing of the determinants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.optimize import lsq_linear

from backsight.ocp import ParameterPrior, Solution, Solver
from backsight.ocp.marginal import Marginal

from .program import Program
from .rest import near_rest
from .robust import RobustSolution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

WORTH = 0.1  # of a deviation: a step that no one would notice
NEAR = 0.3  # of a deviation: what may be left of the way where steps do not settle
BOLDEST = 1.0  # deviation: the longest step
EDGE = 1e-3  # of a deviation from a bound: that is on it
STEPS, STALE = 16, 4  # at most, and those in a row that lead no nearer
TOLD = 0.5  # of a deviation: a distance from the most probable parameters together with a trajectory that is worth a word
TILTED = 0.01  # of a deviation: a slope at the answer that tells it from these
WIDE = 30.0  # deviations of a prior that bends next to nothing
NEIGHBOURS = 2  # intervals beside those near rest between which determinants pass what they say to and fro


@dataclass(frozen=True, kw_only=True)
class Moved:
    """A solution at the parameters of most marginal likelihood, or as near as steps led, and a sentence about it where one is due.

    far: deviations that the parameter which moved farthest is from where the steps began. arrived: whether the parameters are those.
    """

    solution: Solution
    said: tuple[str, ...] = ()
    far: float = 0.0
    arrived: bool = False


def marginal(program: Program, solution: Solution, say: Callable[[str], None]) -> Moved:
    """A solution of a program moved to the parameters of most marginal likelihood; as it is where that is no step or leads nowhere.

    Roots of the slope in the parameters, by Broyden's quasi-Newton steps within the bounds: in whitened parameters u, with Sigma = L L',
    F = L' slope has a derivative near -1, but for terms that refer to the parameters (`ocp/pieces.py`) and for bent laws.
    """
    t = solution.transcription
    if not (t.soft and t.nlp.free and solution.solved.status.converged):  # without forces there is one trajectory, and no determinant
        return Moved(solution=solution)
    try:
        return _Way(program, solution, say).gone()
    except np.linalg.LinAlgError:
        return Moved(solution=solution, said=(UNMOVED,))


UNMOVED = (
    "The parameters are those most probable together with a trajectory: steps to those of most marginal likelihood led nowhere. What damps "
    "lightly may be too small where residual forces are large."
)


class _Way:
    """The steps from a solution."""

    def __init__(self, program: Program, solution: Solution, say: Callable[[str], None]) -> None:
        self._program, self._first, self._say = program, solution, say

    def gone(self) -> Moved:
        first = at(self._first)
        if not first.minimum:
            return Moved(solution=self._first)
        L, std, moving = np.linalg.cholesky(first.covariance), first.std, first.moving
        W, B, here, F = np.linalg.inv(L), np.eye(len(std)), first, L.T @ first.slope
        best, nearest, stale = here, np.inf, 0
        for _ in range(STEPS):
            step = self._step(here.solution, moving, B @ W, F, std)
            length = float(np.max(np.abs(step) / std))
            if not np.isfinite(length):
                break
            best, nearest, stale = (here, length, 0) if length < nearest else (best, nearest, stale + 1)
            if length < WORTH or stale >= STALE:
                break
            self._say(f"parameters of most marginal likelihood: {length:.2g} deviations away")
            step *= min(1.0, BOLDEST / length)
            found = self._solved(here, step)
            there = at(found, first.still) if found.solved.status.converged else None
            if there is None or not there.minimum or not np.array_equal(there.moving, moving):
                break
            s, before = W @ step, F
            here, F = there, L.T @ there.slope
            B += np.outer(before - F - B @ s, s) / (s @ s)
        return self._answer(best, nearest, std, moving)

    def _answer(self, best: Marginal, left: float, std: Array, moving: NDArray[np.int64]) -> Moved:
        if best.solution is self._first:
            return Moved(solution=self._first, said=() if left < WORTH else (UNMOVED,), arrived=left < WORTH)
        if left > NEAR:
            return Moved(solution=self._first, said=(UNMOVED,))
        t = self._first.transcription
        places = t.nlp.trajectory_size + moving
        far = (best.solution.solved.decisions - self._first.solved.decisions)[places] / std
        k = int(np.argmax(np.abs(far)))
        name = t.dae.parameters[t.nlp.free[int(moving[k])]].name
        distance = f"{name} is {far[k]:+.2g} deviations from its most probable value together with a trajectory"
        said = (f"Parameters are those of most marginal likelihood: {distance}.",) if abs(far[k]) > TOLD else ()
        return Moved(solution=best.solution, said=said, far=abs(float(far[k])), arrived=True)

    def _step(self, solution: Solution, moving: NDArray[np.int64], A: Array, F: Array, std: Array) -> Array:
        """argmin |A step - F| within the bounds."""
        places = solution.transcription.nlp.trajectory_size + moving
        here, step = solution.solved.decisions[places], np.zeros(len(std))
        least = np.minimum(self._program.lower[places] - here, 0.0) / std
        most = np.maximum(self._program.upper[places] - here, 0.0) / std
        room = most > least
        if room.any() and np.all(np.isfinite(F)):
            step[room] = lsq_linear((A * std)[:, room], F, (least[room], most[room]), method="bvls").x
        return np.asarray(step * std, dtype=np.float64)

    def _solved(self, here: Marginal, step: Array) -> Solution:
        """The best trajectories a step further."""
        before, program = here.solution, self._program
        decisions = np.clip(here.moved(step), program.lower, program.upper)
        held = replace(program.resumed(before), start=decisions).held
        found = held.solve(decisions, held.values, True, self._say)
        if isinstance(found, RobustSolution) and isinstance(before, RobustSolution):
            found = found.with_gain(before.gain)  # its own is that of known parameters
        places = before.transcription.nlp.trajectory_size + here.moving
        p, room = decisions[places], EDGE * here.std
        edge = (p - program.lower[places] < room) | (program.upper[places] - p < room)
        rest = np.setdiff1d(before.solved.on_bound, places)
        found = released(found, [*rest.tolist(), *places[edge].tolist()])
        return replace(found, solved=replace(found.solved, iterations=before.solved.iterations + found.solved.iterations))


def released(solution: Solution, on_bound: Iterable[int]) -> Solution:
    """A solution with its parameters held as one in which they are free: of them only these decisions are held, by their bounds."""
    n, solved = solution.transcription.nlp.trajectory_size, solution.solved
    own = (*(k for k in solved.on_bound if k < n), *(k for k in on_bound if k >= n))
    return replace(solution, solved=replace(solved, on_bound=own))


def at(solution: Solution, rather: NDArray[np.int64] | None = None) -> Marginal:
    """What the marginal likelihood says at a solution, its rests left out. rather: parameters that are held where any would do."""
    values = solution.ungained if isinstance(solution, RobustSolution) else solution.values
    return Marginal(solution=solution, values=values, apart=intervals_apart(solution), rather=rather)


def tilted(solution: Solution) -> Solution:
    """The solution in a program with a further cost, linear in the parameters, that makes `marginal`'s answer the one of least cost.

    The slope of the determinants at the answer, as priors so wide that they bend next to nothing.
    """
    there, t = at(solution), solution.transcription
    if not there.minimum:
        return solution
    places, wide = t.nlp.trajectory_size + there.moving, WIDE * there.std
    edge = np.isin(places, solution.solved.on_bound)
    if not np.any(np.abs(there.pull * there.std)[~edge] > TILTED):
        return solution
    slope = np.where(edge, there.determinants, there.pull)
    mean, std = np.zeros(len(t.nlp.free)), np.full(len(t.nlp.free), np.inf)
    mean[there.moving], std[there.moving] = solution.solved.decisions[places] + wide**2 * slope, wide
    t, values = t.with_prior(solution.values, ParameterPrior(mean=mean, std=std))
    return Solution(transcription=t, solver=Solver(t.nlp, solution.solver.options), values=values, solved=solution.solved)


def slope_of_determinants(solution: Solution) -> Array | None:
    """Of the marginal likelihood in the free parameters, without the cost's, (np,); 0 in what cannot move, None without a minimum."""
    there = at(solution)
    if not there.minimum:
        return None
    out = np.zeros(len(solution.transcription.nlp.free))
    out[there.moving] = there.determinants
    return out


def intervals_apart(solution: Solution) -> NDArray[np.bool_]:
    """Intervals (N,) near rest and beside it."""
    near = near_rest(solution.transcription.force_std_at(solution.values))
    apart = np.any(near, axis=0, keepdims=True)
    return np.asarray(binary_dilation(apart, np.ones((1, 2 * NEIGHBOURS + 1), dtype=np.bool_))[0], dtype=np.bool_)
