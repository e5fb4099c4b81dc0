"""Residual forces of a solution at any place of the mesh, with variances, for both transcriptions.

What is reported is the part of the force that the mesh resolves: a polynomial of degree K - 1 on every interval.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .polynomials import Array, legendre

if TYPE_CHECKING:
    from .solution import Solution


class Forces:
    """w(tau) in interval i. Splines: w = sum_j m_j L_j(tau) from the moments m_j; collocation: the unknowns at the Radau points."""

    def __init__(self, solution: Solution) -> None:
        self._solution = solution
        self._t = solution.transcription
        self._steps = self._t.nlp.steps

    def at(self, interval: NDArray[np.int64], tau: Array) -> tuple[Array, Array]:
        """Values and variances, each (M, n_soft), at the places tau of the intervals (numbers over all horizons)."""
        if self._t.method == "collocation":
            return self._at_collocation(interval, tau)
        weights = legendre(self._t.degree, tau).T
        value = np.einsum("nki,nk->ni", self._moments[interval], weights)
        return value, np.einsum("nk,nikl,nl->ni", weights, self._covariance[interval], weights, optimize=True)

    def at_samples(self, number: int) -> tuple[Array, Array]:
        """Values and standard deviations at the samples of a horizon; at a knot the mean of the limits from both sides."""
        horizon, offset = self._t.horizons[number], self._t.offsets[number]
        if not self._t.soft:
            empty = np.empty((len(horizon.time), 0))
            return empty, empty
        interval, tau = horizon.mesh.locate(horizon.time)
        knots = np.flatnonzero((tau == 0) & (interval > 0))
        value, variance = self.at(interval + offset, tau)
        before, variance_before = self.at(interval[knots] + offset - 1, np.ones(len(knots)))
        value[knots] = (value[knots] + before) / 2
        variance[knots] = (variance[knots] + variance_before) / 2
        return value, np.sqrt(np.maximum(variance, 0.0))

    def _at_collocation(self, interval: NDArray[np.int64], tau: Array) -> tuple[Array, Array]:
        nlp, ip, n = self._t.nlp, self._t.nlp.interpolation, len(self._t.soft)
        basis = ip.values(tau, self._steps[interval])
        local = nlp.local(self._solution.solved.decisions[: nlp.trajectory_size])[:, interval]
        T = ip.matrix(basis)[:, -n:]
        C = self._solution.interval_covariance[interval][:, : ip.local, : ip.local]
        return ip.apply(basis, local)[-n:].T, np.einsum("nij,njk,nik->ni", T, C, T, optimize=True)

    @cached_property
    def _moments(self) -> Array:
        """(N, K, n_soft)."""
        number = self._solution.term("balances")
        m = self._solution.rows[number] / self._solution.values.scale[number]
        return np.ascontiguousarray(m.reshape(self._t.degree, len(self._t.soft), -1).transpose(2, 0, 1))

    @cached_property
    def _covariance(self) -> Array:
        """Covariance of the K moments of every place in every interval, (N, n_soft, K, K)."""
        J = self._solution.jacobian_of_rows(self._solution.term("balances"))
        C = self._solution.interval_covariance
        J = J.reshape(len(C), self._t.degree, len(self._t.soft), -1)
        return np.asarray(np.einsum("nkmi,nij,nlmj->nmkl", J, C, J, optimize=True))
