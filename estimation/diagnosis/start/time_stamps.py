"""Time stamps that are off: at speed a sample is then somewhere else by as much as the machine moves meanwhile.

With one noise for all samples of an output either fast ones pull far too much, and forces follow them, or slow ones tell next to nothing.
Where errors of the model as it is grow with the rate as those of a clock do it is smoothed with a clock that is off by as much, too, and
the evidence decides. A smoother follows some of what is off: it is asked with more until that is no better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...problem import Problem
from ...recordings.recording import Recording
from ...smoothing.clock import off_clock
from ..search.choice import CLEAR
from ..search.refit import FAILURES, worth_of
from .as_it_is import AsItIs

TURNS, LARGER = 8, 1.4  # how often it is asked with a clock that is off by more, and by how much
NOTE = (
    "Time stamps are off by about {off:.2g} s: the faster an output moves, the less a sample counts for ({more:.3g} nats). Say clock_std "
    "in [[recording]] if you know it."
)


def with_clock(
    problem: Problem, first: AsItIs, smoothed: Callable[[Problem], AsItIs]
) -> tuple[Problem, AsItIs, Callable[[Sequence[Recording]], list[Recording]], str]:
    """Problem and model as it is with time stamps that are off, the same for other recordings, and what there is to say."""
    seen = [] if any(r.clock_std for r in problem.recordings) else off_clock(problem, first.result.estimates)
    if not seen or not first.result.solver.converged:
        return problem, first, list, ""
    now, found, off, more, slow = problem, first, 0.0, 0.0, {x.output: x.slow for x in seen}
    for turn in range(TURNS):
        larger = LARGER**turn * float(np.median([x.off for x in seen]))
        posed = replace(problem, recordings=[_off(r, larger, slow) for r in problem.recordings])
        try:
            there = smoothed(posed)
        except FAILURES:
            break
        if not there.result.solver.converged or there.settings.weigh is not first.settings.weigh:
            break
        one, other = (worth_of(p, x.result, weighed=x.settings.weigh) for p, x in ((now, found), (posed, there)))
        if not (gained := other.over(one)) > CLEAR:
            break
        now, found, off, more = posed, there, larger, more + gained

    def same(recordings: Sequence[Recording]) -> list[Recording]:
        return [r if r.clock_std else replace(r, clock_std=off) for r in recordings]

    return now, found, same, NOTE.format(off=off, more=more) if off else ""


def _off(recording: Recording, off: float, slow: dict[str, float]) -> Recording:
    """A recording whose time stamps are off, with the noise that slow samples have where nobody gave any."""
    stds = {name: std if std is not None else slow.get(name) for name, std in recording.output_std.items()}
    return replace(recording, clock_std=off, output_std=stds)
