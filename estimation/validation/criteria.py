"""How well a model explains the samples for the freedom that it took: evidence, AIC and BIC, at the weights in force.

    log likelihood     log p(y | p^, weights), the trajectories integrated out, flat in the first states [SI] where they are not known
    log evidence       log p(y | weights), the parameters too, by Laplace's approximation:
                       log likelihood + log p(p^) + np/2 log 2 pi - 1/2 log det(information on p)
    k                  trace of the hat matrix: how many of the samples the fit could choose freely, trajectory included (Ye, J. Amer.
                       Statist. Assoc. 93, 1998)
    AIC                -2 log p(y | x^, p^) + 2 k          (conditional: Vaida & Blanchard, Biometrika 92, 2005)
    BIC                -2 log p(y | x^, p^) + k log n

The density of a sample is Gaussian, or where its loss is Huber's the one that goes with it (`robust.py`); then the log likelihood too is
Laplace's approximation, with the curvature in force.

A parameter of which nothing is known counts as spread evenly over its own nominal size, so that evidences of models with
different parameters can be compared; how wide it is matters to the log evidence by its logarithm. With
weights left to the data, k does not count them. All are natural logarithms; more evidence, less AIC and BIC are better, among models of the
same samples.
"""

from __future__ import annotations

import numpy as np

from backsight.ocp import Solution

from ..results import Criteria
from ..smoothing.robust import RobustSolution, log_density
from .innovations import Filtered, scale_of_samples

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
LOG_2PI = float(np.log(2.0 * np.pi))


def criteria(solution: Solution, filtered: Filtered | None) -> Criteria | None:
    """The criteria of a solution and its prediction errors; None where it is no minimum."""
    if filtered is None or solution.curvature is None:
        return None
    t = solution.transcription
    samples = solution.term("samples")
    scale, rows = solution.values.scale[samples], solution.rows[samples]
    there = scale > 0
    n = int(there.sum())
    conditional = float(np.sum(_log_densities(solution, samples)[there]))
    k = float(np.sum((solution.leverage(samples) * scale**2)[there]))
    priors = [i for i, term in enumerate(t.nlp.terms) if term.name == "parameter prior"]
    prior_squares = float(sum(np.sum(solution.rows[i] ** 2) for i in priors))
    squares = float(sum(np.sum(r**2) for r, term in zip(solution.rows, t.nlp.terms, strict=True) if not term.equality))
    squares -= float(np.sum(rows[there] ** 2)) + prior_squares
    known_starts = [i for i, term in enumerate(t.nlp.terms) if term.name == "initial state"]
    start_scale = np.concatenate([solution.values.scale[i].ravel() for i in known_starts] or [np.empty(0)])
    start_scale = start_scale[start_scale > 0]
    likelihood = evidence = None
    if filtered.determined:
        directions = sum(run.E.shape[1] for run in filtered.horizons) - len(filtered.horizons) * len(filtered.parameter_root)
        likelihood = (
            conditional
            - sum(run.log_roots for run in filtered.horizons)
            - 0.5 * squares
            + 0.5 * directions * LOG_2PI
            - filtered.first_root
            + float(np.sum(np.log(start_scale)))
            - 0.5 * start_scale.size * LOG_2PI
        )
        np_ = len(filtered.parameter_root)
        evidence = (
            likelihood
            + _log_prior(solution, prior_squares)
            + 0.5 * np_ * LOG_2PI
            - float(np.sum(np.log(np.abs(np.diag(filtered.parameter_root)))))
        )
    return Criteria(
        log_evidence=evidence,
        log_likelihood=likelihood,
        aic=-2.0 * conditional + 2.0 * k,
        bic=-2.0 * conditional + k * float(np.log(n)),
        effective_parameters=k,
        samples=n,
        first_states=filtered.first_states,
    )


def _log_densities(solution: Solution, number: int) -> Array:
    """log p(y_k | x^, p^) of every sample, term `number`, (ny, all samples); of no meaning where there is none."""
    scale, rows = solution.values.scale[number], solution.rows[number]
    plain = -0.5 * (rows**2 + LOG_2PI)
    with np.errstate(divide="ignore"):
        if isinstance(solution, RobustSolution):
            scale = scale_of_samples(solution)
            plain = np.where(solution.huber, log_density(solution.standardised), plain)
        return np.asarray(np.log(scale) + plain)


def _log_prior(solution: Solution, squares: float) -> float:
    """Log density of the estimate of the parameters that moved: normal where something is known of them, else even over their size."""
    t = solution.transcription
    known = np.zeros(len(t.nlp.free), dtype=bool)
    total = -0.5 * squares
    for number, term in enumerate(t.nlp.terms):
        if term.name == "parameter prior":
            scale = solution.values.scale[number].ravel()
            total += float(np.sum(np.log(scale))) - 0.5 * scale.size * LOG_2PI
            known |= np.any(solution.jacobian_of_rows(number)[:, :, t.nlp.interpolation.local :] != 0, axis=(0, 1))
    for k, i in enumerate(t.nlp.free):
        if not known[k] and t.nlp.trajectory_size + k not in solution.solved.on_bound:
            info = t.dae.parameters[i]
            size = abs(info.nominal) or abs(info.value) or 1.0
            total -= float(np.log(size))
    return total
