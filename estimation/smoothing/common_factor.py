"""A factor common to the guesses of what forces are proportional to: masses in grams, torques in N mm, a machine of another size.

A balance in which all masses, stiffnesses and dampings are a thousand times too large does not feel the input: what it leaves over is a
small share of its forces, and no step of Gauss and Newton leads back. Where all of what moves is seen, balances are linear in them and one
step is enough. Where some of it is driven by the rest (`driven.py`) a balance is asked what it leaves over of the forces that are known,

    R(p) = rms F(p) / rms F(0),        F(0): inputs, weights, all that no unknown parameter multiplies

which is 1 where the parameters explain nothing and grows with all that is too large.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from backsight.ocp.columnwise import Columnwise
from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import Array

from ..problem import Free, Problem
from .along import rms
from .driven import Driven

DECADES = (-4, -3, -2, 2, 3, 4)  # by which guesses may be off together; a fit finds its way from one
PLAINLY = 0.4  # by how much log R has to be less, or guesses stay
EXPLAINS, SENSELESS = -0.3, 2.3  # log R of parameters that explain something; of such that are far too large, so that less is better


@dataclass(frozen=True)
class KnownForces:
    """What balances of what is seen leave over of the forces that are known, with the unseen driven along the followed trajectories.

    rows: of the unseen, state -> row of the residual. unknown: indices of parameters; those that are free but no more than guessed.
    """

    problem: Problem
    rows: Mapping[int, int]
    followed: Followed
    unknown: tuple[int, ...]

    @cached_property
    def proportional(self) -> dict[int, Free]:
        """The unknown parameters that the residual is jointly linear in, by their index."""
        dae, found = self.problem.dae, dict[int, Free]()
        for i in self.unknown:
            given = self.problem.parameters[dae.parameters[i].name]
            if isinstance(given, Free):
                found[i] = given
        p = ca.vertcat(*(dae.p[i] for i in found))
        bent = ca.jacobian(ca.vec(ca.jacobian(dae.residual, p)), p)
        return {i: free for k, (i, free) in enumerate(found.items()) if not bent[:, k].nnz()}

    def left(self, parameters: Array) -> float:
        """Mean of log R over the balances with known forces; NaN where there is none, inf where the unseen has no finite motion."""
        whole, known = (rms(F) for F in self._at(parameters))
        told = known > 0
        if not told.any():
            return np.nan
        return float(np.mean(np.log(whole[told] / known[told]))) if np.all(np.isfinite(whole)) else np.inf

    def factor(self, parameters: Array) -> float:
        """By how much to multiply: the power of ten with which R is least, 1 where that explains hardly more.

        What moves unseen moves otherwise with every one of them, so how far off they are is not told by one look.
        """
        if not self.proportional:
            return 1.0
        now, left = self.left(parameters), {d: self.left(self._multiplied(parameters, 10.0**d)) for d in DECADES}
        told = {decades: log_R for decades, log_R in left.items() if np.isfinite(log_R)}
        if not told or np.isnan(now):
            return 1.0
        best = min(told, key=lambda decades: (told[decades], abs(decades)))
        better = now - told[best] > PLAINLY and (told[best] < EXPLAINS or now > SENSELESS)
        return 10.0**best if better else 1.0

    def multiplied(self, parameters: Array, factor: float) -> tuple[Problem, Array]:
        """The problem with other guesses, and the parameters (np_all,), within their bounds."""
        problem, given = self.problem, dict(self.problem.parameters)
        for i, free in self.proportional.items():
            low, high = problem.parameter_range(i)
            given[problem.dae.parameters[i].name] = replace(free, guess=float(np.clip(free.guess * factor, low, high)))
        return replace(problem, model=problem.dae, parameters=given), self._multiplied(parameters, factor)

    def _multiplied(self, parameters: Array, factor: float) -> Array:
        values = parameters.copy()
        for i in self.proportional:
            values[i] = np.clip(parameters[i] * factor, *self.problem.parameter_range(i))
        return values

    def _at(self, parameters: Array) -> tuple[Array, Array]:
        """F(p) and F(0) between all samples of all recordings, (balances, M)."""
        driven, parts = self._driven, []
        for number in range(len(self.followed.horizons)):
            run = driven.run(self.followed, number, parameters)
            along = driven.filled(driven.along(self.followed, number, run.times), run.state, run.rate)
            parts.append(self._function(*along, parameters))
        whole, known = (np.concatenate(a, axis=1) for a in zip(*parts, strict=True))
        return whole, known

    @cached_property
    def _driven(self) -> Driven:
        return Driven(self.problem.dae, dict(self.rows))

    @cached_property
    def _function(self) -> Columnwise:
        dae, unseen = self.problem.dae, set(self.rows.values())
        seen = [row for row, e in enumerate(dae.equations) if e.place is not None and row not in unseen]
        F = dae.undisturbed(dae.residual[seen])
        p = ca.vertcat(*(dae.p[i] for i in self.proportional))
        answers = [F, ca.substitute(F, p, ca.SX.zeros(p.shape))]
        arguments = [dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p]
        return Columnwise(ca.Function("known_forces", arguments, [ca.densify(a) for a in answers]), (5,))
