"""Gross outliers in the samples: Huber's loss by iteratively reweighted least squares.

With z_k = (y_k - h)/std the cost of a sample is rho(z) = z^2/2 up to |z| = k and k |z| - k^2/2 beyond, whose slope psi(z) = w(z) z has

    w(z) = min(1, k/|z|),        k = 1.345: 95 % efficient on Gaussian noise (Huber, Robust Statistics, 1981, chapters 4 and 7)

Each round solves the least-squares program with the scale of every sample multiplied by sqrt(w) of the round before. What is left of the
gradient, delta_k = (w_new - w) z_k, moves every linear combination of the unknowns by at most |delta| of its own deviation, because
J (J'J + ...)^-1 J' <= 1: that is the test of convergence.

Deviations. The M-estimate's covariance is E psi^2/(E psi')^2 times that of least squares (Huber, section 7.6). The inverse KKT matrix has
the information sum w_k J_k'J_k in it instead; multiplied by

    c = m_1^2 / (m_2 mean w),        m_1 of psi', m_2 of psi^2

it has the right amount, and where an outlier stands it still counts for nothing. A residual of a fit that follows its samples is smaller
than their noise: of variance 1 - l with the leverage l. So m_1 and m_2 are those of Gaussian noise times the ratio of what is seen to
what N(0, 1 - l) would give. The scale of an output whose noise nobody gave follows from the same ratio of psi^2 being one (Huber's
proposal 2), so that outliers hardly enter it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from backsight.ocp import Solution, Status
from backsight.ocp.nlp import Values

from ..problem import Problem
from ..recordings.noise import robust_std

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = NDArray[np.bool_]

CORNER = 1.345  # k
ROUNDS = 40
SETTLED = 0.02  # of a deviation: what another round may still move
LEAST_VARIANCE = 1e-4  # of a residual over its noise, however closely the fit follows a sample
FAR = 4.0  # deviations: where the tails are looked at
CHANCE = 1e-3  # that Gaussian noise has so many samples beyond FAR


def weight(z: Array) -> Array:
    """w(z) of Huber's loss, for standardised residuals of any shape."""
    return np.asarray(CORNER / np.maximum(np.abs(z), CORNER), dtype=np.float64)


def log_density(z: Array) -> Array:
    """log f(z), f = exp(-rho)/Z the density of which Huber's loss is the negative log likelihood.

    Z = sqrt(2 pi) (2 Phi(k) - 1) + 2/k exp(-k^2/2)        (Huber, section 4.5, the least favourable of all contaminated Gaussians)
    """
    Z = np.sqrt(2.0 * np.pi) * (2.0 * stats.norm.cdf(CORNER) - 1.0) + 2.0 / CORNER * np.exp(-0.5 * CORNER**2)
    far = np.abs(z)
    return np.asarray(-np.where(far > CORNER, CORNER * far - 0.5 * CORNER**2, 0.5 * z**2) - np.log(Z), dtype=np.float64)


def expected_square(variance: Array) -> Array:
    """E psi(e)^2 for Gaussian e of this variance."""
    s = np.sqrt(variance)
    a = CORNER / s
    inside = variance * (2.0 * stats.norm.cdf(a) - 1.0 - 2.0 * a * stats.norm.pdf(a))
    return np.asarray(inside + 2.0 * CORNER**2 * stats.norm.sf(a), dtype=np.float64)


def expected_slope(variance: Array) -> Array:
    """E psi'(e) for Gaussian e of this variance: the share within the corners."""
    return np.asarray(2.0 * stats.norm.cdf(CORNER / np.sqrt(variance)) - 1.0, dtype=np.float64)


def heavy_tailed(e: Array) -> bool:
    """Whether standardised residuals e (n,) have heavier tails than Gaussian ones.

    Their scale is one, or where the deviations in force are too small their own, median |e| / 0.6745; under a Gaussian the number beyond
    FAR of it is at most binomial, and a number whose chance is below CHANCE is too many. So is a single one so far away that with this
    chance none of all would be.
    """
    if not e.size:
        return False
    far = np.abs(e) / max(1.0, robust_std(e))
    many = stats.binom.sf(np.count_nonzero(far > FAR) - 1, e.size, 2.0 * stats.norm.sf(FAR))
    farthest = 2.0 * e.size * stats.norm.sf(float(far.max()))
    return bool(min(many, farthest) < CHANCE)


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Which samples (ny, all samples) have Huber's loss, and for which of them the residuals are to tell whether they need it."""

    huber: Mask
    auto: Mask

    @classmethod
    def of(cls, problem: Problem) -> Losses | None:
        """As the recordings say; None where all are squares."""

        def asked(words: tuple[str, ...]) -> Mask:
            parts = [
                np.array([np.full(len(r.time), r.output_loss.get(q.name, "square") in words) for q in problem.dae.outputs])
                for r in problem.fitted
            ]
            return np.hstack(parts).astype(bool)

        found = cls(huber=asked(("huber", "auto")), auto=asked(("auto",)))
        return found if found.huber.any() else None


@dataclass(frozen=True, kw_only=True)
class RobustSolution(Solution):
    """A solution whose samples' scales hold the weights: scale = sqrt(gain w)/std.

    weights, gain, huber (ny, all samples): w and c, one where the loss is the square, and where it is Huber's.
    settled: whether another round would move nothing.
    """

    weights: Array
    gain: Array
    huber: Mask
    settled: bool

    @property
    def standardised(self) -> Array:
        """z (ny, all samples); zero where a sample is missing."""
        return np.asarray(self.rows[self.term("samples")] / np.sqrt(self.weights * self.gain), dtype=np.float64)

    @property
    def remaining(self) -> Array:
        """1 - l: variance of z, were all well (ny, all samples)."""
        number = self.term("samples")
        return np.asarray(np.clip(1.0 - self.leverage(number) * self.values.scale[number] ** 2, LEAST_VARIANCE, 1.0), dtype=np.float64)

    @property
    def far(self) -> Mask:
        """Samples that lie beyond FAR of the deviation that their residual has (ny, all samples)."""
        return self.huber & (np.abs(self.standardised) > FAR * np.sqrt(self.remaining))

    @property
    def without_outliers(self) -> Solution:
        """The same trajectories with the scales of squares, and without the samples that lie far off: what tests of whiteness suppose."""
        values = _scaled(self.unweighted, self.term("samples"), np.where(self.far, 0.0, 1.0))
        return Solution(transcription=self.transcription, solver=self.solver, values=values, solved=self.solved)

    @property
    def unweighted(self) -> Values:
        """The program's numbers with the scales of squares."""
        return _scaled(self.values, self.term("samples"), 1.0 / np.sqrt(self.weights * self.gain))

    @property
    def ungained(self) -> Values:
        """The numbers whose cost the solution is the least of: with the weights, and without what they lack for deviations."""
        return _scaled(self.values, self.term("samples"), 1.0 / np.sqrt(self.gain))

    def with_gain(self, gain: Array) -> RobustSolution:
        """The same with another c."""
        return replace(self, values=_scaled(self.ungained, self.term("samples"), np.sqrt(gain)), gain=gain)

    def squares(self) -> tuple[Array, Array]:
        """psi^2 and what it should be with the right scale (ny, all samples)."""
        remaining = self.remaining
        return (self.weights * self.standardised) ** 2, np.where(self.huber, expected_square(remaining), remaining)


def row_squares(solution: Solution, number: int) -> tuple[Array, Array]:
    """r^2 of a term's rows, and what they should be with the right scale, 1 - l; of no meaning where a scale is zero. Both (K m, C)."""
    if isinstance(solution, RobustSolution) and number == solution.term("samples"):
        return solution.squares()
    return solution.rows[number] ** 2, 1.0 - solution.leverage(number) * solution.values.scale[number] ** 2


def solve_robustly(
    solve: Callable[[Array, Values, bool], Solution],
    residuals: Callable[[Array, Values], Array],
    decisions: Array,
    values: Values,
    newton: bool,
    *,
    losses: Losses,
    number: int,
) -> Solution:
    """The program solved with Huber's loss on these samples, term `number`.

    solve(decisions, values, to the full tolerance) -> Solution; residuals(decisions, values) -> z (ny, all samples). To the full tolerance
    (`newton`) the tails are judged, and the deviations are those of the M-estimate.
    """
    found = _reweighted(solve, residuals(decisions, values), decisions, values, newton, losses.huber, number)
    if not newton or not found.solved.status.converged or found.curvature is None:
        return found
    if losses.auto.any():
        needed = _needed(found, losses, values.scale[number] > 0)
        if not needed.any():
            plain = solve(found.solved.decisions, values, newton)
            return replace(plain, solved=replace(plain.solved, iterations=found.solved.iterations + plain.solved.iterations))
        if (needed != losses.huber).any():
            before = found.solved.iterations
            found = _reweighted(solve, found.standardised, found.solved.decisions, values, newton, needed, number)
            found = replace(found, solved=replace(found.solved, iterations=before + found.solved.iterations))
    return _with_gain(found, number)


def _reweighted(
    solve: Callable[[Array, Values, bool], Solution], z: Array, decisions: Array, values: Values, newton: bool, huber: Mask, number: int
) -> RobustSolution:
    iterations, full, settled, led = 0, False, False, False  # led: by exact second derivatives, where plain steps did not arrive
    w = np.where(huber, weight(z), 1.0)
    for _ in range(ROUNDS):
        solution = solve(decisions, _scaled(values, number, np.sqrt(w)), full)
        iterations += solution.solved.iterations
        now = RobustSolution(
            **{f.name: getattr(solution, f.name) for f in fields(Solution)}, weights=w, gain=np.ones_like(w), huber=huber, settled=settled
        )
        slow = solution.solved.status is Status.ITERATIONS and newton and not full  # exact second derivatives may lead on
        if not (solution.solved.status.converged or slow):
            break
        decisions, z = solution.solved.decisions, now.standardised
        anew = np.where(huber, weight(z), 1.0)
        settled = bool(np.linalg.norm((anew - w) * z) < SETTLED)
        now = replace(now, settled=settled)
        if settled and (full or not newton):
            break
        led = led or slow
        full, w = (settled or led) and newton, anew
    return replace(now, solved=replace(now.solved, iterations=iterations))


def _needed(solution: RobustSolution, losses: Losses, there: Mask) -> Mask:
    """Huber's loss where it was asked for, and where the tails of an output's residuals ask for it."""
    e = solution.standardised / np.sqrt(solution.remaining)
    huber = losses.huber.copy()
    for i, asked in enumerate(losses.auto):
        if not heavy_tailed(e[i, asked & there[i]]):
            huber[i, asked] = False
    return huber


def _with_gain(solution: RobustSolution, number: int) -> RobustSolution:
    """The scales as they must be for the deviations of the M-estimate."""
    there = solution.values.scale[number] > 0
    squares, expected = solution.squares()
    inside, remaining = np.abs(solution.standardised) <= CORNER, solution.remaining
    gain = np.ones_like(expected)
    one = np.ones(1)
    for i, bent in enumerate(solution.huber & there):
        if bent.any():
            m_2 = expected_square(one)[0] * squares[i, bent].sum() / expected[i, bent].sum()
            m_1 = min(1.0, expected_slope(one)[0] * np.mean(inside[i, bent]) / np.mean(expected_slope(remaining[i, bent])))
            gain[i, solution.huber[i]] = m_1**2 / (m_2 * np.mean(solution.weights[i, bent]))
    return replace(solution, values=_scaled(solution.values, number, np.sqrt(gain)), gain=gain)


def _scaled(values: Values, number: int, factor: Array) -> Values:
    return replace(values, scale=tuple(s * factor if i == number else s for i, s in enumerate(values.scale)))
