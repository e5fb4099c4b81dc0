"""The outputs at the newest sample and their deviations, for sensors that look at accelerations too.

The state x is known; x' and z follow from the model without residual force, F(v, x, u, p, t) = 0 for v = [x'; z], and

    dy/d(x, p) = h_(x,p) - h_v F_v^-1 F_(x,p),     dy/dw = h_w - h_v F_v^-1 F_w
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from backsight.ocp.called import Called
from backsight.ocp.moving.stage import Stage

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

STEPS, PRECISE = 20, 1e-10  # Newton steps for v, and the relative size of the last one


class Readings:
    """Outputs of a model at a knot; deviations also of what a white force does to them over a stage."""

    def __init__(self, stage: Stage) -> None:
        dae, free = stage.dae, list(stage.free)
        p = ca.SX.sym("p", len(free))
        values = ca.SX(ca.DM(stage.fixed))
        for k, i in enumerate(free):
            values[i] = p[k]
        v, xp = ca.vertcat(dae.dx, dae.z), ca.vertcat(dae.x, p)
        F, h = (ca.substitute(e, dae.p, values) for e in (dae.residual, dae.output))
        quiet = [dae.undisturbed(e) for e in (F, ca.jacobian(F, v), h, ca.jacobian(h, v), ca.jacobian(h, xp), ca.jacobian(F, xp))]
        soft = list(stage.soft)
        forces = [dae.undisturbed(ca.jacobian(e, dae.w)[:, soft]) for e in (h, F)]
        arguments = [v, dae.x, dae.u, p, dae.t]
        self.at_once = ca.jacobian_sparsity(dae.output, ca.vertcat(v, dae.w)).nnz() > 0
        self._all = Called(ca.Function("readings", arguments, [ca.densify(e) for e in (*quiet, *forces)], {"cse": True}))
        self.guess = np.concatenate([np.zeros(dae.x.shape[0]), [q.start for q in dae.algebraics]])

    def at(self, x: Array, u: Array, p: Array, time: float, half: Array, force_std: Array, step: float) -> tuple[Array, Array]:
        """Outputs (ny,) and their deviations; half: root of the covariance of [x; p]; force_std (n_soft,) acting over `step` [s]."""
        v, t = self.guess, np.array([time])
        found = self._all(v, x, u, p, t)
        for _ in range(STEPS if self.at_once else 0):
            move = np.linalg.solve(found[1], -found[0][:, 0])
            v = v + move
            found = self._all(v, x, u, p, t)
            if not np.any(np.abs(move) > PRECISE * (1.0 + np.abs(v))):
                break
        h, h_xp = found[2][:, 0].copy(), found[4]
        if not self.at_once:
            return h, np.sqrt(np.sum((h_xp @ half) ** 2, axis=1))
        if np.all(np.isfinite(v)):
            self.guess = v
        _, F_v, _, h_v, _, F_xp, h_w, F_w = found
        through = np.linalg.solve(F_v.T, h_v.T).T
        moved = (h_w - through @ F_w) * (force_std / np.sqrt(step))
        return h, np.sqrt(np.sum(((h_xp - through @ F_xp) @ half) ** 2, axis=1) + np.sum(moved**2, axis=1))
