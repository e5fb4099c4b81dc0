"""Parameters that ended on a bound: how far inside of it they may as well lie, and what that adds to the deviations of all others.

With B the parameters on bounds, A the others, Sigma the covariance of all with no bounds and g the slope of the log likelihood inward
of one of B, its distance delta >= 0 from its bound, the others of B on theirs, is distributed as

    N(sigma^2 g, sigma^2) cut off at zero,        sigma^2 = 1 / (Sigma_BB^-1)_ii

and all else moves with it, by K delta with K = Sigma_AB Sigma_BB^-1 (its columns signed inward):

    E (p_A - p_A^)^2  =  Sigma_AA - K Sigma_BA  +  K diag(E delta^2) K'
    E delta^2  =  sigma^2 (1 + a^2 - a phi(a)/Phi(-a)),        a = -sigma g

(Johnson, Kotz & Balakrishnan, Continuous Univariate Distributions 1, section 13.10). Where the data pull far beyond a bound that adds
nothing to the deviations of a fit in which the bounds are right. Where they hardly care, whatever moves with it is as open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, truncnorm

from backsight.ocp import Solution
from backsight.ocp.curvature import Curvature

from ..problem import Problem
from .marginal import at

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

FAR = 30.0  # deviations beyond a bound from which on E delta^2 is that of an exponential distribution, 2 sigma^2 / a^2


@dataclass(frozen=True, kw_only=True)
class OnBounds:
    """Of the np free parameters those that are on a bound, `places` (b,).

    beyond (b,): by how many of its own deviations the data pull each beyond its bound; negative where they pull it inward, NaN where they
    do not tell it at all. reach (b,): how far inside it is with a chance of 5 %, inf where they do not tell it.
    parameter_covariance (np, np): of all, as above, zero of those on a bound; parameter_variance (np,): its diagonal, inf of what the data
    do not determine. whole: the curvature with no bounds.
    """

    places: NDArray[np.int64]
    beyond: Array
    reach: Array
    parameter_covariance: Array
    parameter_variance: Array
    whole: Curvature


def on_bounds(problem: Problem, solution: Solution, marginal: bool) -> OnBounds | None:
    """What the parameters on bounds leave open; None where there are none, or where without them the solution is no minimum.

    problem: the posed one. marginal: whether the likelihood is that with the trajectories integrated out.
    """
    inward = _inward(problem, solution)
    places, there = np.flatnonzero(inward), at(solution)
    if not len(places) or there.whole is None:
        return None
    count = len(inward)
    told = np.isfinite(there.whole.parameter_variance)
    slope = np.zeros(count)
    if there.minimum:
        slope[there.moving] = there.slope if marginal else -there.pull
    B, A = places[told[places]], np.flatnonzero((inward == 0) & told)
    whole, towards = there.whole.parameter_covariance, inward[B]
    precision = np.linalg.inv(whole[np.ix_(B, B)])
    K = whole[np.ix_(A, B)] @ precision
    sigma = 1.0 / np.sqrt(np.diag(precision))
    a = -sigma * slope[B] * towards
    covariance = np.zeros((count, count))
    covariance[np.ix_(A, A)] = whole[np.ix_(A, A)] - K @ whole[np.ix_(B, A)] + (K * (sigma**2 * _second_moment(a))) @ K.T
    beyond, reach = np.full(count, np.nan), np.full(count, np.inf)
    beyond[B], reach[B] = a, sigma * (truncnorm.isf(0.05, a, np.inf) - a)
    return OnBounds(
        places=places,
        beyond=beyond[places],
        reach=reach[places],
        parameter_covariance=covariance,
        parameter_variance=np.where(told, np.diag(covariance), np.inf),
        whole=there.whole,
    )


def _inward(problem: Problem, solution: Solution) -> Array:
    """(np,): +1 for a parameter on its lower bound, -1 on its upper one, 0 for the others."""
    t, out = solution.transcription, np.zeros(len(problem.free))
    for k in solution.solved.on_bound:
        if k >= t.nlp.trajectory_size:
            number = k - t.nlp.trajectory_size
            low, high = problem.parameter_range(problem.free[number])
            value = float(solution.solved.decisions[k])
            out[number] = 1.0 if value - low < high - value else -1.0
    return out


def _second_moment(a: Array) -> Array:
    """Of a normal distribution of mean -a and deviation one, cut off at zero."""
    near = np.minimum(a, FAR)
    ratio = np.exp(norm.logpdf(near) - norm.logsf(near))
    return np.where(a > FAR, 2.0 / np.maximum(a, FAR) ** 2, 1.0 + near**2 - near * ratio)
