"""Variance components: the weights that make what was measured most probable, how well the data tell them, and which may as well be zero.

    theta  <-  theta + AI^-1 dl/dtheta,           std of theta^ = sqrt(diag AI^-1)          (`likelihood.py`)

Whether a residual force is there at all is a question at the edge of what a variance can be: with the others at their best beside it,

    LR = 2 (l(theta^) - l(theta_f -> -inf)),      p = 1/2 P(chi^2_1 > LR)  for LR > 0, else 1

because under the null half of all estimates are zero (Self & Liang, J. Amer. Statist. Assoc. 82, 1987; Stram & Lee, Biometrics 50, 1994).
A force counts as gone when its rows are left less than GONE degrees of freedom, so that the data could not tell a smaller one from it.
How large one may be that the data would do without, the likelihood tells that is greatest over all others,

    2 (l(theta^) - l(limit))  =  1.96^2.

What is known at theta^ itself would not: near none its logarithm tells nothing, and of the variance too little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import optimize, stats

from backsight.ocp import Solution

from .likelihood import Likelihood, likelihood, summit
from .turned import Turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

ROUNDS = 20
GAIN = 0.005  # of the log likelihood: what another step may promise at the end
LONGEST = 1.5  # step up in a theta
SMALLEST = 0.05  # of a variance: what a step leaves at least
LOWEST = (SMALLEST - 1.0) / 2.0  # such a step, as it begins in theta
RIDGE = 1e-3  # of AI's diagonal, where a weight's rows tell nothing
ZERO = 0.05  # p from which on a residual force may as well be none
GONE = 0.3  # degrees of freedom, see above
LOWER, STEPS_DOWN = float(np.log(5.0)), 8  # steps down to there
EDGE, NEAR_EDGE = 1.959964, 0.1  # root of LR at the ends of 95 %, and how near to it is near enough
SEEN, LEAST_SEEN, FIRST_STEP = 1.0, 1e-6, 0.35  # degrees of freedom where the way up begins, that none has less of, and a step in theta
STEPS_UP, WIDEST, ROUGH_GAIN = 12, 4.0, 0.05  # steps up, the longest one on the variance, and what may be left to gain on the way
DOUBTLESS, NEARLY = 30.0, 0.1  # LR from which on a force is there: p = 2e-8; of what it is beyond that, nats the others may still gain


@dataclass(frozen=True, kw_only=True)
class Component:
    """One weight from the data: its std [unit], that of its logarithm (NaN where the data do not tell), and p that it is zero.

    p_zero: None where nobody asks: a sensor has noise. NaN where a solve did not arrive. limit: of a force that may be none, its std at
    most, at 95 % [unit]; NaN where it was not found.
    """

    std: float
    log_std: float
    unit: str
    p_zero: float | None = None
    limit: float = float("nan")

    @property
    def may_be_none(self) -> bool:
        """Whether the data would do without it; not so where nobody knows."""
        return self.p_zero is not None and self.p_zero > ZERO

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of its std: on the logarithmic scale, or from none to the limit where there may be none."""
        if self.may_be_none:
            return 0.0, self.limit
        spread = float(np.exp(EDGE * self.log_std))
        return self.std / spread, self.std * spread


@dataclass(frozen=True, kw_only=True)
class Found:
    """Weights of the greatest likelihood, theta (F,), which of them were sought, (F,) bool, and whether the steps came to an end."""

    theta: Array
    moving: Mask
    likelihood: Likelihood
    settled: bool

    @property
    def solution(self) -> Solution:
        """The solution there."""
        return self.likelihood.solution

    @property
    def arrived(self) -> bool:
        """Whether the search is at an end, at a solution that is one."""
        return self.settled and self.solution.solved.status.converged and bool(np.isfinite(self.likelihood.value))

    @cached_property
    def covariance(self) -> Array:
        """Of the theta that were sought, the others as they are, (F, F); NaN where the data do not tell."""
        information, freedom = self.likelihood.information, self.likelihood.freedom
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        told = np.flatnonzero((size > 0) & self.moving)
        out = np.full(information.shape, np.nan)
        while len(told):
            there = information[np.ix_(told, told)] / np.outer(size[told], size[told])
            values, vectors = np.linalg.eigh((there + there.T) / 2)
            if np.all(values > 0):
                out[np.ix_(told, told)] = (vectors / values) @ vectors.T / np.outer(size[told], size[told])
                break
            least = told[np.argmin(freedom[told])]
            if freedom[least] >= GONE:
                break
            told = told[told != least]  # of what has gone rounding is left
        return out

    @property
    def std(self) -> Array:
        """Of theta, (F,); NaN where the data do not tell."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)


def maximise(
    turned: Turned,
    theta: Array,
    moving: Mask,
    here: Likelihood | None = None,
    say: Callable[[str], None] | None = None,
    gain: float = GAIN,
) -> Found:
    """The greatest likelihood over the weights `moving` (F,) bool, from theta (F,), of which `here` is the likelihood if it is known."""
    here, settled, again = here or _at(turned, theta, None), False, False
    if not moving.any() or not np.isfinite(here.value):  # nothing to seek, or no minimum to begin at
        return Found(theta=theta, moving=moving, likelihood=here, settled=not moving.any())
    for rounds in range(1, ROUNDS + 1):
        step, promise = _step(turned, here, moving)
        if say is not None:
            say(f"weights from the likelihood, round {rounds}: log likelihood {here.value:.2f}, {promise:.2g} to be gained")
        if promise < gain:
            settled = True
            break
        further, there = _uphill(turned, theta, step, here, gain)
        if _no_worse(there, here, gain):
            theta, here, again = further, there, False
        elif not again and there.solution.solved.status.converged:
            # a solve that stopped early is worth more than its minimum: where a trajectory went on from it, this one goes there too
            here, again = _at(turned, theta, there.solution), True
        else:
            settled = promise < ROUGH_GAIN  # less than what solves at their tolerance tell
            break
    return Found(theta=theta, moving=moving, likelihood=here, settled=settled)


def _uphill(turned: Turned, theta: Array, step: Array, here: Likelihood, gain: float) -> tuple[Array, Likelihood]:
    """As much of a step as is no worse, and the likelihood there; else the least that was tried."""
    length = 1.0
    while True:
        further = theta + _along(step, length)
        there = _at(turned, further, here.solution)
        length /= 3.0
        if length < 0.1 or _no_worse(there, here, gain):
            return further, there


def _no_worse(there: Likelihood, here: Likelihood, gain: float) -> bool:
    return bool(np.isfinite(there.value) and there.value > here.value - min(gain, ROUGH_GAIN))


def without(turned: Turned, best: Found, f: int) -> float:
    """p that weight f is zero, NaN where a search did not arrive: without its greatest value under the null a ratio says too much.

    Below its greatest value a likelihood of one variance falls: where it has fallen beyond doubt, the p of that is the most it can be, and
    the rest of the way is not gone; nor are the others brought to their best there any nearer than it takes to say so.
    """
    if not best.arrived:
        return float("nan")
    theta, here = best.theta, best.likelihood
    alone = np.arange(len(theta)) == f
    for _ in range(STEPS_DOWN):
        if here.freedom[f] < GONE:
            break
        theta = theta - LOWER * alone
        here = _at(turned, theta, here.solution)
        if not here.solution.solved.status.converged:
            continue
        for _ in range(ROUNDS):
            beyond = _ratio(best, here) - DOUBTLESS
            if not beyond > 0:
                break
            gone = maximise(turned, theta, best.moving & ~alone, here, gain=max(GAIN, NEARLY * beyond))
            if gone.likelihood is here:  # nothing is left to gain that would take it back
                if gone.arrived:
                    return _chance(DOUBTLESS)
                break
            theta, here = gone.theta, gone.likelihood
    null = best if here is best.likelihood else maximise(turned, theta, best.moving & ~alone, here)
    return _chance(_ratio(best, null.likelihood)) if null.arrived else float("nan")


def _chance(ratio: float) -> float:
    return 0.5 * float(stats.chi2.sf(ratio, 1)) if ratio > 0 else 1.0


def doubted(turned: Turned, best: Found, f: int) -> tuple[float, float]:
    """p that weight f is zero, and its std at most where it may be; NaN where a search did not arrive, or nobody asks."""
    p = without(turned, best, f)
    return p, at_most(turned, best, f) if p > ZERO else float("nan")


def at_most(turned: Turned, best: Found, f: int) -> float:
    """The std of weight f above its best at which twice the log likelihood, greatest over the others, has fallen by 1.96^2; else NaN.

    From where the data would see a force at all it is sought upwards, each time from where the others were; the root of what l has fallen
    by grows as the variance does.
    """
    alone, freedom = np.arange(len(best.theta)) == f, float(best.likelihood.freedom[f])
    up = 0.5 * float(np.log(SEEN / max(freedom, LEAST_SEEN)))
    theta, here = best.theta + max(up, FIRST_STEP) * alone, best.likelihood
    below, above = (0.0, 0.0), (np.inf, np.inf)
    for _ in range(STEPS_UP):
        found = maximise(turned, theta, best.moving & ~alone, _at(turned, theta, here.solution), gain=ROUGH_GAIN)
        if not found.arrived:
            break
        here, theta, variance = found.likelihood, found.theta, float(np.exp(2.0 * (found.theta[f] - best.theta[f])))
        root = float(np.sqrt(max(_ratio(best, here), 0.0)))
        if abs(root - EDGE) < NEAR_EDGE:
            return turned.stds(theta)[turned.weights[f].label]
        below, above = ((variance, root), above) if root < EDGE else (below, (variance, root))
        if np.isfinite(above[0]):
            aim = below[0] + (above[0] - below[0]) * (EDGE - below[1]) / (above[1] - below[1])
        else:
            aim = variance * min(EDGE / max(root, EDGE / WIDEST), WIDEST)
        theta = theta + 0.5 * float(np.log(aim / variance)) * alone
    return float("nan")


def _ratio(best: Found, here: Likelihood) -> float:
    """LR against the best."""
    return 2.0 * (best.likelihood.value - here.value)


def _at(turned: Turned, theta: Array, near: Solution | None) -> Likelihood:
    """The likelihood at theta; near: a solution with other weights to begin at.

    Parameters of most marginal likelihood are sought from where they were with these, and by way of the most probable ones where that leads
    nowhere.
    """
    if turned.bent and near is not None and (moved := summit(turned, turned.along(theta, near))).arrived:
        return likelihood(turned, theta, moved.solution)
    solution = turned.solved(theta, None if near is None else near.solved.decisions)
    return likelihood(turned, theta, summit(turned, solution).solution if turned.bent else solution)


def _along(step: Array, length: float) -> Array:
    """A part of a step in theta, (F,), as one in the variances exp(2 theta) that begins alike.

    Of a sensor and a force that it sees at once the data tell the sum of the variances: a ridge that is straight in these.
    """
    return 0.5 * np.log1p(2.0 * length * step)


def _step(turned: Turned, here: Likelihood, moving: Mask) -> tuple[Array, float]:
    """The best step over the moving weights, AI^-1 slope within bounds, and what it promises of the log likelihood.

    What goes to nothing would go further than there: it leaves SMALLEST of its variance, and the others step as is best beside that.
    """
    # a force that the data cannot tell from none may be ever smaller, and nothing is gained but rounding
    moving = moving & (turned.noise | np.greater_equal(here.freedom, GONE) | np.greater(here.slope, 0.0))
    out, I, slope = np.zeros(len(moving)), here.information[np.ix_(moving, moving)], here.slope[moving]
    if moving.any():
        size = np.sqrt(np.maximum(np.diag(I), 2.0 * np.maximum(here.freedom[moving], 0.0) + 1e-12))
        values, vectors = np.linalg.eigh(I / np.outer(size, size) + RIDGE * np.eye(len(size)))
        root = np.sqrt(np.maximum(values, RIDGE))  # the quadratic as squares: |root V' s - V' slope / root|^2
        best = optimize.lsq_linear(
            root[:, None] * vectors.T, vectors.T @ (slope / size) / root, (LOWEST * size, LONGEST * size), method="bvls"
        )
        out[moving] = best.x / size
    return out, float(out @ here.slope - out @ here.information @ out / 2)
