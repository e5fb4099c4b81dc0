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
    linear: the model linearised in each sample's interval; moved (nx, n), moved_outputs (ny, n): what the input's fine structure adds to
    them between the knots.
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
    linear = _linear_at(t, number, decisions, parameters).taken(interval - t.offsets[number])
    moved = driven_between_knots(linear, *horizon.unresolved_integrals(t.degree))
    outputs = np.einsum("nij,jn->in", linear.C, moved)
    return Readout(interval=interval, tau=tau, basis=basis, dx=dx, x=x, z=z, linear=linear, moved=moved, moved_outputs=outputs)


def _linear_at(t: Transcription, number: int, decisions: Array, parameters: Array) -> Linear:
    """The model linearised in the middle of every interval of a horizon: what it is used for is small, and there may be many samples."""
    horizon, ip = t.horizons[number], t.nlp.interpolation
    count = horizon.mesh.count
    basis = ip.values(np.full(count, 0.5), horizon.mesh.steps)
    v = ip.apply(basis, t.nlp.local(decisions[: t.nlp.trajectory_size])[:, t.offsets[number] : t.offsets[number] + count])
    times = horizon.mesh.knots[:-1] + horizon.mesh.steps / 2
    dx, x, z = v[: ip.states], v[ip.states : 2 * ip.states], v[2 * ip.states : 2 * ip.states + ip.algebraics]
    return linearise(t.dae, dx, x, z, horizon.input_at(times), horizon.clock + times, parameters, t.soft)
