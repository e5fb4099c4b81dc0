"""Which fits nobody could tell from the best one: beside it, what they have would not be told.

Scores at a model that lacks something say how alike effects are there. Of two models that say the same of every sample, a sensor's gain
and a damping that is wrong while the mass is free, they need not be: one bends the motion, the other the forces. But at either's fit the
strength of the other is then known no better than to its size, and their evidences differ by what their meshes do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..candidates.candidate import Candidate
from ..candidates.library import library
from ..scores.score import Linearised
from ..scores.screen import screen
from ..scores.supermodel import looked_at
from .findings import Judged

CLOSE = 0.05  # of the gain of the best: what lacks more is told from it
TOLD = 3.0  # deviations of a strength, of which one at least is that large where the two can be told apart


def indistinct(best: Judged, others: Sequence[Judged]) -> list[Judged]:
    """Those of the other fits that cannot be told beside the best; none that has more strengths than it."""
    c, s, f = best
    if s is None or f.problem is None or f.model is None or f.worth.solution is None or c.onset is not None or c.changes:
        return []
    asked = {
        _name(o[0]): o
        for o in others
        if o[0].key != c.key and o[1] is not None and o[0].size <= c.size and o[0].strengths and f.gain - o[2].gain < CLOSE * f.gain
    }
    if not asked:
        return []
    there = Linearised(f.worth.solution)
    again = [d for d in library(f.problem, f.model, f.worth.solution, brought=set(c.brought)) if _name(d) in asked]
    looks = looked_at(f.problem, f.model, there, again)
    told = {_name(o.candidate): o.std for o in screen(there, looks, draws=0).found}
    offered = {_name(look.candidate) for look in looks}
    return [one for name, one in asked.items() if name in offered and not _stands_out(one, told.get(name))]


def _name(c: Candidate) -> tuple[str, ...]:
    return (*c.key, *c.strengths)


def _stands_out(one: Judged, std: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None) -> bool:
    """Whether strengths as a fit has them would be told with these deviations; with none nothing is."""
    c, _, f = one
    if std is None:
        return False
    if f.result is None or len(std) != len(c.strengths):
        return True
    size = np.array([f.result.parameters[n].value - c.neutral(n) for n in c.strengths])
    return bool(np.any(np.abs(size) > TOLD * std))
