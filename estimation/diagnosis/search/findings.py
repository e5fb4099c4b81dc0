"""What a search says of a fit that it keeps: what it is, how strong, what else it could be; and one word for all of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from backsight.models import Dae
from backsight.models.analysis.isolability import isolability, telling

from ...problem import Problem
from ...results import ParameterEstimate, Smoothing
from ..answer.verdict import EVERYWHERE, Class, Explanation, Finding, Key, Strength, Tried
from ..answer.words import UNKNOWN
from ..candidates.candidate import Candidate
from ..evidence.offsets import PREFIX
from ..scores.onsets import onset
from ..scores.score import Linearised
from ..scores.screen import SURE, Screen, Screened
from ..scores.separation import measurable, separating
from ..scores.shares import Sizes
from .choice import LATE, RIVAL, SAME, beyond, evened, sound
from .described import described
from .refit import Fitted

AS_MUCH = 0.9  # of the gain of the best by its score: a fit that did not come to rest says nothing against what explains as much by its own
FAR = 2.0  # times the gain of a score
SENSORS = 3  # that are named of those that would tell where an unknown force acts

Judged = tuple[Candidate, Screened | None, Fitted]

CLASSES: dict[str, Class] = {"parameter": "parameter", "sensor": "sensor", "actuator": "input"}


def explained(c: Candidate, result: Smoothing | None, gap: float = 0.0) -> Explanation:
    """A candidate with the numbers that it has in a result; how sure they are where it came to rest. gap: nats short of the one chosen."""
    strengths = dict[str, Strength]()
    if result is not None:
        for word, p in _numbers(c, result).items():
            sure = p.std if result.solver.converged else None
            strengths[word] = Strength(value=p.value, std=sure, unit=c.said(p.unit, result.units))
    return Explanation(
        place=c.place,
        family=c.family,
        physics=c.physics,
        subject=c.subject,
        given=c.stated,
        changes=bool(c.changes),
        gap=gap,
        parameters=strengths,
    )


def _numbers(c: Candidate, result: Smoothing) -> dict[str, ParameterEstimate]:
    """Word -> what a result has of it, of all that a candidate says in numbers, with what came free once it was kept.

    What changes little by little at next to no rate is a ramp, and that is no number of it.
    """
    slowest = {change.rate: 2.0 * c.start[change.rate][1] for change in c.changes if change.rate in c.start}
    ramps = {name for name, least in slowest.items() if name in result.parameters and result.parameters[name].value < least}
    found = {word: result.parameters[path] for word, path in c.named.items() if path in result.parameters and path not in ramps}
    later = {path.rpartition(".")[2]: result.parameters[path] for path in c.later if path in result.parameters}
    return found | {word: p for word, p in later.items() if not p.fixed}


def finding(
    base: Linearised,
    best: Judged,
    fits: Sequence[Judged],
    found: Screen,
    sizes: Sizes,
    same: Sequence[Candidate] = (),
    as_good: Sequence[Candidate] = (),
    refused: Collection[Key] = (),
) -> Finding:
    """The best of the fits of a round, with those that cannot be told from it and those that can.

    same: some that could not be told beside it; as_good: some whose fits are. None with which more effects are needed. refused: keys of
    those against whose fits something speaks, which explain nothing in its place.
    """
    c, s, f = best
    rivals, others, near = list[Explanation](), list[Explanation](), list[Screened | None]()
    for d, there, g in fits:
        if d.key == c.key:
            continue
        gap, as_many = f.ends_with - g.ends_with, g.beside <= f.beside and (d.size <= c.size or g.ends_with > f.ends_with)
        if d.changes and not c.changes:
            others += [explained(d, g.result, gap)] if gap > RIVAL else []  # what acts from then on says it as physics
        elif _left_open(best, (d, there, g)):
            rivals.append(explained(d, None))
            near.append(there)
        elif d in same or (as_many and sound(d, g) and (d in as_good or (gap < RIVAL and d.key not in refused))):
            rivals.append(explained(d, g.result, max(gap, 0.0) if d in same else gap))
            near.append(None if d in same else there)
        elif np.isfinite(gap):
            others.append(explained(d, g.result, gap))
    if s is not None:
        told = {c.key} | {r.key for r in rivals + others}
        alike = [o for o in found.found if o.candidate.key not in told and found.alike(s, o) > SAME and not beyond(o)]
        alike = [o for o in alike if c.changes or not o.candidate.changes]
        rivals += [explained(o.candidate, None) for o in alike]
        near += alike
    began = c.onset if s is None else onset(base, s)
    return Finding(
        explanation=explained(c, f.result),
        p_value=math.nan if s is None else _chance(found, s, f),
        gain=float(f.gain),
        change=_change(c, f.result),
        share=max(sizes.shares(s.look, s.estimate).values(), default=0.0) if s is not None else None,
        regime=EVERYWHERE if began is not None else _regime(c, s, sizes),
        onset=began,
        until=c.until,
        alternatives=tuple(sorted(others, key=lambda e: e.gap)),
        rivals=tuple(rivals),
        separates=_separates(base, best, near),
    )


def _regime(c: Candidate, s: Screened | None, sizes: Sizes) -> str:
    """Where it acts; of what changes little by little until when."""
    gradual = next((change.until for change in c.changes if change.gradual), None)
    if gradual is not None:
        return f"little by little until {gradual:.4g} s"
    return EVERYWHERE if s is None or c.signals else sizes.regime(s.look, s.estimate)


def _chance(found: Screen, s: Screened, f: Fitted) -> float:
    """Of its score; NaN where that says nothing against chance and the fit gained far more: there a straight line tells of neither."""
    chance = found.chance.of(s.worth)
    return math.nan if chance > SURE and f.gain > FAR * s.gain else chance


def _left_open(best: Judged, other: Judged) -> bool:
    """Whether nothing speaks against another candidate: its fit did not come to rest, and by the scores it explains as much.

    Not where the best one's fit gained far more than that score; but a lag and a delay of one signal are nearly the same.
    """
    (c, s, f), (d, there, g) = best, other
    if s is None or there is None or np.isfinite(g.gain):
        return False
    near = c.place == d.place and {c.physics, d.physics} <= {*LATE}
    return d.size <= c.size and there.gain >= AS_MUCH * s.gain and (near or not f.gain > FAR * there.gain)


def fitted_strengths(c: Candidate, result: Smoothing) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """What a fit made of a candidate's strengths, less what they are without it; of one with a phase those of its sine and cosine.

    What is looked at as a signal is there as a whole: one; or as much as it has grown.
    """
    if c.signals:
        return np.array([result.parameters[n].value for n in c.grows[:1]] or [1.0])
    strengths = np.array([result.parameters[n].value - c.neutral(n) for n in c.strengths])
    if c.quadrature:
        phase = result.parameters[c.quadrature].value
        strengths = strengths[0] * np.array([np.cos(phase), np.sin(phase)])
    return strengths


def _separates(base: Linearised, best: Judged, near: Sequence[Screened | None]) -> str:
    """What would tell the best from its rivals, where all have a score that tells it: equal ones may be apart by a crooked way alone."""
    c, s, f = best
    rivals = [o for o in near if o is not None]
    if s is None or f.result is None or len(rivals) < len(near):
        return ""
    states = measurable(base.solution.transcription.dae)
    return separating(base, s, rivals, states, None if c.all_shape else fitted_strengths(c, f.result))


def renewed(old: Finding, c: Candidate, result: Smoothing, sizes: Sizes) -> Finding:
    """A finding with the numbers that it has in a result, and the name that goes with these."""
    named = replace(old.explanation, physics=c.physics, parameters=explained(c, result).parameters)
    now = evened(named, c, result, sizes.forces.get(c.place, 0.0))
    rivals = tuple(r for r in old.rivals if r.key != now.key)
    there = old.regime if now.physics == old.explanation.physics else EVERYWHERE
    return replace(
        old,
        explanation=now,
        rivals=rivals,
        separates=old.separates if rivals == old.rivals else "",
        regime=there,
        change=_change(c, result),
    )


def nameless(place: str, share: float, result: Smoothing, tried: Sequence[Tried], problem: Problem) -> Finding:
    """What is left over at a place, matters, and is nothing of the library; it may be wherever no outputs tell it from there.

    Of a body with several balances it is told by the name of the one where it is.
    """
    left, (owner, balance) = result.residual_places[place], _balance(place)
    rms = Strength(value=left.rms, std=None, unit=left.unit)
    others, separates = _elsewhere(problem.dae, place, [tuple(r.outputs) for r in problem.recordings])
    owners = [name for name in dict.fromkeys(_balance(other)[0] for other in others) if name != owner]
    return Finding(
        explanation=_unknown(owner, {balance or "rms": rms}),
        p_value=math.nan,
        gain=0.0,
        change="",
        share=share,
        alternatives=tuple(t.explanation for t in tried[:3]),
        rivals=tuple(_unknown(name, {}) for name in owners),
        separates=separates,
        described=described(result, place),
    )


def _balance(place: str) -> tuple[str, str]:
    """The component of a place, and which of its balances that is, if it has several: body.tau_x -> body, tau_x."""
    if ":" in place:
        return place, ""
    owner, _, balance = place.partition(".")
    return owner, balance


def _elsewhere(dae: Dae, place: str, measured: Sequence[Collection[str]]) -> tuple[list[str], str]:
    """What may be wrong instead of a place, and sensors that would tell. measured: outputs of every recording."""
    measured = list(dict.fromkeys(tuple(sorted(outputs)) for outputs in measured))
    kinds = [isolability(dae, outputs) for outputs in measured]
    showing = [kind for kind in kinds if place in kind.faults and place not in kind.unseen]
    if not showing:
        return [], ""
    others = [name for name in showing[0].alike(place) if all(name in kind.alike(place) for kind in showing)]
    inside = [name for name in others if ":" not in name]
    sensors = telling(dae, place, inside, measured, measurable(dae))[:SENSORS] if inside else []
    return others, f"a sensor of {' or '.join(sensors)}" if sensors else "more than one sensor more" if inside else ""


def _unknown(place: str, parameters: Mapping[str, Strength]) -> Explanation:
    return Explanation(place=place, family="unknown", physics=UNKNOWN, parameters=parameters)


def ranked(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """A force without a name first, then what has the most evidence: a small effect may have been found before a large one."""
    return tuple(sorted(findings, key=lambda f: (f.explanation.physics != UNKNOWN, -np.nan_to_num(f.gain, nan=np.inf))))


def verdict(findings: Sequence[Finding]) -> Class:
    """One word for what was found, which is that for the first of them, ranked."""
    if not findings:
        return "none"
    first = ranked(findings)[0]
    if first.explanation.physics == UNKNOWN:
        return "unknown_physics"
    if first.explanation.family == "parameter":
        return "parameter"  # what explains as much by more is no reason to doubt a number that was given
    # what the study says is nothing was doubted before numbers of the model that nobody gave
    rivals = (r for r in first.rivals if not first.explanation.given or r.family != "parameter" or r.given)
    kinds = {CLASSES.get(one.family, "missing_physics") for one in (first.explanation, *rivals)}
    return kinds.pop() if len(kinds) == 1 else "undecided"


def _change(c: Candidate, result: Smoothing | None) -> str:
    told = {} if result is None else _numbers(c, result)
    said = [*(edit.words for edit in c.edits), *(f"{p.name} = {p.value:.6g}" for p in told.values())]
    there = c.absorbs if result is None else result.parameters
    return "; ".join([*said, *(f"{name} = 0" for name, by in c.absorbs.items() if by and name in there and not name.startswith(PREFIX))])
