"""Where unseen lags start: at rest under the first inputs.

A lag whose input is known is near it after a few of its time constants. Started at zero it would have to find its way, and a law may be
singular there (the thrust of a propeller has no slope at rest). With F(x', x, u) = 0 the balance of one of them and the others held,

    x <- x - F/F_x  with x' = 0,        time constant  |F_x'/F_x|
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..problem import Problem
from ..smoothing.driven import lags_of
from ..smoothing.unseen import unseen_states

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

STEPS = 20  # Newton's


def settled(problem: Problem, inputs: Array, time: float, within: float) -> dict[str, float]:
    """Unseen states of first order whose time constants are shorter than `within` [s] -> where they rest under the inputs (nu,)."""
    dae, lags = problem.dae, lags_of(problem.dae, set(unseen_states(problem)))
    if not lags:
        return {}
    own, rows = list(lags), list(lags.values())
    F = dae.undisturbed(dae.residual[rows])
    slopes = [ca.vertcat(*(ca.jacobian(F[k], v[i]) for k, i in enumerate(own))) for v in (dae.x, dae.dx)]
    balance = ca.Function("balance", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], [F, *slopes])
    x, z = np.array([q.start for q in dae.states]), np.array([q.start for q in dae.algebraics])
    x[own] = [dae.states[i].start or dae.states[i].nominal for i in own]
    for _ in range(STEPS):
        f, slope, inertia = (np.asarray(a).ravel() for a in balance(np.zeros(len(x)), x, z, inputs, problem.values, time))
        quick = np.isfinite(f) & (np.abs(inertia) < within * np.abs(slope))
        x[own] = np.where(quick, x[own] - f / np.where(quick, slope, 1.0), x[own])
    return {dae.states[i].name: float(x[i]) for i, there in zip(own, quick.tolist(), strict=True) if there}
