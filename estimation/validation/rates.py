"""The rates x' that the model has without its residual forces, along a smoothed trajectory.

A residual force w that the model is right to have moves it: v' = (f + w)/m. Held against v' itself it follows what it made; held against
f/m it does not, and yet a wrong inertia shows: where m_0 v' = f is true, w = (m - m_0) v' = (m - m_0)/m_0 f.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pandas as pd

from backsight.ocp import Solution
from backsight.ocp.columnwise import Columnwise, matrices
from backsight.ocp.follow import Followed

from ..recordings.recording import Recording

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def undriven_rates(solution: Solution, pieces: Sequence[Recording]) -> dict[str, pd.DataFrame]:
    """Recording -> table of every state's rate at its samples (index: time [s]); pieces: of every horizon its rows.

    F(x', x, z, u, p, 0, t) = 0 by one step of Newton's method in (x', z) from the smoothed ones: exact where they enter linearly, as
    accelerations do.
    """
    t, dae = solution.transcription, solution.transcription.dae
    unknown = ca.vertcat(dae.dx, dae.z)
    parts = [ca.jacobian(dae.residual, unknown), dae.residual]
    given = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
    function = Columnwise(ca.Function("undriven", given, [ca.densify(ca.vec(dae.undisturbed(e))) for e in parts]), (4,))
    followed = Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions)
    coloured = [i for i, q in enumerate(dae.states) if q.name.startswith("residual.")]
    found: dict[str, list[pd.DataFrame]] = {}
    for number, (piece, horizon) in enumerate(zip(pieces, t.horizons, strict=True)):
        dx, x, z = (np.array(part) for part in followed.at(number, horizon.time))
        x[coloured] = 0.0  # residual forces too, with a memory
        n = len(horizon.time)
        J, F = function(dx, x, z, horizon.input_at(horizon.time), solution.parameters, horizon.clock + horizon.time[None])
        J = matrices(J, len(F))
        usable = np.abs(np.linalg.det(J)) > 0
        rates = np.full((n, len(dx)), np.nan)
        rates[usable] = dx.T[usable] - np.linalg.solve(J[usable], F.T[usable, :, None])[:, : len(dx), 0]
        found.setdefault(piece.name, []).append(pd.DataFrame(rates, columns=[q.name for q in dae.states], index=piece.time))
    return {name: pd.concat(tables) for name, tables in found.items()}
