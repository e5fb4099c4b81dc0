"""How large an effect is beside the forces at its place, and how small one could be and still be seen."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np

from backsight.models import Model
from backsight.ocp import Solution

from ..problem import Problem
from ..results import Smoothing
from ..smoothing.along import forces
from ..smoothing.begun import followed_by
from ..smoothing.rest import near_rest
from .regimes import Mask, regime
from .score import Linearised
from .screen import SURE, Screen, Screened
from .supermodel import Look
from .verdict import EVERYWHERE, Undetectable

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

FLOOR = 0.01  # of the rms force at a place: what is smaller is nothing that matters
CERTAIN = 3.0  # standard deviations
GROWN = 1.1  # times what was left over before
BEYOND = 3.0  # times the forces at a place: an effect of that size would be needed to be seen, so none can be


class Sizes:
    """Rms forces at the places of a smoothed problem, and of what left-over forces and candidates make of them."""

    def __init__(self, problem: Problem, result: Smoothing, base: Linearised) -> None:
        """base: of the result's solution."""
        self.base, self.solution, self.result = base, base.solution, result
        self.forces, self.varying = (_forces(problem, self.solution, varying=only) for only in (False, True))
        self.names = list(self.forces)
        self.left = _left(result, self.forces)

    def shares(self, look: Look, estimate: Array) -> dict[str, float]:
        """Place -> rms force of a candidate at these strengths over that of the forces there but for their means, away from rest."""
        return {name: self._share(name, force, use) for name, force, use in self._acting(look, estimate)}

    def regime(self, look: Look, estimate: Array) -> str:
        """Where a candidate acts at these strengths, in words, at the place where its force is the largest share."""
        there = max(self._acting(look, estimate), key=lambda acting: self._share(*acting), default=None)
        return EVERYWHERE if there is None else regime(self.solution, *there)

    def _share(self, name: str, force: Array, use: Mask) -> float:
        steps = self.solution.transcription.nlp.steps
        return float(np.sqrt(np.average(force[use] ** 2, weights=steps[use]))) / self.varying[name]

    def _acting(self, look: Look, estimate: Array) -> list[tuple[str, Array, Mask]]:
        """Place, force of a candidate there in the mean of every interval (N,), and which of these count: those away from rest, (N,)."""
        t, values = self.solution.transcription, self.solution.values
        moved = look.columns.multiplied @ estimate * self.base.sizes
        first, rows = 0, dict[str, Array]()
        for term, scale in zip(t.nlp.terms, values.scale, strict=True):
            if term.equality or term.heavy:
                rows[term.name] = moved[first : first + term.target.size].reshape(-1, term.target.shape[0]).T / scale
                first += term.target.size
        moving = ~near_rest(t.force_std_at(values))
        counts = [there if there.any() else np.ones_like(there) for there in moving]
        return list(zip(self.names, t.mean_forces(rows), counts, strict=True))


def leaves_more(problem: Problem, result: Smoothing, before: Sizes) -> bool:
    """Whether a model that has one more effect leaves more over at the worst place than the model did without it, and as much as matters.

    result: with its solution.
    """
    if result.solution is None:
        return False
    most = max(_left(result, _forces(problem, result.solution)).values(), default=0.0)
    return most > FLOOR and most > GROWN * max(before.left.values(), default=0.0)


def _forces(problem: Problem, solution: Solution, *, varying: bool = False) -> dict[str, float]:
    """Soft place -> rms force there."""
    t = solution.transcription
    found = forces(problem.posed, followed_by(solution), solution.parameters, varying=varying)
    return {t.dae.places[k].name: found.get(k, inf) for k in t.soft}


def _left(result: Smoothing, there: Mapping[str, float]) -> dict[str, float]:
    """Place -> rms of the residual force away from rest over that of the forces."""
    summaries = result.residual_places
    return {name: summaries[name].rms / force for name, force in there.items() if name in summaries}


def limits(found: Screen, sizes: Sizes, model: Model, skipped: set[tuple[str, str]]) -> list[Undetectable]:
    """Of every candidate that was not found, the least strength that would have been."""
    out = list[Undetectable]()
    least = max(float(np.sqrt(2.0 * found.chance.needed(SURE))), CERTAIN)
    for s in found.found:
        c = s.candidate
        if c.key in skipped or c.signals or not c.strengths or c.onset is not None:
            continue
        out.append(_limit(s, sizes, model, least))
    return out


def _limit(s: Screened, sizes: Sizes, model: Model, least: float) -> Undetectable:
    c = s.candidate
    path = c.strengths[-1]
    strength = least * float(s.std[-1]) * float(np.sqrt(s.inflation))
    one = np.zeros(len(s.std))
    one[-1] = 1.0
    share = max(sizes.shares(s.look, one).values(), default=0.0)
    if c.family != "sensor" and share > 0:
        strength = max(strength, FLOOR / share) if strength * share < BEYOND else inf
    elif c.of_reading:
        strength = max(strength, FLOOR)
    word = next((w for w, p in c.named.items() if p == path), path.rpartition(".")[2])
    return Undetectable(place=c.place, physics=c.physics, parameter=word, strength=strength, unit=c.unit(model, path, sizes.result.units))
