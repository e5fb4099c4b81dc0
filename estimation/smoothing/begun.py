"""Where a smoothing goes on from: the solution of the same problem, or of one whose model has other parts.

What both models have by the same name goes on as it was, and so does what the new one has at the same flange; a state or an algebraic
variable of which the old model knows nothing begins at its start value, and the first step of a solve leads it to where it belongs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.ocp import ParameterPrior, Solution, transcribe
from backsight.ocp.follow import Followed
from backsight.ocp.passing import passing_through

from ..problem import Free, Problem
from .along import along
from .horizons import beginning
from .rest import strengths_at_rest

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Begun:
    """Trajectories of a problem, and place -> std of its residual force, away from rest; its parameters.

    strange: they come from another model. at_rest: place -> strength of the laws that its residual force has room for near rest. noise:
    output -> std in force, of every horizon: of two models the one that holds the other is not to come to rest at weights by which it is
    less likely than that. onward: guesses were left behind: all parameters that it has go on, not only those that a std holds.
    """

    followed: Followed
    force_std: dict[str, float]
    parameters: dict[str, float]
    strange: bool = False
    at_rest: dict[str, float] = field(default_factory=dict)
    noise: tuple[dict[str, float], ...] = ()
    onward: bool = False

    @classmethod
    def at(cls, solution: Solution) -> Begun:
        """A solution of the same problem."""
        return cls(
            followed=followed_by(solution),
            force_std=force_stds(solution),
            parameters=_parameters(solution),
            at_rest=strengths_at_rest(solution),
            noise=_noise(solution),
        )

    @classmethod
    def going_on(cls, solution: Solution, problem: Problem, anew: Collection[str], later: float = 0.0) -> Begun | None:
        """A solution for the same problem with its samples at other times; None where its recordings fall into other pieces then.

        anew: parameters that begin at their guesses. later: by how much more samples of all outputs were moved back [s].
        """
        begun = cls.at(solution)
        if len(begun.followed.horizons) != len(problem.fitted):
            return None
        return replace(
            begun,
            followed=_sooner(begun.followed, later) if later else begun.followed,
            parameters={name: value for name, value in begun.parameters.items() if name not in anew},
            onward=True,
        )

    def with_noise(self, stds: list[dict[str, float]], free: Sequence[Collection[str]]) -> list[dict[str, float]]:
        """Standard deviations of outputs, of every horizon, with those in force here where nobody gave them."""
        if len(self.noise) != len(stds):
            return stds
        pairs = zip(stds, free, self.noise, strict=True)
        return [{name: own.get(name, std) if name in those else std for name, std in table.items()} for table, those, own in pairs]

    @classmethod
    def of(cls, solution: Solution, problem: Problem) -> Begun | None:
        """A solution for a problem with the same recordings; None where it is none, or the problem has other inputs or outputs."""
        if not solution.solved.status.converged:
            return None
        old, new = solution.transcription.dae, problem.posed.dae
        same = [q.name for q in (*old.states, *old.algebraics)] == [q.name for q in (*new.states, *new.algebraics)]
        return cls.at(solution) if same else cls.carried(solution, problem)

    @classmethod
    def carried(cls, solution: Solution, problem: Problem) -> Begun | None:
        """A solution of a problem with another model; None where the two have not the same inputs and outputs."""
        t, dae = solution.transcription, problem.posed.dae
        old = t.dae
        if [q.name for q in (*old.inputs, *old.outputs)] != [q.name for q in (*dae.inputs, *dae.outputs)]:
            return None
        followed = followed_by(solution)
        unknown = [*zip(ca.vertsplit(dae.x), dae.states, strict=True), *zip(ca.vertsplit(dae.z), dae.algebraics, strict=True)]
        sources = [_source(old, [q.name, *_same(dae, symbol)], q.start) for symbol, q in unknown]
        horizons = tuple(beginning(h, dae, problem.known_at(piece)) for h, piece in zip(t.horizons, problem.fitted, strict=True))

        def curve(number: int, times: Array) -> tuple[Array, Array]:
            rows = [source(followed, number, times, solution.parameters) for source in sources]
            x, z = np.split(np.array(rows, dtype=np.float64).reshape(-1, len(times)), [len(dae.states)])
            return x, z

        nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
        program = transcribe(dae, horizons, free=(), prior=nothing, force_std={}, method=t.method, degree=t.degree)
        going = Followed(transcription=program, horizons=horizons, decisions=passing_through(program, curve))
        return replace(cls.at(solution), followed=going, strange=True)

    def start(self, problem: Problem) -> Array:
        """Where parameters start (np_all,): at their guesses, but those that go on, or that a std holds about them, where they were."""
        found, given = problem.values.copy(), problem.parameters
        for i in problem.free:
            name = problem.dae.parameters[i].name
            free = given[name]
            if isinstance(free, Free) and (self.onward or free.std is not None) and name in self.parameters:
                found[i] = np.clip(self.parameters[name], *problem.parameter_range(i))
        return found


Source = Callable[[Followed, int, Array, Array], Array]


def _same(dae: Dae, symbol: Any) -> list[str]:
    """Names of a model's variables that are one of its unknowns and no other: of flanges, say, where a body's position is the unknown."""
    return [name for name, expression in dae.variables.items() if ca.is_equal(expression, symbol)]


def _source(old: Dae, names: Sequence[str], start: float) -> Source:
    """What is a variable in the old model by any of its names: a function of (followed, number, times, parameters) -> (M,)."""
    states = [q.name for q in old.states]
    for name in names:
        if name in states:
            return partial(_state, states.index(name))
        if name in old.variables:
            return partial(_variable, old, old.variables[name])
    return partial(_constant, start)


def _state(row: int, followed: Followed, number: int, times: Array, _: Array) -> Array:
    return np.asarray(followed.at(number, times)[1][row])


def _variable(old: Dae, expression: Any, followed: Followed, number: int, times: Array, parameters: Array) -> Array:
    return np.asarray(along(old, expression, followed, number, times, parameters)).ravel()


def _constant(value: float, _: Followed, __: int, times: Array, ___: Array) -> Array:
    return np.full(len(times), value)


def _sooner(followed: Followed, by: float) -> Followed:
    """The trajectories as they are `by` [s] later, and at their ends what they are there."""

    def curve(number: int, times: Array) -> tuple[Array, Array]:
        last = followed.transcription.horizons[number].mesh.knots[[0, -1]]
        return followed.at(number, np.clip(times + by, *last))[1:]

    return replace(followed, decisions=passing_through(followed.transcription, curve), covariance=None)


def _parameters(solution: Solution) -> dict[str, float]:
    return dict(zip((p.name for p in solution.transcription.dae.parameters), solution.parameters.tolist(), strict=True))


def _noise(solution: Solution) -> tuple[dict[str, float], ...]:
    """Output -> std of its samples in a solution, of every horizon."""
    t, scale = solution.transcription, solution.values.scale[solution.term("samples")]
    found, first = list[dict[str, float]](), 0
    for horizon in t.horizons:
        part, first = scale[:, first : first + len(horizon.time)], first + len(horizon.time)
        found.append({q.name: float(1.0 / np.median(row[row > 0])) for q, row in zip(t.dae.outputs, part, strict=True) if np.any(row > 0)})
    return tuple(found)


def followed_by(solution: Solution) -> Followed:
    """The trajectories of a solution."""
    t, local = solution.transcription, slice(solution.transcription.nlp.interpolation.local)
    covariance = None if solution.curvature is None else solution.interval_covariance[:, local, local]
    return Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions, covariance=covariance)


def in_the_middles(solution: Solution, expression: Any) -> Array:
    """An expression of the model in the middles of all intervals of a solution, (rows, N)."""
    t, followed = solution.transcription, followed_by(solution)
    middles = [(h.mesh.knots[1:] + h.mesh.knots[:-1]) / 2 for h in t.horizons]
    return np.hstack([along(t.dae, expression, followed, number, at, solution.parameters) for number, at in enumerate(middles)])


def force_stds(solution: Solution) -> dict[str, float]:
    """Place -> std of its residual force in a solution, away from rest."""
    t = solution.transcription
    std = t.force_std_at(solution.values).min(axis=1, initial=np.inf)
    return dict(zip((t.dae.places[k].name for k in t.soft), std.tolist(), strict=True))
