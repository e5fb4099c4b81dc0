"""The force of a candidate at every place, in the mean of every interval, though it may act there by way of what has no balance.

The voltage of a motor stands in the equation of its current, which must hold exactly, and only the current in a balance. What moves such
equations G by dG moves the balances F by

    dF = -F_y G_y^-1 dG        y: the algebraics, and states of first order (currents, states of lags) as they end, without their rates
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from backsight.ocp import Solution
from backsight.ocp.columnwise import matrices

from ...smoothing.begun import in_the_middles

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LEAST = 1e-9  # singular values of G_y, of the largest: what these do not tell stays as it is


@dataclass(frozen=True)
class Acting:
    """rows: of the exact equations, by their number among them; through (N, n_soft, rows): -F_y G_y^-1 in the middles of all intervals."""

    solution: Solution
    rows: tuple[int, ...]
    through: Array

    @classmethod
    def of(cls, solution: Solution) -> Acting:
        """Along a solution."""
        t, dae = solution.transcription, solution.transcription.dae
        balances = t.balance_rows
        moving = ca.vertcat(*(dae.dx[j] for _, j, _ in dae.kinematics))
        exact = [(k, row) for k, row in enumerate(t.exact_rows) if row not in balances and not ca.depends_on(dae.residual[row], moving)]
        G = dae.undisturbed(dae.residual[[row for _, row in exact]])
        rates, positions = set(ca.jacobian_sparsity(G, dae.dx).get_col()), {i for pair in dae.kinematics for i in pair[:2]}
        y = ca.vertcat(dae.z, *(dae.x[i] for i in sorted(rates - positions)))
        F = dae.undisturbed(dae.residual[balances])
        count, places, size = len(t.nlp.steps), len(balances), y.shape[0]
        if not (exact and size and places):
            return cls(solution, (), np.zeros((count, places, 0)))
        slopes = ca.vertcat(ca.vec(ca.jacobian(F, y)), ca.vec(ca.jacobian(G, y)))
        told = np.nan_to_num(in_the_middles(solution, slopes), posinf=0.0, neginf=0.0)
        told_F, told_G = np.split(told, [places * size])
        F_y, G_y = matrices(told_F, places), matrices(told_G, len(exact))
        return cls(solution, tuple(k for k, _ in exact), -F_y @ np.linalg.pinv(G_y, rcond=LEAST))

    def mean(self, rows: Mapping[str, Array]) -> Array:
        """(n_soft, N); rows: of a spline's terms, by their names, in the mean of every interval."""
        t = self.solution.transcription
        found = t.mean_forces(rows)
        if self.rows:
            moved = rows["equations"].reshape(t.degree, -1, len(t.nlp.steps))[0, list(self.rows)]
            found = found + np.einsum("nsg,gn->sn", self.through, moved)
        return found
