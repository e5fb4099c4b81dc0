"""A solved program read back in the terms of the model: states, outputs and residual forces at any sample, with deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from .curvature import Curvature, curvature
from .horizon import Horizon
from .ipopt import Solved, Solver
from .mesh import Mesh
from .nlp import Values
from .polynomials import Array, legendre
from .transcription import Transcription


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """Estimates at given times of one horizon: rows are times. Standard deviations are of the same shapes.

    states (n, nx), algebraics (n, nz), outputs (n, ny), forces (n, n_soft): what the mesh resolves of the residual forces [SI].
    """

    time: Array
    states: Array
    states_std: Array
    algebraics: Array
    outputs: Array
    outputs_std: Array
    forces: Array
    forces_std: Array


@dataclass(frozen=True, kw_only=True)
class Solution:
    """What a solve gave. Readable whatever the status; the covariances need a solution that is a minimum."""

    transcription: Transcription
    solver: Solver
    values: Values
    solved: Solved

    @property
    def parameters(self) -> Array:
        """All parameters of the model, the free ones estimated; (np_all,)."""
        out = self.values.parameters.copy()
        out[list(self.transcription.nlp.free)] = self.solved.decisions[self.transcription.nlp.trajectory_size :]
        return out

    @cached_property
    def fixed(self) -> Any:
        """Decisions known exactly: initial states with standard deviation zero."""
        t = self.transcription
        exact = np.array([h.initial_std == 0 for h in t.horizons]).reshape(t.starts.shape)
        return t.starts[exact]

    @cached_property
    def curvature(self) -> Curvature:
        """Covariances from the Gauss-Newton KKT matrix."""
        hessian, jacobian = self.solver.hessian(self.solved.decisions, replace(self.values, gamma=0.0))
        return curvature(self.transcription.nlp, hessian, jacobian, self.values.unit, self.fixed)

    @cached_property
    def rows(self) -> list[Array]:
        """Scaled rows r of every term."""
        return self.solver.rows(self.solved.decisions, self.values)

    def term(self, name: str) -> int:
        """Number of the term called `name`."""
        return [t.name for t in self.transcription.nlp.terms].index(name)

    def leverage(self, number: int) -> Array:
        """Variance of the gathered values m of a term given the data, unscaled, (m, R)."""
        J = self.solver.jacobian_of_rows(number, self.solved.decisions, self.values)
        C = self.curvature.interval_covariance[self.transcription.nlp.terms[number].row_interval]
        return np.einsum("rmi,rij,rmj->mr", J, C, J, optimize=True)

    def sampled(self, number: int, *, deviations: bool = True) -> Sampled:
        """Estimates at the samples of horizon `number`."""
        t = self.transcription
        horizon, offset = t.horizons[number], t.offsets[number]
        interval, tau = horizon.mesh.locate(horizon.time)
        nlp, ip = t.nlp, t.nlp.interpolation
        local = nlp.local(self.solved.decisions[: nlp.trajectory_size])[:, interval + offset]
        basis = ip.values(tau, horizon.mesh.steps[interval])
        v = ip.apply(basis, local)
        nx, nz = ip.states, ip.algebraics
        x, z = v[nx : 2 * nx].T, v[2 * nx : 2 * nx + nz].T
        first = sum(len(h.time) for h in t.horizons[:number])
        part = slice(first, first + len(horizon.time))
        samples = self.term("samples")
        y = self._outputs(samples)[:, part].T
        force, force_std = self._forces(horizon, offset, deviations)
        x_std, y_std = np.full(x.shape, np.nan), np.full(y.shape, np.nan)
        if deviations:
            T = ip.matrix(basis)[:, nx : 2 * nx]
            C = self.curvature.interval_covariance[interval + offset]
            unresolved, passed = self._unresolved(horizon, interval, tau, v)
            x_std = np.sqrt(np.maximum(np.einsum("nij,njk,nik->ni", T, C[:, : ip.local, : ip.local], T, optimize=True), 0.0) + unresolved)
            y_std = np.sqrt(np.maximum(self.leverage(samples)[:, part].T, 0.0) + passed)
        return Sampled(
            time=horizon.time, states=x, states_std=x_std, algebraics=z, outputs=y, outputs_std=y_std, forces=force, forces_std=force_std
        )

    def _outputs(self, samples: int) -> Array:
        """Outputs of the model at all samples (also the missing ones), (ny, all samples)."""
        ones = tuple(np.ones_like(s) if i == samples else s for i, s in enumerate(self.values.scale))
        zeros = tuple(np.zeros_like(s) if i == samples else s for i, s in enumerate(self.values.target))
        return self.solver.rows(self.solved.decisions, replace(self.values, scale=ones, target=zeros))[samples]

    # ---- residual forces

    def _forces(self, horizon: Horizon, offset: int, deviations: bool) -> tuple[Array, Array]:
        """Residual forces at the samples; at a knot the mean of the limits from both sides."""
        t, mesh = self.transcription, horizon.mesh
        if not t.soft:
            empty = np.empty((len(horizon.time), 0))
            return empty, empty
        interval, tau = mesh.locate(horizon.time)
        before = np.flatnonzero((tau == 0) & (interval > 0))
        value, variance = self._force_at(mesh, offset, interval, tau, deviations)
        other, other_variance = self._force_at(mesh, offset, interval[before] - 1, np.ones(len(before)), deviations)
        value[before] = (value[before] + other) / 2
        variance[before] = (variance[before] + other_variance) / 2
        return value, np.sqrt(np.maximum(variance, 0.0))

    def _force_at(self, mesh: Mesh, offset: int, interval: Any, tau: Array, deviations: bool) -> tuple[Array, Array]:
        t = self.transcription
        K, N, n = t.degree, mesh.count, len(t.soft)
        if t.method == "collocation":
            ip = t.nlp.interpolation
            basis = ip.values(tau, mesh.steps[interval])
            local = t.nlp.local(self.solved.decisions[: t.nlp.trajectory_size])[:, interval + offset]
            value = ip.apply(basis, local)[-n:].T
            if not deviations:
                return value, np.full(value.shape, np.nan)
            T = ip.matrix(basis)[:, -n:]
            C = self.curvature.interval_covariance[interval + offset][:, : ip.local, : ip.local]
            return value, np.einsum("nij,njk,nik->ni", T, C, T, optimize=True)
        number = self.term("balances")
        inside = slice(offset * K, (offset + N) * K)
        eps = (self.rows[number] / self.values.scale[number])[:, inside].reshape(n, N, K)
        weights = (legendre(K, tau) / np.sqrt(mesh.steps[interval])).T
        value = np.einsum("ink,nk->ni", eps[:, interval], weights)
        if not deviations:
            return value, np.full(value.shape, np.nan)
        return value, np.einsum("nk,nikl,nl->ni", weights, self._moment_covariance[offset : offset + N][interval], weights, optimize=True)

    @cached_property
    def _moment_covariance(self) -> Array:
        """Covariance of the K moments of every place in every interval, (N, n_soft, K, K)."""
        t = self.transcription
        J = self.solver.jacobian_of_rows(self.term("balances"), self.solved.decisions, self.values)
        C = self.curvature.interval_covariance
        J = J.reshape(len(C), t.degree, *J.shape[1:])
        return np.einsum("nkmi,nij,nlmj->nmkl", J, C, J, optimize=True)

    # ---- what the mesh does not resolve

    def _unresolved(self, horizon: Horizon, interval: Any, tau: Array, v: Array) -> tuple[Array, Array]:
        """Variance that white residual forces add between the knots beyond their K moments, to states and outputs.

        w enters x' as G w. Of the Brownian motion that it drives inside an interval, K moments leave a bridge of variance
        std^2 h ( tau (1 - tau) - sum_(j=1)^(K-1) (int_0^tau L_j)^2 ), zero at the knots.
        """
        t = self.transcription
        dae = t.dae
        if not t.soft:
            return np.zeros((len(tau), dae.x.shape[0])), np.zeros((len(tau), dae.output.shape[0]))
        bridge = (tau * (1 - tau) - sum(s**2 for s in _integrated_legendre(t.degree, tau))) * horizon.mesh.steps[interval]
        gain, sensitivity = _noise_gain(t, v, horizon, self.parameters)
        state = np.einsum("nij,j->ni", gain**2, t.force_std**2) * np.maximum(bridge, 0.0)[:, None]
        through = sensitivity @ gain
        return state, np.einsum("nij,j->ni", through**2, t.force_std**2) * np.maximum(bridge, 0.0)[:, None]


def _integrated_legendre(degree: int, tau: Array) -> Sequence[Array]:
    """int_0^tau L_j for j = 1 .. degree - 1, from L_(j+1) - L_(j-1) (unnormalised)."""
    P = legendre(degree + 1, tau) / np.sqrt(2.0 * np.arange(degree + 1) + 1.0)[:, None]
    return [np.sqrt(2.0 * j + 1.0) * (P[j + 1] - P[j - 1]) / (2.0 * (2.0 * j + 1.0)) for j in range(1, degree)]


def _noise_gain(t: Transcription, v: Array, horizon: Horizon, parameters: Array) -> tuple[Array, Array]:
    """G = dx'/dw (n, nx, n_soft) and dy/dx (n, ny, nx) at the samples; zero where the model does not determine x'."""
    dae, ip = t.dae, t.nlp.interpolation
    nx, nz, n = ip.states, ip.algebraics, v.shape[1]
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
    w = ca.SX.zeros(dae.w.shape[0])
    expressions = [ca.jacobian(dae.residual, ca.vertcat(dae.dx, dae.z)), ca.jacobian(dae.residual, dae.w)[:, list(t.soft)], ca.jacobian(dae.output, dae.x)]
    function = ca.Function("gain", arguments, [ca.densify(ca.substitute(e, dae.w, w)) for e in expressions]).map(n)
    out = function(v[:nx], v[nx : 2 * nx], v[2 * nx : 2 * nx + nz], horizon.input_at(horizon.time), parameters, horizon.time[None, :])
    shapes = [(nx + nz, nx + nz), (nx + nz, len(t.soft)), (dae.output.shape[0], nx)]
    A, B, H = (_stacked(o, rows, columns, n) for o, (rows, columns) in zip(out, shapes, strict=True))
    try:
        gain = -np.linalg.solve(A, B)[:, :nx]
    except np.linalg.LinAlgError:
        gain = np.zeros((n, nx, len(t.soft)))
    return gain, H


def _stacked(matrix: Any, rows: int, columns: int, count: int) -> Array:
    """(rows, columns * count) side by side -> (count, rows, columns)."""
    return np.ascontiguousarray(np.asarray(matrix).reshape(rows, count, columns).transpose(1, 0, 2))
