"""One stretch of time with its held inputs and the samples that the outputs should follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .mesh import Mesh, Quadrature, quadrature
from .polynomials import Array, gauss, legendre


@dataclass(frozen=True, kw_only=True)
class Horizon:
    """Samples of one stretch and the mesh over it.

    time (n,) [s]: of the samples. inputs (m, nu) at drive_time (m,) [s], by itself the same: row k acts from time k to k + 1 (hold "zero")
    or joins row k + 1 by a straight line ("linear").
    target (n, ny): what output k should be at time k, with its standard deviation `target_std` (n, ny); NaN where nothing was sampled.
    initial (nx,) and initial_std (nx,): what is known of the state at the start; std inf = nothing, 0 = exactly.
    clock: the model's time t when this horizon's time is zero [s].
    """

    mesh: Mesh
    time: Array
    inputs: Array
    target: Array
    target_std: Array
    initial: Array
    initial_std: Array
    clock: float = 0.0
    hold: Literal["zero", "linear"] = "zero"
    drive_time: Array | None = None

    def __post_init__(self) -> None:
        for name, n in (("inputs", len(self.changes)), ("target", len(self.time)), ("target_std", len(self.time))):
            if getattr(self, name).shape[0] != n:
                raise ValueError(f"Horizon({name}=...) needs one row per sample: got {getattr(self, name).shape[0]} for {n} times.")
        if self.mesh.knots[0] > self.time[0] or self.mesh.knots[-1] < self.time[-1]:
            raise ValueError("Horizon(mesh=...) must span the samples.")

    @property
    def changes(self) -> Array:
        """Times at which the inputs change [s], (m,)."""
        return self.time if self.drive_time is None else self.drive_time

    @property
    def breaks(self) -> Array:
        """The samples and the changes of the inputs, in order [s]."""
        return self.time if self.drive_time is None else np.union1d(self.time, self.drive_time)

    def input_at(self, times: Array) -> Array:
        """The held input at any times, shape (nu, M)."""
        if self.hold == "linear":
            return np.array([np.interp(times, self.changes, column) for column in self.inputs.T]).reshape(-1, len(times))
        row = np.clip(np.searchsorted(self.changes, times, side="right") - 1, 0, len(self.changes) - 1)
        return self.inputs[row].T

    def projected_input(self, degree: int, tau: Array) -> Array:
        """The held input's least-squares polynomial of degree - 1 on every interval, at the places tau; shape (nu, N * len(tau)).

        A scheme that looks at the input in a few places only would miss what it does between them; its projection has the
        same moments, hence the same effect on the motion at the knots.
        """
        points = quadrature(self.mesh, self.breaks, gauss(degree))
        moments = self._input_moments(points, degree)
        return (moments @ legendre(degree, tau)).reshape(moments.shape[0], self.mesh.count * len(tau))

    def unresolved_input(self, degree: int) -> Array:
        """The held input less its projection on every interval, at the samples; (nu, n)."""
        return self._unresolved_at(self.time, degree)

    def _unresolved_at(self, times: Array, degree: int) -> Array:
        interval, tau = self.mesh.locate(times)
        moments = self._input_moments(quadrature(self.mesh, self.breaks, gauss(degree)), degree)
        return np.asarray(self.input_at(times) - np.einsum("ink,kn->in", moments[:, interval], legendre(degree, tau)))

    def unresolved_step(self, degree: int) -> Array:
        """Largest of these values in every interval, where the input changes too; (nu, N)."""
        times = self.breaks[(self.breaks >= self.mesh.knots[0]) & (self.breaks <= self.mesh.knots[-1])]
        size, owner = np.abs(self._unresolved_at(times, degree)), self.mesh.locate(times)[0]
        out = np.zeros((len(size), self.mesh.count))
        for row, values in zip(out, size, strict=True):
            np.maximum.at(row, owner, values)
        return out

    def unresolved_impulse(self, degree: int) -> Array:
        """Largest time integral, within every interval, of what the held input differs from its projection; (nu, N) [unit * s].

        It is what the projection leaves out of the motion between two knots: zero for an input that is a polynomial of degree - 1 there.
        """
        first, _, owner, _ = self._unresolved(degree)
        start = np.searchsorted(owner, np.arange(self.mesh.count))
        return np.maximum.reduceat(np.abs(first), start, axis=1)

    def unresolved_integrals(self, degree: int) -> tuple[Array, Array]:
        """First and second time integral, since the last knot, of input minus projection, at the samples; each (nu, n)."""
        first, second, _, ends = self._unresolved(degree)
        cell = np.searchsorted(ends, self.time - 1e-9 * self.mesh.steps.min())
        there = (cell < len(ends)) & (np.abs(ends[np.minimum(cell, len(ends) - 1)] - self.time) < 1e-9 * self.mesh.steps.min())
        at_knot = np.isin(self.time, self.mesh.knots)
        use = there & ~at_knot
        cell = np.minimum(cell, len(ends) - 1)
        return np.where(use, first[:, cell], 0.0), np.where(use, second[:, cell], 0.0)

    def _unresolved(self, degree: int) -> tuple[Array, Array, NDArray[np.int64], Array]:
        """Integrals since the last knot at the end of every quadrature cell, the cells' intervals and their ends."""
        points = quadrature(self.mesh, self.breaks, gauss(degree))
        moments = self._input_moments(points, degree)
        projected = np.einsum("ink,kn->in", moments[:, points.interval], legendre(degree, points.tau))
        rest = (self.input_at(points.time) - projected) * points.weight
        width = points.weight.reshape(-1, degree).sum(axis=1)
        owner = points.interval[::degree]
        first_of = np.searchsorted(owner, np.arange(self.mesh.count))
        ends = self.mesh.knots[owner] + np.cumsum(width) - np.concatenate([[0.0], np.cumsum(width)])[first_of][owner]

        def since_knot(cells: Array) -> Array:
            running = np.concatenate([np.zeros((cells.shape[0], 1)), np.cumsum(cells, axis=1)], axis=1)
            return np.asarray(running[:, 1:] - running[:, first_of[owner]])

        def sums(values: Array) -> Array:
            return np.asarray(values.reshape(values.shape[0], values.shape[1] // degree, degree).sum(axis=2))

        first = since_knot(sums(rest))
        before = first - sums(rest)
        second = since_knot(before * width + sums(rest * (np.repeat(ends, degree) - points.time)))
        return first, second, owner, ends

    def _input_moments(self, points: Quadrature, degree: int) -> Array:
        """Coefficients of the input in the Legendre polynomials of every interval, (nu, N, degree)."""
        u = self.input_at(points.time) * points.weight
        moments = np.empty((u.shape[0], self.mesh.count, degree))
        for j, L in enumerate(legendre(degree, points.tau)):
            for i, row in enumerate(u):
                moments[i, :, j] = np.bincount(points.interval, weights=row * L, minlength=self.mesh.count) / self.mesh.steps
        return moments

    def point_data(self, degree: int, tau: Array) -> Array:
        """[u; t] at the places tau of every interval, the input projected; shape (nu + 1, N * len(tau))."""
        times = self.mesh.knots[:-1, None] + self.mesh.steps[:, None] * tau
        return np.vstack([self.projected_input(degree, tau), self.clock + times.ravel()])

    def split_at_steps(self, intervals: NDArray[np.bool_]) -> Horizon:
        """A knot at the largest step of the input inside each of these intervals (N,), relative to each input's own range."""
        size = np.ptp(self.inputs, axis=0)
        jump = np.max(np.abs(np.diff(self.inputs, axis=0)) / np.where(size > 0, size, 1.0), axis=1, initial=0.0)
        at, owner = self.changes[1:], self.mesh.locate(self.changes[1:])[0]
        first = at > self.mesh.knots[owner] + 1e-9 * self.mesh.steps[owner]
        inside = first & (at < self.mesh.knots[-1]) & intervals[owner] & (jump > 0)
        order = np.lexsort((-jump[inside], owner[inside]))
        chosen = at[inside][order][np.unique(owner[inside][order], return_index=True)[1]]
        return replace(self, mesh=Mesh(np.union1d(self.mesh.knots, chosen)))
