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

PARTS = 20  # of a record, by which its doubt is told


@dataclass(frozen=True, kw_only=True)
class Worth:
    """Log evidence of a model [nats], -inf where there is none, and the solution that has it."""

    nats: float
    solution: Solution | None

    def over(self, other: Worth) -> float:
        """By how many nats this model is more probable than another one of the same samples; -inf where it has no evidence."""
        if not np.isfinite(self.nats):
            return -np.inf
        rests = self._shared_rests(other)
        if not np.any(rests) or not np.isfinite(other.nats) or len(self._densities) != len(other._densities):
            return self.nats - other.nats
        return self.nats - other.nats - float(np.sum((self._densities - other._densities)[rests]))

    def doubt(self, other: Worth) -> float:
        """Standard deviation of that [nats], by how it is spread over the record; 0 where nobody can tell.

        Of sums over parts of the record, long beside any correlation: where residuals are not white, a model that follows some of them
        gains here and loses there (Q. H. Vuong, Econometrica 57, 1989, for single samples).
        """
        if not len(self._densities) or len(self._densities) != len(other._densities):
            return 0.0
        more = self._densities - other._densities
        rests = self._shared_rests(other)
        sums = [float(np.sum(part)) for part in np.array_split(np.where(rests, 0.0, more) if np.any(rests) else more, PARTS)]
        return float(np.std(sums, ddof=1) * np.sqrt(PARTS))

    def _shared_rests(self, other: Worth) -> NDArray[np.bool_]:
        """Samples that count for neither, (n,) where there are any."""
        shared = self.rests.keys() & other.rests.keys()
        return np.any([self.rests[p] | other.rests[p] for p in shared], axis=0) if shared else np.zeros(0, dtype=np.bool_)

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
