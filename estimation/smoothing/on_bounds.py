"""Parameters that ended on a bound: how far inside of it they may as well lie, and what that adds to the deviations of all others.

With B the parameters on bounds, A the others, Sigma the covariance of all without these bounds, g the slope of the log likelihood where
they lie, and delta >= 0 how far inside of their bounds B are (signed inward, at most the width w of their ranges),

    delta ~ N(Sigma_BB g_B, Sigma_BB) cut off to 0 <= delta <= w,        M = E delta delta'
    E (p_A - p_A^)(p_A - p_A^)'  =  Sigma_AA - K Sigma_BA  +  K M K',    K = Sigma_AB Sigma_BB^-1

The first two terms are the covariance of a fit in which the bounds are right. Where the data pull far beyond them M is next to nothing;
where they hardly care, whatever moves with a parameter on its bound is as open. Moments of the cut-off distribution by importance sampling,
one component after the other given those before (Geweke, Hajivassiliou & Keane; see Train, Discrete Choice Methods with Simulation,
section 5.6.3), of quasi-random numbers, the same at every call.

Combinations that nothing tells (null directions): where bounds on both sides of one leave it no way, its parameters stay on theirs.
Else whatever it moves is not told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc, truncnorm

from backsight.ocp import Solution
from backsight.ocp.curvature import Curvature
from backsight.ocp.marginal import Marginal

from .marginal import at

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

DRAWS = 12  # log2 of their number
CHANCE = 0.05  # of what lies farther inside than `reach`
NOTHING = 1e-4  # of the largest entry of a null direction, in the program's units: less is rounding


@dataclass(frozen=True, kw_only=True)
class OnBounds:
    """Of the np free parameters those that are on a bound, `places` (b,).

    beyond (b,): by how many deviations the data pull each beyond its bound, the others on theirs; negative where they pull it inward, NaN
    where they do not tell it. reach (b,): how far inside it is with a chance of 5 %, inf where they do not tell it.
    parameter_covariance (np, np): of all, as above, zero of those on a bound; parameter_variance (np,): its diagonal, inf of what the data
    do not determine. without: the curvature without these bounds; null: its null directions, none where bounds leave them no way.
    inward (np,): +1 for a parameter on its lower bound, -1 on its upper one, 0 for the others. follow (np, b): how far all move with each,
    per unit that it moves inward, the others on their bounds.
    """

    places: NDArray[np.int64]
    beyond: Array
    reach: Array
    parameter_covariance: Array
    parameter_variance: Array
    without: Curvature
    null: Array
    inward: Array
    follow: Array


def on_bounds(solution: Solution, lower: Array, upper: Array, marginal: bool) -> OnBounds | None:
    """What the parameters on bounds leave open; None where there are none, or where without them the solution is no minimum.

    lower, upper (np,): their bounds. marginal: whether the likelihood is that with the trajectories integrated out.
    """
    if not len(solution.parameters_on_bounds):
        return None
    there = at(solution)
    if there.whole is None or not there.minimum:
        return None
    try:
        return _told(there, there.whole, lower, upper, marginal)
    except (np.linalg.LinAlgError, FloatingPointError):  # told apart by no more than rounding, or as far out as no number is
        return None


def _told(there: Marginal, without: Curvature, lower: Array, upper: Array, marginal: bool) -> OnBounds:
    solution, places = there.solution, there.solution.parameters_on_bounds
    p = solution.solved.decisions[solution.transcription.nlp.trajectory_size :]
    inward = np.zeros(len(p))
    inward[places] = np.where(p[places] - lower[places] < upper[places] - p[places], 1.0, -1.0)
    blocked = _blocked(without, inward, solution.values.unit[solution.transcription.nlp.trajectory_size :])
    if blocked:
        told, whole = np.isin(np.arange(len(p)), there.moving), np.zeros((len(p), len(p)))
        whole[np.ix_(there.moving, there.moving)] = there.covariance
        open_ones = np.zeros(len(p), dtype=bool)
    else:
        told, whole = np.isfinite(without.parameter_variance), without.parameter_covariance
        open_ones = ~told
    slope = np.zeros(len(p))
    slope[there.moving] = there.slope if marginal else -there.pull
    B, A = places[told[places]], np.flatnonzero((inward == 0) & told)
    towards = inward[B]
    sigma = whole[np.ix_(B, B)] * np.outer(towards, towards)
    precision = np.linalg.inv(sigma)
    K = whole[np.ix_(A, B)] * towards @ precision
    M, reach = _cut_off(sigma @ (slope[B] * towards), sigma, (upper - lower)[B])
    covariance = np.zeros((len(p), len(p)))
    covariance[np.ix_(A, A)] = whole[np.ix_(A, A)] - K @ sigma @ K.T + K @ M @ K.T
    beyond, far = np.full(len(p), np.nan), np.where(open_ones, np.inf, 0.0)
    follow = np.zeros((len(p), len(p)))
    follow[np.ix_(A, B)] = K
    beyond[B] = -slope[B] * towards / np.sqrt(np.diag(precision))
    far[B] = reach
    return OnBounds(
        places=places,
        beyond=beyond[places],
        reach=far[places],
        parameter_covariance=covariance,
        parameter_variance=np.where(open_ones, np.inf, np.diag(covariance)),
        without=without,
        null=without.null[:0] if blocked else without.null,
        inward=inward,
        follow=follow[:, places],
    )


def _blocked(whole: Curvature, inward: Array, unit: Array) -> bool:
    """Whether every null direction leads out of some bound, forth and back; so too where there are none."""
    if not len(whole.null):
        return True
    null = whole.null[:, -len(inward) :] / unit * inward
    null = np.where(np.abs(null) > NOTHING * np.abs(null).max(axis=1, keepdims=True), null, 0.0)
    return bool(np.all(np.any(null > 0, axis=1) & np.any(null < 0, axis=1)))


def _cut_off(mean: Array, covariance: Array, width: Array) -> tuple[Array, Array]:
    """E delta delta' (b, b) of N(mean, covariance) within 0 and width, and what each exceeds with a chance of 5 %, (b,).

    Raises FloatingPointError where no number is as large.
    """
    b = len(mean)
    if not b:
        return np.empty((0, 0)), np.empty(0)
    L = np.linalg.cholesky(covariance)
    u = qmc.Sobol(b, rng=0).random_base2(DRAWS)
    delta, z, weight = np.empty(u.shape), np.zeros(u.shape), np.zeros(len(u))
    for i in range(b):
        centre, std = mean[i] + z[:, :i] @ L[i, :i], L[i, i]
        low, high = -centre / std, (width[i] - centre) / std
        z[:, i] = np.clip(truncnorm.ppf(u[:, i], low, high), low, high)
        delta[:, i] = centre + std * z[:, i]
        weight += _log_mass(low, high)
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    order = np.argsort(delta, axis=0)
    tails = np.cumsum(weight[order], axis=0)
    reach = [delta[order[np.searchsorted(tails[:, i], 1.0 - CHANCE), i], i] for i in range(b)]
    with np.errstate(over="raise"):
        return (delta * weight[:, None]).T @ delta, np.array(reach)


def _log_mass(low: Array, high: Array) -> Array:
    """log of the chance that a standard normal variable is within low and high."""
    # the density at zero over that of the cut-off one there, for low and high of any size
    near = np.clip(0.0, low, high)
    return np.asarray(-0.5 * near**2 - 0.5 * np.log(2 * np.pi) - truncnorm.logpdf(near, low, high), dtype=np.float64)
