"""What a moving window holds: a trajectory, what is known of its first knot, and how a solve went."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..polynomials import Array


@dataclass(frozen=True, kw_only=True)
class Known:
    """R ([x; p] - reference) + d ~ N(0, I); Rd (n, n + 1) holds both side by side."""

    Rd: Array
    reference: Array

    def about(self, here: Array) -> Array:
        """Rd measured from another place."""
        out = self.Rd.copy()
        out[:, -1] += self.Rd[:, :-1] @ (here - self.reference)
        return out


@dataclass(frozen=True, kw_only=True)
class Solve:
    """What the steps did. size: of the last one; missed: what its linear model missed of the cost; both in deviations."""

    iterations: int
    converged: bool
    size: float
    missed: float


@dataclass(frozen=True)
class Trajectory:
    """States at the knots x (nx, k + 1), inside the intervals inner (interior, k), parameters p (np,)."""

    x: Array
    inner: Array
    p: Array

    @cached_property
    def stages(self) -> Array:
        """Unknowns of all stages, (local + np, k)."""
        return np.concatenate([self.x[:, :-1], self.inner, self.x[:, 1:], self.parameters])

    @cached_property
    def parameters(self) -> Array:
        """p for every stage, (np, k)."""
        out = np.empty((len(self.p), self.inner.shape[1]))
        out[:] = self.p[:, None]
        return out

    def moved(self, step: Trajectory, length: float) -> Trajectory:
        """Some way along a step."""
        return Trajectory(self.x + length * step.x, self.inner + length * step.inner, self.p + length * step.p)
