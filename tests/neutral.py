"""Residual and outputs of a plant and of what was made of it, at one random point."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from backsight.models import Dae


class Point:
    """A point of a model: x', x, z, u, w at random, its parameters as they are; told of other models with its states too."""

    def __init__(self, dae: Dae, seed: int = 0, size: float = 0.3) -> None:
        rng = np.random.default_rng(seed)
        self.dae, self.t = dae, 0.7
        self.dx, self.x, self.z, self.u, self.w = (
            size * rng.standard_normal(part.shape[0]) for part in (dae.dx, dae.x, dae.z, dae.u, dae.w)
        )

    def told(self, dae: Dae | None = None, values: Mapping[str, float] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Residual and outputs of a model with the same unknowns."""
        dae = dae or self.dae
        assert [q.name for q in dae.states] == [q.name for q in self.dae.states]
        assert len(dae.algebraics) == len(self.dae.algebraics)
        found = _function(dae)(self.dx, self.x, self.z, self.u, dae.parameter_values(values), self.w, self.t)
        residual, output = (np.asarray(part).ravel() for part in found)
        rows = [(e.component, e.name) for e in dae.equations]  # a model with more in it may have them in another order
        return residual[[rows.index((e.component, e.name)) for e in self.dae.equations]], output


@cache
def _function(dae: Dae) -> Any:
    return dae.function()
