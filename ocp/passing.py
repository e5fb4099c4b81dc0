"""The unknowns of a transcription whose trajectories pass through given ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .interpolation import Interpolation
from .polynomials import Array, gauss
from .transcription import Transcription

Curve = Callable[[int, Array], tuple[Array, Array]]


def passing_through(transcription: Transcription, curve: Curve) -> Array:
    """Trajectory unknowns (n,) through curve(number of the horizon, times (M,)) -> x (nx, M), z (nz, M); residual forces are zero.

    The states are met at the knots; the unknowns inside an interval are those that meet a variable at as many Gauss points as it has there.
    """
    nlp = transcription.nlp
    ip, out = nlp.interpolation, np.zeros(nlp.trajectory_size)
    right = ip.states + ip.interior
    for number, horizon in enumerate(transcription.horizons):
        part = nlp.index[:, transcription.offsets[number] : transcription.offsets[number + 1]]
        x, _ = curve(number, horizon.mesh.knots)
        local = np.zeros(part.shape)
        local[: ip.states], local[right:] = x[:, :-1], x[:, 1:]
        for row, columns in _inside(ip).items():
            nodes, _ = gauss(len(columns))
            steps, tau = np.repeat(horizon.mesh.steps, len(nodes)), np.tile(nodes, horizon.mesh.count)
            values = ip.values(tau, steps)
            wanted = np.vstack(curve(number, np.repeat(horizon.mesh.knots[:-1], len(nodes)) + tau * steps))[row]
            missing = wanted - ip.apply(values, np.repeat(local, len(nodes), axis=1))[ip.states + row]
            slopes = ip.matrix(values)[:, ip.states + row, columns].reshape(-1, len(nodes), len(columns))
            local[columns] = np.linalg.solve(slopes, missing.reshape(-1, len(nodes), 1))[:, :, 0].T
        out[part] = local
    return out


def _inside(ip: Interpolation) -> dict[int, list[int]]:
    """Row of [x; z] -> its unknowns inside an interval. A velocity has none of its own: it is the derivative of its position."""
    found: dict[int, list[int]] = {}
    for e in ip.entries:
        own = ip.states <= e.row < 2 * ip.states + ip.algebraics and e.order == 0
        if own and ip.states <= e.column < ip.states + ip.interior:
            found.setdefault(e.row - ip.states, []).append(e.column)
    return found
