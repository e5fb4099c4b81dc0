"""How large an effect is beside the forces at its place, and how small one could be and still be seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf

import numpy as np

from backsight.models import Model
from backsight.ocp import Solution

from ...problem import Problem
from ...results import Smoothing
from ...smoothing.along import forces
from ...smoothing.begun import followed_by
from ...smoothing.rest import near_rest
from ..answer.regimes import Mask, regime
from ..answer.verdict import EVERYWHERE, Key, Undetectable
from ..evidence.misfit import NEARER, OFF, off
from .acting import Acting
from .score import Linearised
from .screen import SURE, Screen, Screened
from .supermodel import Look

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

FLOOR = 0.01  # of the rms force at a place: what is smaller is nothing that matters
CERTAIN = 3.0  # standard deviations
GROWN = 1.1  # times what was left over before
TINY = 1e-300
NEVER = 1e3  # times the forces at a place: no strength of a force
BEYOND = 3.0  # times the forces at a place: an effect of that size would be needed to be seen, so none can be


class Sizes:
    """Rms forces at the places of a smoothed problem, and of what left-over forces and candidates make of them; how far outputs are off."""

    def __init__(self, problem: Problem, result: Smoothing, base: Linearised) -> None:
        """base: of the result's solution, or where that led (`refit.bared`)."""
        self.base, self.solution, self.result = base, base.solution, result
        self.forces, self.varying = (_forces(problem, self.solution, varying=only) for only in (False, True))
        self.names = list(self.forces)
        self.left, self._problem = _left(result, self.forces), problem

    @property
    def most(self) -> float:
        """The largest share of the forces at a place that is left over."""
        return max(self.left.values(), default=0.0)

    @cached_property
    def off(self) -> float:
        """How far outputs are off (`misfit.py`)."""
        return off(self._problem, self.result)

    @cached_property
    def contradicting(self) -> float:
        """How far those are off that the states cannot tell apart."""
        return off(self._problem, self.result, contradicting=True)

    def shares(self, look: Look, estimate: Array) -> dict[str, float]:
        """Place -> rms force of a candidate at these strengths over that of the forces there but for their means, away from rest."""
        return {name: self._share(name, force, use) for name, force, use in self._acting(look, estimate)}

    def net(self, look: Look, estimate: Array, others: Sequence[Look]) -> float:
        """The largest of its `shares` when others, of one strength each, have taken what they can of its force."""
        beside = [[force for _, force, _ in self._acting(other, np.ones(1))] for other in others]
        most = 0.0
        for k, (name, force, use) in enumerate(self._acting(look, estimate)):
            weight = np.where(use, self.solution.transcription.nlp.steps, 0.0) ** 0.5
            taken = np.column_stack([weight * one[k] for one in beside]) if beside else np.empty((len(force), 0))
            rest = weight * force - taken @ np.linalg.lstsq(taken, weight * force, rcond=None)[0]
            most = max(most, float(np.linalg.norm(rest) / np.linalg.norm(weight)) / self.varying[name])
        return most

    def regime(self, look: Look, estimate: Array) -> str:
        """Where a candidate acts at these strengths, in words, at the place where its force is the largest share."""
        there = max(self._acting(look, estimate), key=lambda acting: self._share(*acting), default=None)
        return EVERYWHERE if there is None else regime(self.solution, *there)

    def _share(self, name: str, force: Array, use: Mask) -> float:
        steps = self.solution.transcription.nlp.steps
        return float(np.sqrt(np.average(force[use] ** 2, weights=steps[use]))) / self.varying[name]

    @cached_property
    def _act(self) -> Acting:
        return Acting.of(self.solution)

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
        return list(zip(self.names, self._act.mean(rows), counts, strict=True))


def leaves_more(problem: Problem, result: Smoothing, before: Sizes) -> bool:
    """Whether a model that has one more effect leaves more over at the worst place than the model did without it, and as much as matters.

    Not where outputs were off and no longer are: what residual forces had no room for is known as forces then. result: with its solution.
    """
    if result.solution is None or (before.off > OFF and off(problem, result) < NEARER * before.off):
        return False
    most = max(left_over(problem, result).values(), default=0.0)
    return most > FLOOR and most > GROWN * before.most


def left_over(problem: Problem, result: Smoothing) -> dict[str, float]:
    """Place -> rms of the residual force away from rest over that of the forces, of a result with its solution; none without one."""
    return {} if result.solution is None else _left(result, _forces(problem, result.solution))


def _forces(problem: Problem, solution: Solution, *, varying: bool = False) -> dict[str, float]:
    """Soft place -> rms force there, what cancels there left out."""
    t = solution.transcription
    found = forces(problem.posed, followed_by(solution), solution.parameters, varying=varying, net=True)
    return {t.dae.places[k].name: found.get(k, inf) for k in t.soft}


def _left(result: Smoothing, there: Mapping[str, float]) -> dict[str, float]:
    """Place -> rms of the residual force away from rest over that of the forces."""
    summaries = result.residual_places
    return {name: summaries[name].rms / force for name, force in there.items() if name in summaries}


def limits(found: Screen, sizes: Sizes, model: Model, skipped: set[Key]) -> list[Undetectable]:
    """Of every candidate that was not found, the least strength that would have been; of those that have a score.

    Of one with shapes at that in the middle, from the one that shows the least strength to those that show none: at its best shape nothing
    may have any strength, since that one fits noise. What parameters can take over wholly is not among them. Sorted by place, bodies before
    sensors and inputs, and physics; of what may act on either side, or in other ways that have one name, the larger strength.
    """
    out, deviations = dict[tuple[str, ...], Undetectable](), max(float(np.sqrt(2.0 * found.chance.needed(SURE))), CERTAIN)
    for s in found.found:
        c = s.candidate
        if c.key in skipped or c.onset is not None or c.changes or not (c.signals or c.strengths):
            continue
        shapes = [replace(one, inflation=s.inflation) for one in found.shapes.get(id(c), (s,))]
        path, strength = _of_signal(shapes, sizes, deviations) if c.all_shape else _of_strength(shapes, sizes, deviations)
        word = next((w for w, p in c.named.items() if p == path), path.rpartition(".")[2])
        unit = c.unit(model, path, sizes.result.units)
        place = sizes.result.residual_places.get(c.place)
        if place is not None and unit == place.unit and strength > NEVER * sizes.forces.get(c.place, inf):
            strength = inf  # a force that acts where the machine never was
        told = Undetectable(place=c.place, physics=c.physics, parameter=word, strength=strength, unit=unit)
        which = (c.place, c.physics, word, unit)
        if which not in out or strength > out[which].strength:
            out[which] = told
    return [out[which] for which in sorted(out, key=lambda which: (":" in which[0], *which))]


def _of_strength(shapes: Sequence[Screened], sizes: Sizes, deviations: float) -> tuple[str, float]:
    """The last strength, and how large it had to be."""
    s = sorted(shapes, key=lambda one: one.std[-1])[len(shapes) // 2]
    c, strength = s.candidate, deviations * float(s.std[-1]) * float(np.sqrt(s.inflation))
    share = max(sizes.shares(s.look, np.eye(len(s.std))[-1]).values(), default=0.0)
    if c.family != "sensor" and share > 0:
        strength = max(strength, FLOOR / share) if strength * share < BEYOND else inf
    elif c.of_reading:
        strength = max(strength, FLOOR)
    return c.grows[0] if c.grows else c.strengths[-1], strength


def _of_signal(shapes: Sequence[Screened], sizes: Sizes, deviations: float) -> tuple[str, float]:
    """The parameter that shapes it, and what that had to be: where an effect of this shape shows, between those that were looked at.

    What is shown by the least of those, of effects that grow with it, would be shown by less as much as it is more than needed.
    """
    (path,) = shapes[0].look.shape
    shows = [_shows(s, sizes, deviations) for s in shapes]
    values = [s.look.shape[path] for s in shapes]
    size, value = (np.log(np.array(a)[np.argsort(values)]) for a in (np.maximum(shows, TINY), values))
    grows = size[-1] > size[0]
    if not grows:
        size, value = size[::-1], value[::-1]
    if not size.max() >= 0:
        return path, inf
    k = int(np.argmax(size >= 0))
    if k == 0:
        return path, float(np.exp(value[0] - size[0] if grows else value[0]))
    return path, float(np.exp(np.interp(0.0, size[k - 1 : k + 1], value[k - 1 : k + 1])))


def _shows(s: Screened, sizes: Sizes, deviations: float) -> float:
    """How much of an effect there is, over what it takes to be shown and to matter."""
    told = 1.0 / (deviations * float(s.std[-1]) * float(np.sqrt(s.inflation)))
    share = max(sizes.shares(s.look, np.ones(1)).values(), default=0.0)
    return told if s.candidate.family == "sensor" or not share > 0 else min(told, share / FLOOR)
