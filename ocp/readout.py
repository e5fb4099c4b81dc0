"""A trajectory read at the samples of a horizon: the polynomials, the model linearised there, and what moves between the knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .linear import Linear, driven_between_knots, linearise
from .polynomials import Array
from .transcription import Transcription


@dataclass(frozen=True, kw_only=True)
class Readout:
    """Values at the n samples of one horizon.

    interval (n,) over all horizons, tau (n,); basis: entries of the interpolation there; dx, x (nx, n), z (nz, n) of the polynomials;
    linear: the model linearised; moved (nx, n), moved_outputs (ny, n): what the input's fine structure adds to them between the knots.
    """

    interval: NDArray[np.int64]
    tau: Array
    basis: Array
    dx: Array
    x: Array
    z: Array
    linear: Linear
    moved: Array
    moved_outputs: Array


def read(transcription: Transcription, number: int, decisions: Array, parameters: Array) -> Readout:
    """Horizon `number` of a transcription at given decisions (n + np,) and model parameters (np_all,)."""
    t = transcription
    horizon, ip = t.horizons[number], t.nlp.interpolation
    interval, tau = horizon.mesh.locate(horizon.time)
    basis = ip.values(tau, horizon.mesh.steps[interval])
    interval = interval + t.offsets[number]
    v = ip.apply(basis, t.nlp.local(decisions[: t.nlp.trajectory_size])[:, interval])
    dx, x, z = v[: ip.states], v[ip.states : 2 * ip.states], v[2 * ip.states : 2 * ip.states + ip.algebraics]
    linear = linearise(t.dae, dx, x, z, horizon.input_at(horizon.time), horizon.time, parameters, t.soft)
    moved = driven_between_knots(linear, *horizon.unresolved_integrals(t.degree))
    outputs = np.einsum("nij,jn->in", linear.C, moved)
    return Readout(interval=interval, tau=tau, basis=basis, dx=dx, x=x, z=z, linear=linear, moved=moved, moved_outputs=outputs)
