"""Inputs that drop out: a speed that is recorded as nothing while its counter misses the marks.

For as long as that lasts the model is driven by what was not, and whatever it lacks would be blamed. Where stretches of inputs look so the
model is smoothed with what was likely there, too, and the evidence decides: a pulse that somebody meant moved the machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backsight.models.errors import InputError

from ...problem import Problem
from ...recordings.dropouts import bridged, dropped_out, stretches
from ...recordings.recording import Recording
from ...smoothing.begun import Begun
from ...smoothing.smoother import smoothing
from ..answer.verdict import Explanation, Finding, Strength
from ..search.choice import CLEAR
from ..search.refit import FAILURES, settled, worth_of
from .as_it_is import AsItIs

DROPOUT = "input_dropout"
ASKED = 60.0  # s, that the first look may take
TOLD = 3  # stretches that are named


@dataclass(frozen=True, kw_only=True)
class Torn:
    """Inputs that drop out. before: the model as it is with them as they were recorded, None where that came to no end.

    gains: input -> nats that what was likely there brings, nan where nobody can say.
    """

    problem: Problem
    before: AsItIs | None
    gains: dict[str, float]

    def mended(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with what was likely there."""
        return [bridged(r, self.gains) for r in recordings]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One for every input."""
        return tuple(_finding(self.problem.recordings, name, gain) for name, gain in self.gains.items())


def with_whole_inputs(problem: Problem, based: Callable[[Problem], AsItIs]) -> tuple[Problem, AsItIs, Torn | None]:
    """The problem and the model as it is, with what was likely instead of what drops out of its inputs where that is better.

    Raises InputError as `based` does, where that is no better.
    """
    names = [u for u in problem.recordings[0].inputs if any(r.drive is None and dropped_out(r.inputs[u]).any() for r in problem.recordings)]
    if not names:
        return problem, based(problem), None
    failed: InputError | None = None
    try:
        before = based(problem)
    except InputError as error:
        before, failed = None, error
    if before is not None and not _promising(problem, before, names):
        return problem, before, None
    try:
        whole, there = _over(problem, names, based)
    except FAILURES:
        whole, there = problem, None
    if there is None or not (gain := _more(problem, before, whole, there)) > CLEAR:
        if before is None:
            raise failed or InputError("diagnose: the model as it is could not be smoothed.")
        return problem, before, None
    gains = dict.fromkeys(names, gain)
    for name in names if len(names) > 1 else ():
        others = [other for other in gains if other != name]
        try:
            less, without = _over(problem, others, based)
        except FAILURES:
            continue
        gains[name] = _more(less, without, whole, there)
        if not gains[name] > CLEAR:
            whole, there, gains = less, without, {other: gains[other] for other in others}
    return whole, there, Torn(problem=problem, before=before, gains=gains)


def _over(problem: Problem, names: Sequence[str], based: Callable[[Problem], AsItIs]) -> tuple[Problem, AsItIs]:
    whole = replace(problem, recordings=[bridged(r, names) for r in problem.recordings])
    return whole, based(whole)


def _promising(problem: Problem, before: AsItIs, names: Sequence[str]) -> bool:
    """Whether that makes the model better which begins where it came to rest, as a candidate's fit does; or nobody can say."""
    if (solution := before.result.solution) is None or not before.result.solver.converged:
        return True
    whole = settled(replace(before.problem, recordings=[bridged(r, names) for r in problem.recordings]), before.result)
    try:
        there = smoothing(whole, settings=replace(before.settings, seconds=ASKED), begin=Begun.of(solution, whole))
    except FAILURES:
        return True
    weighed = before.settings.weigh
    return not there.solver.converged or worth_of(whole, there, weighed=weighed).over(worth_of(problem, before.result, weighed=weighed)) > 0


def _more(problem: Problem, one: AsItIs | None, whole: Problem, other: AsItIs) -> float:
    """Nats by which the model is better in the second way; without end where it comes to rest only there."""
    if not other.result.solver.converged:
        return -math.inf
    if one is None or not one.result.solver.converged:
        return math.inf
    if one.settings.weigh is not other.settings.weigh:
        return math.inf if other.settings.weigh else -math.inf
    now, then = (worth_of(p, x.result, weighed=x.settings.weigh) for p, x in ((problem, one), (whole, other)))
    return then.over(now)


def _finding(recordings: Sequence[Recording], name: str, gain: float) -> Finding:
    """What drops out, when, and for how long altogether."""
    spans = list[tuple[float, float]]()
    for r in recordings:
        interval = r.sampling
        spans += [(float(r.time[a]), float(r.time[b]) + interval) for a, b in stretches(dropped_out(r.inputs[name]))]
    several, lasted = len(spans) > 1, sum(end - begin for begin, end in spans)
    said = ", ".join(f"{begin:.4g} to {end:.4g} s" for begin, end in spans[:TOLD]) + (", ..." if len(spans) > TOLD else "")
    return Finding(
        explanation=Explanation(
            place=f"input:{name}",
            family="actuator",
            physics=DROPOUT,
            parameters={"time": Strength(value=lasted, std=None, unit="s")},
        ),
        p_value=math.nan,
        gain=gain if np.isfinite(gain) else 0.0,
        change=f"{len(spans)} stretches of {name} foretold by the others" if several else f"a stretch of {name} foretold by the others",
        regime=f"in {len(spans)} stretches: {said}" if several else f"from {said}",
    )
