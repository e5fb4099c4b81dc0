"""How much more probable the recordings make one model than another, but for what a rounded sign makes of a rest.

A law with a rounded sign holds a body by letting it creep, and the residual force there has room for as much as the law is strong
(`smoothing/rest.py`). How steep the law is at zero and how wide its room decide what the samples of a rest are worth, nats for every
single one, and neither is physics: of a law within another one, the richer would be thousands of nats less likely. So where two models
both have such room at a place, the samples of the rests that either has there count for neither, by the prediction errors' densities given
all samples before (`validation/innovations.py`). Against a model without, or with a law that holds a body by itself, rests count: that
it stands still is what speaks for friction.

Where both hold a body by the same law and the same room, what they differ in is elsewhere, and a rest tells of it all along: a bit that
sticks for most of a record must not hide what rubs at the other end of the string. A law whose strength is known to one and free in the
other is not the same, nor one that is much weaker beside something else that holds the body, too. There only how they creep before the bit
breaks away is no physics: a few stretches with hundreds of nats, which count for no more than LIMIT times what a stretch of a rest usually
does.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from backsight.models.augmentation.parameters import without_case
from backsight.ocp import Solution

from ...smoothing.rest import rounded_signs, rows_with_room, strengths_at_rest
from ...validation.innovations import innovations

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

PARTS, STRETCHES = 20, 5  # of a record, and of each of them, by which a gain's doubt is told
LIMIT = 3.0  # times the median over the stretches with a rest
STRENGTHS = ("N", "N.m")
ALIKE, AS_STRONG = 0.05, 0.3  # relative difference of widths and rooms that are the same; of strengths that are about the same


@dataclass(frozen=True, kw_only=True)
class Worth:
    """Log evidence of a model [nats], -inf where there is none, and the solution that has it.

    factor: on the deviations of its residual forces, with which it has that evidence (`held.py`).
    """

    nats: float
    solution: Solution | None
    factor: float = 1.0

    def over(self, other: Worth) -> float:
        """By how many nats this model is more probable than another one of the same samples; -inf where it has no evidence."""
        if not np.isfinite(self.nats):
            return -np.inf
        more = self.nats - other.nats
        if not np.isfinite(other.nats) or not self.rests.keys() & other.rests.keys() or not self._comparable(other):
            return more
        return more - float(np.sum(self._densities - other._densities - self._gained(other)))

    def doubt(self, other: Worth) -> float:
        """Standard deviation of that [nats], by how it is spread over the record; inf where nobody can tell.

        Of sums over short stretches about the mean of the stretches beside: where residuals are not white, a model that follows some of
        them gains here and loses there (Q. H. Vuong, Econometrica 57, 1989, for single samples); one that gains in a part of the record,
        where its effect acts, gains all along there.
        """
        if not self._comparable(other) or len(self._densities) < PARTS * STRETCHES:
            return np.inf
        sums = np.array([np.sum(part) for part in _stretches(self._gained(other))]).reshape(PARTS, STRETCHES)
        return float(np.sqrt(STRETCHES * np.sum(np.var(sums, axis=1, ddof=1))))

    def _gained(self, other: Worth) -> Array:
        """By how many nats every sample is likelier, (n,), as far as it counts."""
        more = self._densities - other._densities
        places = self.rests.keys() & other.rests.keys()
        if not places:
            return more
        at_rest = np.any([self.rests[p] | other.rests[p] for p in places], axis=0)
        apart = [self.rests[p] ^ other.rests[p] if self._holds_as(other, p) else self.rests[p] | other.rests[p] for p in places]
        more = np.where(np.any(apart, axis=0), 0.0, more)
        sums = np.array([np.sum(part) for part in _stretches(np.where(at_rest, more, 0.0))])
        most = LIMIT * float(np.median(np.abs(sums[sums != 0]))) if np.any(sums) else 0.0
        share = np.minimum(1.0, np.divide(most, np.abs(sums), out=np.ones(len(sums)), where=sums != 0))
        of_each = np.repeat(share, [len(part) for part in _stretches(more)])
        return np.where(at_rest, of_each * more, more)

    def _holds_as(self, other: Worth, place: str) -> bool:
        """Whether two models hold a body by the same law, known or unknown alike, and have the same room beside it."""
        (own, room), (those, as_much) = self._at_rest(place), other._at_rest(place)
        same = own.keys() == those.keys() and all(_alike(own[name], those[name]) for name in own) and _alike(room, as_much)
        one, two = self._unknown(own), other._unknown(own)
        return same and one.keys() == two.keys() and _alike(sum(one.values()), sum(two.values()), AS_STRONG)

    def _at_rest(self, place: str) -> tuple[Mapping[str, float], float]:
        """The rounded signs at a place, and the strength for which there is room."""
        signs, rooms = self._holding
        return signs.get(place, {}), rooms.get(place, 0.0)

    def _unknown(self, signs: Collection[str]) -> dict[str, float]:
        """The free strengths of laws, by the widths of their signs, and their sizes [N or N m]."""
        if self.solution is None:
            return {}
        t, laws = self.solution.transcription, {name.rpartition(".")[0] for name in signs}
        free = [(p, abs(float(self.solution.parameters[i]))) for i in t.nlp.free if (p := t.dae.parameters[i]).unit in STRENGTHS]
        return {p.name: size for p, size in free if without_case(p.name).rpartition(".")[0] in laws}

    @cached_property
    def _holding(self) -> tuple[Mapping[str, Mapping[str, float]], Mapping[str, float]]:
        """The same of all places."""
        return ({}, {}) if self.solution is None else (rounded_signs(self.solution), strengths_at_rest(self.solution))

    def _comparable(self, other: Worth) -> bool:
        """Whether both have densities, of the same samples."""
        return len(self._densities) == len(other._densities) > 0

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
        if self.solution is None:
            return np.empty(0)
        factors = None if self.factor == 1.0 else np.full(len(self.solution.transcription.soft), self.factor)
        found = innovations(self.solution, factors)
        return np.empty(0) if found is None else np.concatenate([run.log_densities.sum(axis=1) for run in found.horizons])


def _stretches(values: Array) -> list[Array]:
    return np.array_split(values, PARTS * STRETCHES)


def _alike(one: float, other: float, within: float = ALIKE) -> bool:
    return abs(one - other) <= within * max(abs(one), abs(other))


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
