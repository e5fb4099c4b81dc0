"""Physical parameters by prediction errors of the plant's exact discretisation, with a noise model.

    x(k+1) = F x + E [u; 1] + noise of covariance Q(W),    y = C x + D [u; 1] + noise of covariance R(V)       (`linear_plant.py`)

F, E, C, D follow from the physical parameters through the plant linearised at a working point; W are densities of the residual forces at
the plant's balances and V the deviations of the outputs. Instead of a free gain K (KSEPL, 1992, eq. 61 to 66, which estimates it because
the Riccati equation is costly) the gain is that of W and V, so the noise model has one number for each place and output, is stable always,
and corresponds to the C polynomial of an ARMAX model. The likelihood of the innovations e ~ N(0, S) of the Kalman filter,

    -2 log L = sum_k ( log det S_k + e_k' S_k^-1 e_k ),

is minimised over parameters, starts, log W and log V as a sum of squares: with all variances relative to a common one, which drops out,

    min  prod_k det(S_k)^(1/m) * sum_k |L_k^-1 e_k|^2,    S = L L',    m values in all

Covariance by Fisher's information sum_k e_i' S^-1 e_j + 1/2 tr(S^-1 S_i S^-1 S_j) (L. Ljung, System Identification, 2nd ed. 1999, sections
7.2 and 9.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import casadi as ca
import numpy as np
import scipy.optimize

from backsight.models import ModelError, SolveError
from backsight.models.analysis import OperatingPoint, equilibrium, operating_point
from backsight.models.errors import InputError

from ..problem import Problem
from ..smoothing.rest import NEAR, friction_laws
from ..wording import listed
from .linear_predictor import LinearPredictor, differences
from .result import Baseline, bounds, estimates, prior, require_free

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
LOG_ROOM = 12.0  # e-folds that a deviation may move from its start


def zoh_prediction_error(
    problem: Problem,
    *,
    point: Mapping[str, float] | None = None,
    noise: Literal["forces", "none"] = "forces",
    max_iterations: int = 60,
) -> Baseline:
    """Free parameters of a plant that is linear about a working point, from recordings with equal steps.

    point   states and inputs of the working point; None: the equilibrium at the mean inputs, with the guesses
    noise   "forces": white forces at every balance and white noise of the outputs, all of them estimated, W of the problem being where
            that begins; "none": of the outputs only, the output error of the linear plant

    Raises InputError for unequal steps, linear holds and unknown names, SolveError where there is no working point.
    """
    require_free(problem, "zoh_prediction_error")
    if noise not in ("forces", "none"):
        raise InputError(f'zoh_prediction_error(noise={noise!r}): the noise is "forces" or "none".')
    about = _working_point(problem, point)
    model = LinearPredictor(problem, about, with_forces=noise == "forces", room=LOG_ROOM)
    mean, information = prior(problem)
    count, total = len(mean), model.unknowns
    lower, upper = np.full(total, -np.inf), np.full(total, np.inf)
    lower[:count], upper[:count] = bounds(problem)
    lower[model.logarithms], upper[model.logarithms] = -LOG_ROOM, LOG_ROOM
    unknown = np.clip(model.start(), lower, upper)
    if not np.all(np.isfinite(model.residuals(unknown))):
        raise SolveError(f"{problem.dae.name} has no linear model at its working point for the guesses; give another point")

    def residuals(v: Array) -> Array:
        return np.concatenate([model.residuals(v), model.scale(v) * np.sqrt(information) * (v[:count] - mean)])

    def slopes(v: Array) -> Array:
        return differences(residuals, v, model.units, upper)

    done = scipy.optimize.least_squares(
        residuals,
        unknown,
        jac=slopes,
        bounds=(lower, upper),
        x_scale=model.units,
        max_nfev=max_iterations,
        xtol=1e-8,
        ftol=1e-9,
    )
    unknown = done.x
    at_bound = done.active_mask[:count] != 0
    std = np.where(at_bound, np.nan, model.deviations(unknown, upper, information))
    notes = [f"Linear about {model.described()}; {done.nfev} evaluations.", *model.noise_notes(unknown), *_on_friction(problem, about)]
    if noise == "forces" and problem.weights.W:
        notes.append(f"W of {listed(list(problem.weights.W))} was where its estimate began, and not kept.")
    if not done.success:
        notes.append("It stopped at its limit of evaluations; give more max_iterations or better guesses.")
    notes += [f"{problem.dae.parameters[i].name} ends on its bound." for k, i in enumerate(problem.free) if at_bound[k]]
    return Baseline(
        method="zoh_prediction_error",
        model=problem.dae.name,
        parameters=estimates(problem, unknown[:count], std),
        fit=model.fits(unknown),
        predicted="one step ahead" if noise == "forces" else "simulated",
        notes=tuple(notes),
    )


def _on_friction(problem: Problem, about: OperatingPoint) -> list[str]:
    """A note on every friction law whose rounded sign has a slope at the working point."""
    dae, found = problem.dae, []
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
    for law in friction_laws(problem):
        info = dae.parameters[law.width]
        velocity = dae.undisturbed(dae.variables[law.velocity])
        v = abs(float(ca.Function("velocity", arguments, [velocity])(*about.columns())))
        if v < NEAR * about.parameters[info.name]:
            found.append(
                f"{law.velocity} is {v:.2g} {info.unit} at the working point, where the friction law has the slope of its rounded corner "
                f"({info.name} = {about.parameters[info.name]:.2g} {info.unit}): the numbers of this friction mean nothing. "
                "Give a point at which it moves, and recordings that keep to one direction."
            )
    return found


def _working_point(problem: Problem, given: Mapping[str, float] | None) -> OperatingPoint:
    dae = problem.dae
    drives = {q.name: float(np.mean(np.concatenate([r.inputs[q.name] for r in problem.fitted]))) for q in dae.inputs}
    values = {
        p.name: float(v) for p, v in zip(dae.parameters, problem.values, strict=True) if not p.smoothing or p.name in problem.parameters
    }
    if given is None:
        return equilibrium(dae, inputs=drives, parameters=values)
    inputs = drives | {name: float(v) for name, v in given.items() if name in drives}
    try:
        return operating_point(dae, {n: float(v) for n, v in given.items() if n not in drives}, inputs, values)
    except ModelError as error:
        raise InputError(f"zoh_prediction_error(point=..): {error}") from error
