"""Units for the unknowns and the constraints of a program, from its own curvature at the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .ipopt import Solver
from .nlp import Values
from .polynomials import Array

UNSEEN = 1e6  # times its size: a parameter that may move as far at a cost of one is not seen by the cost


def scaled(solver: Solver, decisions: Array, values: Values) -> Values:
    """The same program in better units.

    The unit of a decision is its deviation when all others are known, 1/sqrt(H_ii) with the Gauss-Newton H; what the cost does not see
    gets the size of its start. All copies of a variable have the median unit, but for the first ones, which may be known
    far better: theirs is no larger than their own deviation. A constraint is divided by the largest entry of its row of the Jacobian in
    these units.
    """
    values = replace(values, unit=_units(solver, decisions, values))
    if not solver.nlp.constraint_count:
        return values
    J = abs(solver.jacobian(decisions, values)).max(axis=1).toarray().ravel()
    scales, start = list(values.scale), 0
    for k, term in enumerate(solver.nlp.terms):
        if term.equality:
            size = J[start : start + term.target.size].reshape(term.target.shape, order="F")
            start += term.target.size
            typical = np.median(size, axis=1, keepdims=True)
            scales[k] = scales[k] / np.where(typical > 0, typical, 1.0)
    return replace(values, scale=tuple(scales))


def _units(solver: Solver, decisions: Array, values: Values) -> Array:
    nlp = solver.nlp
    diagonal = solver.weights(decisions, replace(values, unit=np.ones_like(values.unit)))  # whatever units there were
    n, local = nlp.trajectory_size, nlp.interpolation.local
    unit = np.zeros(nlp.size)
    # the last knot of a horizon is seen as the right end of an interval only; any other place is overwritten by its left end
    for column in [*range(local - nlp.interpolation.states, local), *range(local - nlp.interpolation.states)]:
        same = nlp.index[column if column < local - nlp.interpolation.states else column - local + nlp.interpolation.states]
        seen = diagonal[same] > 0
        size = float(np.sqrt(np.mean(decisions[same] ** 2)))
        deviation = float(np.median(diagonal[same][seen] ** -0.5)) if seen.any() else np.inf
        unit[nlp.index[column]] = min(deviation, size or 1.0)
    first = np.setdiff1d(nlp.index[: nlp.interpolation.states], nlp.index[local - nlp.interpolation.states :])
    first = first[diagonal[first] > 0]
    unit[first] = np.minimum(unit[first], diagonal[first] ** -0.5)
    for k in range(n, nlp.size):
        size = abs(decisions[k]) or 1.0
        # a parameter of constraints alone is seen by rounding at most
        unit[k] = diagonal[k] ** -0.5 if diagonal[k] * (UNSEEN * size) ** 2 > 1.0 else size
    return unit
