"""The mesh: knots in time, chosen for the dynamics and independent of the samples.

An interval may hold many samples, none, or a part of the time between two; whatever is sampled is evaluated on the polynomial.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .polynomials import Array


@dataclass(frozen=True)
class Mesh:
    """Strictly increasing knots [s], shape (N + 1,): N intervals."""

    knots: Array

    def __post_init__(self) -> None:
        knots = np.array(self.knots, dtype=np.float64)
        if knots.ndim != 1 or knots.size < 2 or not np.all(np.isfinite(knots)) or not np.all(np.diff(knots) > 0):
            raise ValueError(f"Mesh(knots=...) needs at least two finite, strictly increasing times; got {knots!r}.")
        knots.flags.writeable = False
        object.__setattr__(self, "knots", knots)

    @property
    def count(self) -> int:
        """Number of intervals N."""
        return self.knots.size - 1

    @property
    def steps(self) -> Array:
        """Length h of every interval [s], shape (N,)."""
        return np.diff(self.knots)

    def locate(self, times: Array) -> tuple[NDArray[np.int64], Array]:
        """Interval of every time and its place tau in [0, 1] there; a knot belongs to the interval that it opens."""
        interval = np.clip(np.searchsorted(self.knots, times, side="right") - 1, 0, self.count - 1)
        return interval, (times - self.knots[interval]) / self.steps[interval]

    def refined(self) -> Mesh:
        """Every interval halved."""
        return Mesh(np.sort(np.concatenate([self.knots, (self.knots[1:] + self.knots[:-1]) / 2])))


def mesh_over(times: Array, step: float) -> Mesh:
    """Knots about `step` apart over the samples, laid on sample times wherever one is near.

    Intervals are between about 0.1 and 1.9 steps long; a gap in the samples is divided evenly.
    """
    span = float(times[-1] - times[0])
    count = max(1, round(span / step))
    ideal = np.linspace(times[0], times[-1], count + 1)
    after = np.clip(np.searchsorted(times, ideal), 1, len(times) - 1)
    nearest = np.where(ideal - times[after - 1] < times[after] - ideal, times[after - 1], times[after])
    knots = np.where(np.abs(nearest - ideal) < 0.45 * span / count, nearest, ideal)
    knots[0], knots[-1] = times[0], times[-1]
    keep = np.concatenate([[True], np.diff(knots) > 1e-6 * span / count])
    return Mesh(knots[keep])


@dataclass(frozen=True, kw_only=True)
class Quadrature:
    """Gauss points on the cells between neighbouring breakpoints (knots and input changes).

    interval (M,), tau (M,) in its interval, time (M,) [s], weight (M,) [s]: sum of weight * f = integral of f over the mesh.
    """

    interval: NDArray[np.int64]
    tau: Array
    time: Array
    weight: Array


def quadrature(mesh: Mesh, breaks: Array, points: tuple[Array, Array]) -> Quadrature:
    """Gauss points of every cell: what is piecewise smooth between the breaks is integrated at full order."""
    tau, weight = points
    inside = breaks[(breaks > mesh.knots[0]) & (breaks < mesh.knots[-1])]
    edges = np.union1d(mesh.knots, inside)
    # A break that coincides with a knot but for rounding must not make a cell of its own.
    tiny = 1e-9 * float(mesh.steps.min())
    short = np.flatnonzero(np.diff(edges) < tiny)
    drop = [i if edges[i] not in mesh.knots else i + 1 for i in short]
    edges = np.delete(edges, drop)
    width = np.diff(edges)
    time = (edges[:-1, None] + width[:, None] * tau).ravel()
    interval, place = mesh.locate(time)
    return Quadrature(interval=interval, tau=place, time=time, weight=(width[:, None] * weight).ravel())
