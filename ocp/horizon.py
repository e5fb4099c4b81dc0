"""One stretch of time with its held inputs and the samples that the outputs should follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .mesh import Mesh, quadrature
from .polynomials import Array, gauss, legendre


@dataclass(frozen=True, kw_only=True)
class Horizon:
    """Samples of one stretch and the mesh over it.

    time (n,) [s]; inputs (n, nu): row k acts from time k to k + 1 (hold "zero") or joins row k + 1 by a straight line ("linear").
    target (n, ny): what output k should be at time k, with its standard deviation `target_std` (n, ny); NaN where nothing was sampled.
    initial (nx,) and initial_std (nx,): what is known of the state at the start; std inf = nothing, 0 = exactly.
    """

    mesh: Mesh
    time: Array
    inputs: Array
    target: Array
    target_std: Array
    initial: Array
    initial_std: Array
    hold: Literal["zero", "linear"] = "zero"

    def __post_init__(self) -> None:
        n = len(self.time)
        for name in ("inputs", "target", "target_std"):
            if getattr(self, name).shape[0] != n:
                raise ValueError(f"Horizon({name}=...) needs one row per sample: got {getattr(self, name).shape[0]} for {n} times.")
        if self.mesh.knots[0] > self.time[0] or self.mesh.knots[-1] < self.time[-1]:
            raise ValueError("Horizon(mesh=...) must span the samples.")

    def input_at(self, times: Array) -> Array:
        """The held input at any times, shape (nu, M)."""
        if self.hold == "linear":
            return np.array([np.interp(times, self.time, column) for column in self.inputs.T]).reshape(-1, len(times))
        row = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 1)
        return self.inputs[row].T

    def projected_input(self, degree: int, tau: Array) -> Array:
        """The held input's least-squares polynomial of degree - 1 on every interval, at the places tau; shape (nu, N * len(tau)).

        A scheme that looks at the input in a few places only would miss what it does between them; its projection has the
        same moments, hence the same effect on the motion.
        """
        points = quadrature(self.mesh, self.time, gauss(degree))
        N = self.mesh.count
        u = self.input_at(points.time) * points.weight
        moments = np.empty((u.shape[0], N, degree))
        for j, L in enumerate(legendre(degree, points.tau)):
            for i, row in enumerate(u):
                moments[i, :, j] = np.bincount(points.interval, weights=row * L, minlength=N) / self.mesh.steps
        return (moments @ legendre(degree, tau)).reshape(u.shape[0], N * len(tau))

    def point_data(self, degree: int, tau: Array) -> Array:
        """[u; t] at the places tau of every interval, the input projected; shape (nu + 1, N * len(tau))."""
        times = self.mesh.knots[:-1, None] + self.mesh.steps[:, None] * tau
        return np.vstack([self.projected_input(degree, tau), times.ravel()])
