"""Inputs and outputs that drop out: a speed that is recorded as nothing while its counter misses the marks, an encoder that reads zero.

For as long as an input does so the model is driven by what was not; what an output reads then is no sample of anything. Whatever the model
lacks would be blamed for either. Where stretches look so the model is smoothed with what was likely there, or without those samples, too,
and the evidence decides: a pulse that somebody meant moved the machine. What an output reads that drops out may be anything within its
range, and has a likelihood of one over that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backsight.models import Model
from backsight.models.errors import InputError

from ...problem import Problem
from ...recordings.dropouts import Mask, blank, dropped_out, likely, stretches
from ...recordings.recording import Recording
from ...smoothing.begun import Begun
from ...smoothing.smoother import smoothing
from ..answer.verdict import Explanation, Finding, Strength
from ..candidates.library import library
from ..scores.score import Linearised
from ..scores.screen import screen
from ..scores.shares import left_over
from ..scores.supermodel import looked_at
from ..search.choice import CLEAR
from ..search.refit import FAILURES, begun, fitted, settled, worth_of
from .as_it_is import AsItIs, RanAway

INPUT, SENSOR = "input:", "sensor:"
FAMILY = {INPUT: ("actuator", "input_dropout"), SENSOR: ("sensor", "sensor_dropout")}
FITTED = 4  # faults of inputs that are held against it
LESS = 0.5  # of the largest share of the forces at a place that is left over, where evidences say nothing
PLAINLY = 10.0  # nats that each stretch has to bring beside CLEAR
ASKED = 60.0  # s, that the first look may take
TOLD = 3  # stretches that are named


@dataclass(frozen=True, kw_only=True)
class Torn:
    """Signals that drop out. before: the model as it is with them as they were recorded, None where that came to no end.

    gains: place -> nats that it brings to take it so.
    """

    problem: Problem
    before: AsItIs | None
    gains: dict[str, float]

    def mended(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with what was likely there, and without samples of what was not; inputs that are held out stay as they are."""
        sensors = [place for place in self.gains if place.startswith(SENSOR)]
        return [_mended(r, self.gains if r.role == "fit" else sensors) for r in recordings]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One for every signal."""
        return tuple(_finding(self.problem.recordings, place, gain) for place, gain in self.gains.items())


def with_whole_signals(problem: Problem, based: Callable[[Problem], AsItIs]) -> tuple[Problem, AsItIs, Torn | None]:
    """The problem and the model as it is, without what drops out of its signals where that is better.

    Raises InputError as `based` does, where that is no better.
    """
    read = dict.fromkeys(name for r in problem.recordings for name in r.outputs)
    every = [*(INPUT + name for name in problem.recordings[0].inputs), *(SENSOR + name for name in read)]
    places = [place for place in every if any(_rows(r, place).any() for r in problem.recordings)]
    if not places:
        return problem, based(problem), None
    failed: InputError | None = None
    try:
        before = based(problem)
    except RanAway:  # nothing is told beside that
        raise
    except InputError as error:
        before, failed = None, error
    if before is not None and not _promising(problem, before, places):
        return problem, before, None
    try:
        whole, there = _without(problem, places, based)
    except FAILURES:
        whole, there = problem, None
    if there is None or not (gain := _more(problem, before, whole, there) - _price(problem, places)) > _least(problem, places):
        if before is None:
            raise failed or InputError("diagnose: the model as it is could not be smoothed.")
        return problem, before, None
    if before is not None and gain < _otherwise(problem, before, places):
        return problem, before, None
    gains = dict.fromkeys(places, gain)
    for place in places:
        others = [other for other in gains if other != place]
        if not others:
            break
        try:
            less, without = _without(problem, others, based)
        except FAILURES:
            continue
        gains[place] = _more(less, without, whole, there) - _price(problem, [place])
        if not gains[place] > _least(problem, [place]):
            whole, there, gains = less, without, {other: gains[other] for other in others}
    return whole, there, Torn(problem=problem, before=before, gains=gains)


def _otherwise(problem: Problem, before: AsItIs, places: Sequence[str]) -> float:
    """Nats that a fault of these inputs would bring at most, with which nothing drops out: a pulse that acts late was meant."""
    solution, model = before.result.solution, problem.model
    inputs = [place for place in places if place.startswith(INPUT)]
    if solution is None or not isinstance(model, Model) or not inputs:
        return -math.inf
    base, settings = Linearised(solution), replace(before.settings, seconds=ASKED)
    offered = [c for c in library(before.problem, model, solution) if c.place in inputs and c.family == "actuator"]
    found = screen(base, looked_at(before.problem, model, base, offered), draws=0).found
    values = {p.name: p.value for p in before.result.parameters.values()}
    now = worth_of(before.problem, before.result, weighed=before.settings.weigh)
    fits = [fitted(before.problem, model, before.result, s.candidate, begun(s.candidate, s, values), settings) for s in found[:FITTED]]
    return max((f.worth.over(now) for f in fits if f.result is not None), default=-math.inf)


def _rows(recording: Recording, place: str) -> Mask:
    """Rows at which a signal drops out."""
    name, none = place.partition(":")[2], np.zeros(len(recording.time), dtype=bool)
    if place.startswith(INPUT):
        return dropped_out(recording.inputs[name]) if recording.drive is None else none
    y = recording.outputs.get(name)
    return none if y is None else blank(recording.time, y, single=recording.output_loss[name] == "square")


def _mended(recording: Recording, places: Iterable[str]) -> Recording:
    inputs, outputs = dict(recording.inputs), dict(recording.outputs)
    for place in places:
        name = place.partition(":")[2]
        if place.startswith(INPUT):
            inputs[name] = likely(inputs[name]) if recording.drive is None else inputs[name]
        elif name in outputs:
            outputs[name] = np.where(_rows(recording, place), np.nan, outputs[name])
    return replace(recording, inputs=inputs, outputs=outputs)


def _without(problem: Problem, places: Sequence[str], based: Callable[[Problem], AsItIs]) -> tuple[Problem, AsItIs]:
    whole = replace(problem, recordings=[_mended(r, places) for r in problem.recordings])
    return whole, based(whole)


def _price(problem: Problem, places: Sequence[str]) -> float:
    """What it costs that samples may be anything [nats]."""
    total = 0.0
    for r in problem.recordings:
        for place in (place for place in places if place.startswith(SENSOR)):
            rows = _rows(r, place)
            if rows.any():
                total += float(np.count_nonzero(rows) * np.log(np.nanmax(y := r.outputs[place.partition(":")[2]]) - np.nanmin(y)))
    return total


def _least(problem: Problem, places: Sequence[str]) -> float:
    """Nats with less than which it is nothing to speak of."""
    return CLEAR + PLAINLY * sum(len(stretches(_rows(r, place))) for r in problem.recordings for place in places)


def _promising(problem: Problem, before: AsItIs, places: Sequence[str]) -> bool:
    """Whether that makes the model better which begins where it came to rest, as a candidate's fit does; or nobody can say."""
    if (solution := before.result.solution) is None or not before.result.solver.converged:
        return True
    whole = settled(replace(before.problem, recordings=[_mended(r, places) for r in problem.recordings]), before.result)
    try:
        there = smoothing(whole, settings=replace(before.settings, seconds=ASKED), begin=Begun.of(solution, whole))
    except FAILURES:
        return True
    weighed = before.settings.weigh
    more = worth_of(whole, there, weighed=weighed).over(worth_of(problem, before.result, weighed=weighed))
    return not there.solver.converged or more > _price(problem, places)


def _more(problem: Problem, one: AsItIs | None, whole: Problem, other: AsItIs) -> float:
    """Nats by which the model is better in the second way; without end where it comes to rest only there, and leaves far less over."""
    if not other.result.solver.converged:
        return -math.inf
    alike = one is not None and one.result.solver.converged and one.settings.weigh is other.settings.weigh
    if one is None or not alike:
        left = [max(left_over(p, x.result).values(), default=math.inf) for p, x in ((problem, one), (whole, other)) if x is not None]
        return math.inf if len(left) < 2 or left[1] < LESS * left[0] else -math.inf
    now, then = (worth_of(p, x.result, weighed=x.settings.weigh) for p, x in ((problem, one), (whole, other)))
    return then.over(now)


def _finding(recordings: Sequence[Recording], place: str, gain: float) -> Finding:
    """What drops out, when, and for how long altogether."""
    kind, name = INPUT if place.startswith(INPUT) else SENSOR, place.partition(":")[2]
    spans = [(float(r.time[a]), float(r.time[b]) + r.sampling) for r in recordings for a, b in stretches(_rows(r, place))]
    several, lasted, (family, physics) = len(spans) > 1, sum(end - begin for begin, end in spans), FAMILY[kind]
    said = ", ".join(f"{begin:.4g} to {end:.4g} s" for begin, end in spans[:TOLD]) + (", ..." if len(spans) > TOLD else "")
    what = f"{len(spans)} stretches of {name}" if several else f"a stretch of {name}"
    return Finding(
        explanation=Explanation(
            place=place, family=family, physics=physics, parameters={"time": Strength(value=lasted, std=None, unit="s")}
        ),
        p_value=math.nan,
        gain=gain if np.isfinite(gain) else math.nan,
        change=f"{what} foretold by the others" if kind == INPUT else f"{what} left out",
        regime=f"in {len(spans)} stretches: {said}" if several else f"from {said}",
    )
