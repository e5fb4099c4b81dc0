"""What a search says of a fit that it keeps: what it is, how strong, what else it could be; and one word for all of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from backsight.models.analysis.isolability import isolability, telling

from ..problem import Problem
from ..results import ResidualSummary, Smoothing
from .candidates import Candidate
from .choice import RIVAL, SAME, evened, sound
from .offsets import PREFIX
from .onsets import onset
from .refit import Fitted
from .score import Linearised
from .screen import Screen, Screened
from .separation import separating
from .shares import Sizes
from .verdict import EVERYWHERE, Class, Explanation, Finding, Strength, Tried

SENSORS = 3  # that are named of those that would tell where an unknown force acts

Judged = tuple[Candidate, Screened | None, Fitted]

CLASSES: dict[str, Class] = {"parameter": "parameter", "sensor": "sensor", "actuator": "input"}


def explained(c: Candidate, result: Smoothing | None, gap: float = 0.0) -> Explanation:
    """A candidate with the numbers that it has in a result. gap: nats that it lacks against the one chosen."""
    strengths = dict[str, Strength]()
    if result is not None:
        for word, path in c.named.items():
            if (p := result.parameters.get(path)) is not None:
                strengths[word] = Strength(value=p.value, std=p.std, unit=c.said(p.unit, result.units))
    return Explanation(place=c.place, family=c.family, physics=c.physics, gap=gap, parameters=strengths)


def finding(
    base: Linearised,
    best: Judged,
    fits: Sequence[Judged],
    found: Screen,
    sizes: Sizes,
    same: Sequence[Candidate] = (),
    states: Collection[str] = (),
) -> Finding:
    """The best of the fits of a round, with those that cannot be told from it and those that can.

    same: some that cannot. states: of the model, of which there may be sensors.
    """
    c, s, f = best
    rivals, others, near = list[Explanation](), list[Explanation](), list[Screened | None]()
    for d, there, g in fits:
        if d.key == c.key:
            continue
        gap = float(f.gain - g.gain)
        if d in same or (gap < RIVAL and sound(d, g) and (d.size <= c.size or gap < 0)):
            rivals.append(explained(d, g.result, max(gap, 0.0) if d in same else gap))
            near.append(there)
        elif np.isfinite(gap):
            others.append(explained(d, g.result, gap))
    if s is not None:
        told = {c.key} | {(r.place, r.physics) for r in rivals + others}
        alike = [o for o in found.found if o.candidate.key not in told and found.alike(s, o) > SAME]
        rivals += [explained(o.candidate, None) for o in alike]
        near += alike
    scored = [o for o in near if o is not None]
    began = c.onset if s is None else onset(base, s)
    return Finding(
        explanation=explained(c, f.result),
        p_value=found.chance(s.worth) if s is not None else math.nan,
        gain=float(f.gain),
        change=_change(c, f.result),
        share=max(sizes.shares(s.look, s.estimate).values(), default=0.0) if s is not None else None,
        regime=EVERYWHERE if s is None or c.signals or began is not None else sizes.regime(s.look, s.estimate),
        onset=began,
        alternatives=tuple(others),
        rivals=tuple(rivals),
        separates=separating(base, s, scored, states) if s is not None and len(scored) == len(near) else "",
    )


def renewed(old: Finding, c: Candidate, result: Smoothing, sizes: Sizes) -> Finding:
    """A finding with the numbers that it has in a result, and the name that goes with these."""
    now = evened(replace(old.explanation, parameters=explained(c, result).parameters), c, result, sizes.forces.get(c.place, 0.0))
    rivals = tuple(r for r in old.rivals if (r.place, r.physics) != (now.place, now.physics))
    there = old.regime if now.physics == old.explanation.physics else EVERYWHERE
    return replace(old, explanation=now, rivals=rivals, separates=old.separates if rivals else "", regime=there, change=_change(c, result))


def nameless(place: str, share: float, left: ResidualSummary, tried: Sequence[Tried], problem: Problem) -> Finding:
    """What is left over at a place, matters, and is nothing of the library; it may be at all places that no output tells from this one."""
    dae, measured = problem.dae, {name for r in problem.recordings for name in r.outputs}
    places = {p.name for p in dae.places}
    others = [name for name in isolability(dae, measured).alike(place) if name in places] if place in places else []
    sensors = telling(dae, place, others, measured)[:SENSORS] if others else []
    rms = Strength(value=left.rms, std=None, unit=left.unit)
    return Finding(
        explanation=_unknown(place, {"rms": rms}),
        p_value=math.nan,
        gain=0.0,
        change="",
        share=share,
        alternatives=tuple(t.explanation for t in tried[:3]),
        rivals=tuple(_unknown(name, {}) for name in others),
        separates=f"a sensor of {' or '.join(sensors)}" if sensors else "",
    )


def _unknown(place: str, parameters: Mapping[str, Strength]) -> Explanation:
    return Explanation(place=place, family="unknown", physics="unknown_physics", parameters=parameters)


def verdict(findings: Sequence[Finding]) -> Class:
    """One word for what was found."""
    if not findings:
        return "none"
    first = findings[0]
    if first.explanation.physics == "unknown_physics":
        return "unknown_physics"
    if first.explanation.family == "parameter":
        return "parameter"  # what explains as much by more is no reason to doubt a number that was given
    kinds = {CLASSES.get(family, "missing_physics") for family in (first.explanation.family, *(r.family for r in first.rivals))}
    return kinds.pop() if len(kinds) == 1 else "undecided"


def _change(c: Candidate, result: Smoothing | None) -> str:
    values = {} if result is None else {p: result.parameters[p].value for p in c.named.values() if p in result.parameters}
    said = [*(edit.words for edit in c.edits), *(f"{name} = {value:.6g}" for name, value in values.items())]
    return "; ".join([*said, *(f"{name} = 0" for name in c.absorbs if not name.startswith(PREFIX))])
