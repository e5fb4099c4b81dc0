"""What bounds leave of the integral over the parameters, and how that changes with the weights.

Parameters B lie on their bounds, and H has them held there. For b of them, the others in B held, sigma_b is its deviation without its bound
and t_b = -inward dJ/dp_b sigma_b how many of these inside of the bound the summit would lie, less than 0. For a parameter that is free t_b
is that too, from the bound that is nearest. The integral over all is a whole bell over those that are free, times

    free   Phi(t_b),                  on its bound   sigma_b exp(t_b^2 / 2) Phi(t_b)

but for a constant: exact for one parameter and one bound, and for several that the data pull far beyond theirs. With w_b how all unknowns
move with b, per sigma_b, rows f of a weight change

    d log sigma_b/dtheta_f  =  |J_f w_b|^2,         dt_b/dtheta_f  =  2 inward w_b'J_f'r_f  -+  t_b |J_f w_b|^2     (- free, + on its bound)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr
from scipy.stats import norm

from backsight.ocp.marginal import Marginal

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = NDArray[np.bool_]

FAR = 4.0  # deviations inside of a bound, from which on it takes nothing
STEP = 1e-2  # of a deviation, for derivatives of rows


@dataclass(frozen=True)
class Edges:
    """The parameters (b,) of a solution whose bounds count.

    t and std: t_b and sigma_b; inward: +1 from a lower bound, -1 from an upper one; on: which lie on theirs; ways (k, b): how all that can
    move do with each, per sigma_b.
    """

    there: Marginal
    t: Array
    std: Array
    inward: Array
    on: Mask
    ways: Array

    @property
    def value(self) -> float:
        """The logarithm of these factors."""
        return float(np.sum(log_ndtr(self.t) + np.where(self.on, np.log(self.std) + self.t**2 / 2, 0.0)))

    def slope(self, rows: Sequence[Sequence[tuple[int, Mask]]], pulls: Array) -> Array:
        """Its derivatives (F,); rows of every weight and how they pull, (n + np, F)."""
        if not len(self.t):
            return np.zeros(len(rows))
        s, t = self.there.solution, self.t
        w = np.column_stack([self.there.moved(way) - s.solved.decisions for way in self.ways.T])
        along = [_along(self.there, column) for column in w.T]
        lift = np.array([[_squares(J_w, of) for J_w in along] for of in rows]).reshape(len(rows), len(t))
        change = 2.0 * self.inward * ((pulls / s.values.unit[:, None]).T @ w) + np.where(self.on, t, -t) * lift
        bend = np.exp(norm.logpdf(t) - log_ndtr(t)) + np.where(self.on, t, 0.0)
        return np.asarray(change @ bend + lift @ self.on, dtype=np.float64)


def edges(there: Marginal, bounds: tuple[Array, Array], bent: bool) -> Edges:
    """Of a solution with all its parameters on bounds among those that can move.

    bounds: of the np free parameters, as decisions. bent: whether the summit is that of the marginal likelihood.
    """
    s, covariance, on = there.solution, there.covariance, np.isin(there.moving, there.solution.parameters_on_bounds)
    precision = np.linalg.inv(covariance[np.ix_(on, on)])
    follow = covariance[:, on] @ precision  # how all move with each that is on its bound, the others on theirs
    held = covariance - follow @ covariance[on]
    variance = np.diag(held).copy()  # nothing but rounding of those that are on their bounds
    variance[on] = 1.0 / np.diag(precision)
    std = np.sqrt(variance)
    ways = held / np.where(on, 1.0, std)
    ways[:, on] = follow * std[on]
    p = s.solved.decisions[s.transcription.nlp.trajectory_size :][there.moving]
    below, above = (p - bounds[0][there.moving]) / std, (bounds[1][there.moving] - p) / std
    t, inward = np.minimum(below, above), np.where(below < above, 1.0, -1.0)
    if on.any():
        t[on] = (inward * (there.slope if bent else -there.pull) * std)[on]
    near = np.flatnonzero(on | (t < FAR))
    return Edges(there, t[near], std[near], inward[near], on[near], ways[:, near])


def _along(there: Marginal, w: Array) -> list[Array]:
    """J w of every term, (K m, C)."""
    s = there.solution
    evaluated, X = s.transcription.nlp.evaluated, s.values.scaled(s.solved.decisions)
    ahead, behind = (evaluated.rows(X + sign * STEP * w / s.values.unit, s.values) for sign in (1.0, -1.0))
    return [(a - b) / (2.0 * STEP) for a, b in zip(ahead, behind, strict=True)]


def _squares(change: Sequence[Array], rows: Sequence[tuple[int, Mask]]) -> float:
    return sum(float(np.sum(change[k][of] ** 2)) for k, of in rows)
