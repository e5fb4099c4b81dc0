"""What comes late, beside its fit: the same signal as late in the other way, and signals of which no score tells that they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...results import Smoothing
from ..candidates.candidate import Candidate
from ..scores.screen import Screen, Screened
from ..scores.shares import FLOOR, left_over
from .choice import CLEAR, LATE, MOST
from .findings import AS_MUCH, Judged
from .refit import Fitted

HALF = 0.7  # of what is left over: half of its squares


def late_as_another(fitted: Sequence[Judged]) -> list[tuple[Screened, Smoothing]]:
    """A lag where a delay of the same signal gained more, or the other way round, as late as that is, and where that came to rest.

    By itself either may end in another valley.
    """
    found = list[tuple[Screened, Smoothing]]()
    late = [(c, s, f) for c, s, f in fitted if c.physics in LATE and s is not None]
    for c, s, f in late:
        others = [o for o in late if o[0].place == c.place and o[0].physics != c.physics and o[2].gain > max(f.gain, 0.0) + CLEAR]
        best = max(others, key=lambda o: o[2].gain, default=None)
        if s is None or best is None or (there := best[2].whole) is None:
            continue
        (own,), (path,) = c.named.values(), best[0].named.values()
        _, low, high = c.start[own]
        as_late = {own: float(np.clip(there.parameters[path].value, low, high))}
        found.append((replace(s, look=replace(s.look, shape=as_late), origin=s.origin or s), there))
    return found


def late_unheard(fitted: Sequence[Judged], candidates: Sequence[Candidate], found: Screen, before: float) -> list[Candidate]:
    """Delays on the other side of the machine where something late has the best score, or nearly, and falls short of it.

    A model that has bent to a sensor that is late hears nothing of that from its score, and blames the inputs. Where a fit brings what its
    score promised and leaves less than half of what was left over, or any explains what matters, nobody else is asked. before: the largest
    share of the forces at a place that is left over without them.
    """
    most = max((s.gain for _, s, _ in fitted if s is not None), default=0.0)
    heard = [(c, s, f) for c, s, f in fitted if c.physics in LATE and s is not None and s.gain >= AS_MUCH * most]
    late = {c.family for c, _, _ in heard}
    if not late or any(f.gain >= s.gain and _explains(f, HALF * before) for _, s, f in heard if s is not None):
        return []
    if any(_explains(f) for _, _, f in fitted):
        return []
    tried, scores = {c.key for c, _, _ in fitted}, {id(s.candidate): s.gain for s in found.found}
    delays = (c for c in candidates if c.physics in ("input_delay", "sensor_delay") and c.key not in tried)
    return sorted((c for c in delays if c.family not in late), key=lambda c: -scores.get(id(c), 0.0))[:MOST]


def _explains(f: Fitted, least: float = FLOOR) -> bool:
    """Whether a fit gains and leaves no more than that over."""
    if not f.gain > CLEAR or f.problem is None or (whole := f.whole) is None:
        return False
    return not max(left_over(f.problem, whole).values(), default=0.0) > least
