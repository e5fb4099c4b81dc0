"""Trajectories that follow the samples smoothly, whatever the model's balances say: where a solve can start.

    min  1/2 sum_k |(y_k - h)/std|^2  +  1/2 int |a / alpha|^2 dt,        a = x' of every state (x'' of a position)

over the splines of a transcription, by Gauss-Newton with a banded Cholesky factor. alpha grows from stiff to soft until the samples are
met within their deviations, or until softer does not help. A state that no output shows stays near zero; algebraic variables
are those that go with the states (`algebraic.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg
import scipy.sparse as sp

from backsight.models import Dae

from .algebraic import algebraics_along
from .horizon import Horizon
from .ipopt import Solver
from .passing import passing_through
from .pieces import Pieces
from .polynomials import Array, gauss
from .spline import pairs
from .terms import Term
from .transcription import ParameterPrior, Transcription, transcribe

SOFTNESS = 10.0 ** np.arange(0.0, 13.0)
MET = 1.5  # mean square of the scaled differences at which the samples count as met
ENOUGH = 3  # samples in an interval
RIDGES = (0.0, 1e-12, 1e-9, 1e-6)  # on a unit diagonal, where rounding leaves it indefinite
RELINEARISATIONS = 4  # for outputs that are not linear in the states


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Trajectories that follow the samples: splines through them, or the solution of a program.

    transcription: whose unknowns they are (of the thinned samples, say); horizons: the full ones; decisions (n,) or more; mean_square:
    of the scaled differences left by splines. covariance (N, local, local): of every interval's unknowns, where it is known.
    """

    transcription: Transcription
    horizons: tuple[Horizon, ...]
    decisions: Array
    mean_square: float = 0.0
    covariance: Array | None = None

    def at(self, number: int, times: Array) -> tuple[Array, Array, Array]:
        """x' and x (nx, M) and z (nz, M) of horizon `number` at any times."""
        t = self.transcription
        mesh, ip = t.horizons[number].mesh, t.nlp.interpolation
        interval, tau = mesh.locate(times)
        local = t.nlp.local(self.decisions)[:, interval + t.offsets[number]]
        v = ip.apply(ip.values(tau, mesh.steps[interval]), local)
        return v[: ip.states], v[ip.states : 2 * ip.states], v[2 * ip.states : 2 * ip.states + ip.algebraics]

    def spread(self, number: int, times: Array, slope: Array) -> Array:
        """Standard deviations (M,) of a function of (x', x, z) with these derivatives (2 nx + nz, M); 0 where none is known."""
        if self.covariance is None:
            return np.zeros(len(times))
        t = self.transcription
        mesh, ip = t.horizons[number].mesh, t.nlp.interpolation
        interval, tau = mesh.locate(times)
        T = ip.matrix(ip.values(tau, mesh.steps[interval]))[:, : len(slope)]
        row = np.einsum("im,mil->ml", slope, T)
        variance = np.einsum("mi,mij,mj->m", row, self.covariance[interval + t.offsets[number]], row, optimize=True)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def follow(dae: Dae, horizons: Sequence[Horizon], parameters: Array, *, degree: int = 2) -> Followed:
    """Smooth curves through the samples of all horizons, with the model's output equations at the given parameters (np_all,)."""
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    t = transcribe(dae, [_thinned(h) for h in horizons], free=(), prior=nothing, force_std={}, degree=degree)
    samples = next(term for term in t.nlp.terms if term.name == "samples")
    pieces = Pieces(dae, t.nlp.interpolation, horizons, t.offsets, ())
    rough = Solver(replace(t.nlp, terms=(_roughness(pieces, degree, horizons),)))
    close = Solver(replace(t.nlp, terms=(samples,)))
    count = max(1, int(np.count_nonzero(samples.scale)))
    curvature = rough.hessian(np.zeros(t.nlp.size), rough.nlp.values(parameters))[0]
    x, met = _with_algebraics(t, _level(t), parameters), np.inf
    values = close.nlp.values(parameters)
    curved = not _linear_output(dae)
    for _ in range(RELINEARISATIONS if curved else 1):
        x, met = _softest_needed(close, values, curvature, x, count)
        x = _with_algebraics(t, x, parameters)
    return Followed(transcription=t, horizons=tuple(horizons), decisions=x, mean_square=met)


def _thinned(horizon: Horizon) -> Horizon:
    """Every k-th sample, so that an interval holds no more than a few: enough to follow, and for any length of record quick."""
    keep = np.zeros(len(horizon.time), dtype=bool)
    keep[[0, -1]] = True
    for y in horizon.target.T:
        there = np.flatnonzero(np.isfinite(y))
        keep[there[:: max(1, len(there) // (ENOUGH * horizon.mesh.count))]] = True
    rows = np.flatnonzero(keep)
    return replace(
        horizon, time=horizon.time[rows], drive_time=horizon.changes, target=horizon.target[rows], target_std=horizon.target_std[rows]
    )


def _softest_needed(close: Solver, values: Any, roughness: sp.csc_matrix, x: Array, count: int) -> tuple[Array, float]:
    """One linearisation at x and the whole ladder of alpha on it; returns the decisions and the mean square foreseen."""
    H = close.hessian(x, values)[0]
    evaluated = close.nlp.evaluated
    gradient = evaluated.gradient([evaluated.linearised(k, x, values) for k in range(len(close.nlp.terms))])
    square = float(np.sum(close.rows(x, values)[0] ** 2))
    tiny = sp.identity(len(x), format="csc") * 1e-12 * max(float(H.diagonal().max()), 1e-300)
    results = []
    for alpha in SOFTNESS:
        R = roughness / alpha**2
        step = -_solve_banded(H + R + tiny, gradient + _symmetric(R) @ x)
        now = (square + float(2 * gradient @ step + step @ (_symmetric(H) @ step))) / count
        results.append((now, x + step))
        if now < MET:
            break
    least = min(now for now, _ in results)
    now, best = next(pair for pair in results if pair[0] <= max(1.1 * least, MET))
    return best, now


def _roughness(pieces: Pieces, degree: int, horizons: Sequence[Horizon]) -> Term:
    """x' of every state that is no position, in units of its nominal size over the square of the record's length."""
    dae = pieces.dae
    positions = {i for i, _, _ in pairs(dae)}
    rows = [i for i in range(dae.x.shape[0]) if i not in positions]
    places, weights = gauss(degree)
    steps = pieces.steps()
    span = max(float(h.time[-1] - h.time[0]) for h in horizons)
    unit = np.concatenate([[dae.states[i].nominal / span for i in rows], np.ones(dae.z.shape[0])])
    scale = (np.sqrt(weights[:, None] * steps)[:, None, :] / unit[:, None]).reshape(-1, len(steps))
    expression = ca.vertcat(*(dae.dx[i] for i in rows), *(dae.z[i] for i in range(dae.z.shape[0])))
    return Term(
        name="roughness",
        function=pieces.function("roughness", expression),
        interval=np.arange(len(steps)),
        nodes=places,
        data=np.zeros((degree * (dae.u.shape[0] + 1), len(steps))),
        target=np.zeros(scale.shape),
        scale=scale,
    )


def _level(t: Transcription) -> Array:
    """All decisions zero but for the states' own start values."""
    x = np.zeros(t.nlp.size)
    ip = t.nlp.interpolation
    for i, state in enumerate(t.dae.states):
        x[t.nlp.index[i]] = x[t.nlp.index[ip.states + ip.interior + i]] = state.start
    return x


def _with_algebraics(t: Transcription, decisions: Array, parameters: Array) -> Array:
    """The same states with the algebraic variables that go with them."""
    if not t.dae.algebraics:
        return decisions
    states = Followed(transcription=t, horizons=t.horizons, decisions=decisions)

    def curve(number: int, times: Array) -> tuple[Array, Array]:
        dx, x, _ = states.at(number, times)
        horizon = t.horizons[number]
        return x, algebraics_along(t.dae, dx, x, horizon.input_at(times), parameters, horizon.clock + times)

    return passing_through(t, curve)


def _linear_output(dae: Dae) -> bool:
    return not any(ca.which_depends(dae.output, ca.vertcat(dae.dx, dae.x, dae.z), 2, False))


def _symmetric(upper: sp.csc_matrix) -> sp.csc_matrix:
    return sp.csc_matrix(upper + sp.triu(upper, 1).T)


def _solve_banded(upper: sp.csc_matrix, rhs: Array) -> Array:
    entries = upper.tocoo()
    width = int(np.max(entries.col - entries.row, initial=0))
    banded = np.zeros((width + 1, upper.shape[0]))
    banded[width + entries.row - entries.col, entries.col] = entries.data
    # the unit of every unknown its own: Cholesky on a unit diagonal
    unit = 1.0 / np.sqrt(banded[width])
    for k in range(width + 1):
        banded[width - k, k:] *= unit[k:] * unit[: len(unit) - k]
    for ridge in RIDGES:
        banded[width] = 1.0 + ridge
        try:
            return np.asarray(unit * scipy.linalg.solveh_banded(banded, unit * rhs, check_finite=False), dtype=np.float64)
        except np.linalg.LinAlgError:
            continue
    return np.full(upper.shape[0], np.nan)
