"""The balances that hold a plant's free parameters, as rows that are linear in them:   F(x', x, z, u, p) = F_0 + F_p (p - p_0)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from backsight.models.errors import InputError
from backsight.models.simulation.simulate import sharp_values
from backsight.ocp.columnwise import Columnwise, matrices

from ..problem import Problem
from ..wording import listed
from .measured_states import Motion, visible_states
from .result import require_free

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Balances:
    """rows: indices into the residual; values: all parameters, with sharp corners."""

    rows: tuple[int, ...]
    values: Array
    function: Columnwise

    def along(self, motion: Motion) -> tuple[Array, Array]:
        """F (M, r) and F_p (M, r, p) at the guesses of the free parameters."""
        F, slope = self.function(motion.dx, motion.x, motion.z, motion.u, self.values, motion.t[None, :])
        return F.T, matrices(slope, len(self.rows))


def linear_balances(problem: Problem, method: str) -> Balances:
    """The balances with free parameters whose states the recordings show.

    Raises InputError where a free parameter is in none of them, or in an equation that must hold exactly, or not linearly.
    """
    dae, free = problem.dae, require_free(problem, method)
    p = dae.p[free]
    F = dae.undisturbed(dae.residual)
    depends = [_has(F[r], p) for r in range(F.shape[0])]
    balances = [r for r, e in enumerate(dae.equations) if e.place is not None and depends[r]]
    slope = ca.jacobian(F[balances], p)
    names = [dae.parameters[i].name for i in free]
    exact = [
        name
        for k, name in enumerate(names)
        if any(depends[r] and e.place is None and _has(F[r], p[k]) for r, e in enumerate(dae.equations))
    ]
    absent = [name for k, name in enumerate(names) if not slope[:, k].nnz()]
    curved = [name for k, name in enumerate(names) if _has(ca.densify(slope[:, k]), p)]
    for wrong, what in ((exact, "in an equation that is no balance"), (absent, "in no balance"), (curved, "not linear in the balances")):
        if wrong:
            raise InputError(
                f"parameters: {listed(wrong)}: a free parameter is {what} of {dae.name}, and {method} needs balances linear in the free "
                "parameters; fix one of them, or use prediction_error or smooth."
            )
    visible = visible_states(problem, method)
    hidden = {r: [i for i in range(dae.x.shape[0]) if i not in visible and _has(F[r], ca.vertcat(dae.x[i], dae.dx[i]))] for r in balances}
    rows = [r for r in balances if not hidden[r]]
    unseen = [k for k in range(len(free)) if not any(_has(F[r], p[k]) for r in rows)]
    if unseen:
        needed = sorted({i for r in balances for i in hidden[r] if any(_has(F[r], p[k]) for k in unseen)})
        raise InputError(
            f"parameters: {method} needs {listed([dae.states[i].name for i in needed])} of {dae.name} for "
            f"{listed([names[k] for k in unseen])}, which no output shows; measure it, fix these parameters, or use zoh_prediction_error, "
            "prediction_error or smooth, which need not see every state."
        )
    columns = ca.vec(ca.jacobian(F[rows], p))
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
    function = Columnwise(ca.Function("balances", arguments, [ca.densify(F[rows]), ca.densify(columns)]), (4,))
    given = {
        q.name: float(v) for q, v in zip(dae.parameters, problem.values, strict=True) if not q.smoothing or q.name in problem.parameters
    }
    return Balances(rows=tuple(rows), values=sharp_values(dae, given), function=function)


def _has(expression: Any, symbol: Any) -> bool:
    return bool(any(ca.which_depends(expression, symbol, 1, False))) if symbol.shape[0] else False
