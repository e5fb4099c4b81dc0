"""In which regime an effect acts: where most of what its force does falls into little of the time.

A regime holds an effect where at least MOST of the squares of its force, and no more than ROOM of the time, lie in it; of several the one
in which the force is the most crowded, "mostly" so where it acts elsewhere too. Friction that is the same wherever the body moves lies
in none.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from backsight.ocp import Solution

from ...smoothing.begun import in_the_middles
from .mismatch import MOTIONS
from .verdict import EVERYWHERE

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = NDArray[np.bool_]

MOST, ROOM = 0.75, 0.6  # of the squares, and of the time
ALL = 0.95  # of the squares: what is elsewhere is nothing
SLOW = 0.2  # of the rms velocity: what is slower turns round
FAST = 0.75  # share of the time below the highest speeds
RANGES = 4  # equal parts of the way that a position goes
WAYS = {"N": "m", "N.m": "rad"}  # unit of what moves under a force of this unit


def regime(solution: Solution, place: str, force: Array, counts: Mask) -> str:
    """Where the force (N,) of an effect at a place acts, in words: one of the intervals' means, of those that count (N,)."""
    weight = solution.transcription.nlp.steps * counts
    squares, best, crowded = weight * force**2, EVERYWHERE, 0.0
    if not squares.sum() > 0:
        return best
    for words, there in _regimes(solution, place, weight):
        most, room = float(squares[there].sum() / squares.sum()), float(weight[there].sum() / weight.sum())
        if most >= MOST and 0 < room <= ROOM and most / room > crowded:
            best, crowded = words if most >= ALL else f"mostly {words}", most / room
    return best


def _regimes(solution: Solution, place: str, weight: Array) -> Iterator[tuple[str, Mask]]:
    """Words, and which of the intervals lie there (N,)."""
    motion = {word: told for word, names in MOTIONS if (told := _along(solution, place, names)) is not None}
    if "velocity" in motion:
        v, unit = motion["velocity"]
        rms = float(np.sqrt(np.average(v**2, weights=weight)))
        yield "at reversals", np.abs(v) < SLOW * rms
        yield "forwards", v > 0
        yield "backwards", v < 0
        order = np.argsort(np.abs(v))
        fast = float(np.abs(v)[order][np.searchsorted(np.cumsum(weight[order]), FAST * weight.sum())])
        yield f"at speeds above {fast:.3g} {unit}/s", np.abs(v) > fast
    if "position" in motion:
        s, unit = motion["position"]
        for low, high in pairwise(np.linspace(s.min(), s.max(), RANGES + 1)):
            yield f"at positions of {low:.3g} .. {high:.3g} {unit}", (s >= low) & (s <= high)


def _along(solution: Solution, place: str, names: tuple[str, ...]) -> tuple[Array, str] | None:
    """A motion of the place in the middles of all intervals, (N,), and its unit; None where nothing moves: v of a motor is a voltage."""
    dae = solution.transcription.dae
    unit = next((WAYS.get(p.unit) for p in dae.places if p.name == place), None)
    own = next((n for n in names if f"{place}.{n}" in dae.variables), None)
    if own is None or unit is None:
        return None
    return in_the_middles(solution, dae.variables[f"{place}.{own}"])[0], unit
