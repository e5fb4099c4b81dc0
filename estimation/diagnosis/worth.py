"""How much more probable the recordings make one model than another, but for what a rounded sign makes of a rest.

A law with a rounded sign holds a body by letting it creep, and the residual force there has room for as much as the law is strong
(`smoothing/rest.py`). How steep the law is at zero and how wide its room decide what the samples of a rest are worth, nats for every
single one, and neither is physics: of a law within another one, the richer would be thousands of nats less likely. So where two models
both have such room at a place, the samples of the rests that either has there count for neither, by the prediction errors' densities given
all samples before (`validation/innovations.py`). Against a model without, or with a law that holds a body by itself, rests count: that
it stands still is what speaks for friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from backsight.ocp import Solution

from ..smoothing.rest import rows_with_room
from ..validation.innovations import innovations

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Worth:
    """Log evidence of a model [nats], -inf where there is none, and the solution that has it."""

    nats: float
    solution: Solution | None

    def over(self, other: Worth) -> float:
        """By how many nats this model is more probable than another one of the same samples; -inf where it has no evidence."""
        if not np.isfinite(self.nats):
            return -np.inf
        shared = self.rests.keys() & other.rests.keys()
        if not shared or not np.isfinite(other.nats) or len(self._densities) != len(other._densities):
            return self.nats - other.nats
        rests = np.any([self.rests[p] | other.rests[p] for p in shared], axis=0)
        return self.nats - other.nats - float(np.sum((self._densities - other._densities)[rests]))

    @cached_property
    def rests(self) -> Mapping[str, NDArray[np.bool_]]:
        """Place -> which of all samples are in intervals that have room for rest there, of places that have some; (n,)."""
        if self.solution is None:
            return {}
        t = self.solution.transcription
        parts = [rows_with_room(self.solution, number) for number in range(len(t.horizons))]
        found = {t.dae.places[k].name: np.concatenate([part[k] for part in parts]) for k in (parts[0] if parts else ())}
        return {place: rows for place, rows in found.items() if np.any(rows)}

    @cached_property
    def _densities(self) -> Array:
        """Log densities of all samples given those before, (n,); none where there are none."""
        found = None if self.solution is None else innovations(self.solution)
        return np.empty(0) if found is None else np.concatenate([run.log_densities.sum(axis=1) for run in found.horizons])


NONE = Worth(nats=-np.inf, solution=None)


def gains(models: Sequence[tuple[str, tuple[int, int], Worth]], now: Worth) -> list[float]:
    """By how many nats models (their place, how rich they are, their worth) are more probable than the one that they began at.

    Where several have room for rest at a place of their own that this one has not, the richer ones count against the plainest of them,
    and with it.
    """
    out = []
    for place, _, worth in models:
        new = worth.rests.keys() - now.rests.keys()
        alike = [m for m in models if new and m[0] == place and new <= m[2].rests.keys() and np.isfinite(m[2].over(now))]
        plainest = min(alike, key=lambda m: m[1])[2] if alike else worth
        out.append(worth.over(now) if plainest is worth else worth.over(plainest) + plainest.over(now))
    return out
