"""Output error of the simulated plant: the prediction-error method with noise in the measurements only (shooting).

    min  sum_k |(y_k - h(x(t_k; x_0, p))) / s|^2        F(x', x, z, u, p, 0, t) = 0,  x(t_0) = x_0

over the free parameters p and the initial states x_0 of every segment, by Gauss-Newton in a trust region; derivatives by differences of
whole simulations, in which all segments move at once. Nothing but the inputs drives the model, so it is the plant for all of a segment's
length: with one segment a free integrator carries every error to the end of the recording; with short ones the starts take it up
(L. Ljung, System Identification, 2nd ed. 1999, section 5.3 and chapter 7; H. G. Bock, Springer Series in Chemical Physics 18, 1981).

s of every output is the rms of its own error, by two passes. With p profiled over x_0, J_p - J_x J_x^+ J_p, the standard deviations are
those of coloured residuals (`regression.py`).
"""

from __future__ import annotations

import numpy as np
import scipy.optimize

from backsight.models import SolveError

from ..problem import Problem
from .regression import solve
from .result import Baseline, bounds, estimates, prior, require_free
from .shooting import Shooting, cut

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
PASSES = 2


def prediction_error(problem: Problem, *, segment: float | None = None, max_iterations: int = 30) -> Baseline:
    """Free parameters and initial states whose simulation meets the samples best.

    segment         seconds that are simulated from one start; None: every recording as a whole
    max_iterations  evaluations of the trust-region method in each of its passes

    Any plant, any sampling, missing samples. Raises InputError where nothing is free or a segment is shorter than ten samples,
    SolveError where the plant cannot be simulated at the guesses.
    """
    require_free(problem, "prediction_error")
    shooting = Shooting(problem, cut(problem, segment))
    mean, information = prior(problem)
    low, high = bounds(problem)
    count = len(mean)
    unknown = np.concatenate([np.clip(mean, low, high), shooting.starts().ravel()])
    if not np.all(np.isfinite(shooting.residuals(unknown))):
        raise SolveError(
            f"{problem.dae.name} cannot be simulated over the recordings at the guesses of its parameters; give others, or a shorter "
            "segment = seconds"
        )
    lower, upper = (np.concatenate([b, np.full(len(unknown) - count, s)]) for b, s in ((low, -np.inf), (high, np.inf)))
    unit = np.concatenate([shooting.size, np.tile(shooting.state_size, len(shooting.segments))])

    def residuals(v: Array) -> Array:
        return np.concatenate([shooting.residuals(v), np.sqrt(information) * (v[:count] - mean)])

    def jacobian(v: Array) -> Array:
        return np.vstack([shooting.jacobian(v), np.eye(count, len(v)) * np.sqrt(information)[:, None]])

    for _ in range(PASSES if shooting.outputs > 1 or information.any() else 1):
        done = scipy.optimize.least_squares(
            residuals,
            np.clip(unknown, lower, upper),
            jac=jacobian,
            bounds=(lower, upper),
            x_scale=unit,
            max_nfev=max_iterations,
            xtol=1e-6,
            ftol=1e-6,
        )
        unknown = done.x
        shooting.reweigh(unknown)
    theta = unknown[:count]
    profiled, errors = shooting.profiled(unknown)
    found = solve(profiled, [e + np.einsum("krp,p->kr", X, theta) for X, e in zip(profiled, errors, strict=True)], mean, information)
    at_bound = done.active_mask[:count] != 0
    std = np.where(at_bound, np.nan, found.std)
    notes = [
        f"Simulated from {len(shooting.segments)} start{'s' * (len(shooting.segments) > 1)}, "
        f"{'each recording as a whole' if segment is None else f'{segment:g} s each'}; {done.nfev} evaluations."
    ]
    if not done.success:
        notes.append("It stopped at its limit of evaluations; give more max_iterations or better guesses.")
    notes += [f"{problem.dae.parameters[i].name} ends on its bound." for k, i in enumerate(problem.free) if at_bound[k]]
    return Baseline(
        method="prediction_error",
        model=problem.dae.name,
        parameters=estimates(problem, theta, std, list(found.determined)),
        fit=shooting.fits(unknown),
        predicted="simulated",
        notes=tuple(notes),
    )
