"""A start for the posed problem from that of the plain one: what was supposed beyond the model is at rest, its parameters constant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from backsight.ocp.follow import Followed

from ..problem import Problem

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Lifted(Followed):
    """Followed trajectories of a plain model with those of further states and algebraic variables below.

    states: the further states' constant values; inputs: for every further algebraic variable the input that it goes with.
    """

    states: Array = field(default_factory=lambda: np.empty(0))
    inputs: tuple[int, ...] = ()

    def at(self, number: int, times: Array) -> tuple[Array, Array, Array]:
        """x' and x (nx, M) and z (nz, M) of horizon `number` at any times."""
        dx, x, z = super().at(number, times)
        constant = np.repeat(self.states[:, None], len(times), axis=1)
        u = self.horizons[number].input_at(times)[list(self.inputs)]
        return np.vstack([dx, 0 * constant]), np.vstack([x, constant]), np.vstack([z, u])


def lifted(problem: Problem, plain: Problem, followed: Followed, parameters: Array) -> Followed:
    """The plain problem's trajectories for the posed one; parameters (np_all,): where what drifts starts, within its bounds.

    Residual forces are zero, an input acts as recorded.
    """
    if problem is plain:
        return followed
    values = {info.name: float(p) for info, p in zip(plain.dae.parameters, parameters, strict=True)}
    names = [q.name for q in plain.dae.inputs]
    more = problem.dae.states[len(plain.dae.states) :]
    start = [float(np.clip(values.get(q.name, 0.0), *problem.bounds.get(q.name, (-np.inf, np.inf)))) for q in more]
    return Lifted(
        transcription=followed.transcription,
        horizons=followed.horizons,
        decisions=followed.decisions,
        mean_square=followed.mean_square,
        states=np.array(start),
        inputs=tuple(names.index(q.name) for q in problem.dae.algebraics[len(plain.dae.algebraics) :]),
    )


def measured_by(problem: Problem, parameters: Array, start: Array) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Parameters (np_all,) with those that drift where they start: what a drifting inertia is measured by (`Pieces.balances`)."""
    drifting = {q.name for q in problem.dae.states}
    values = [b if info.name in drifting else a for a, b, info in zip(parameters, start, problem.dae.parameters, strict=True)]
    return np.array(values, dtype=np.float64)
