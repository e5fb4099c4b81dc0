"""Estimated delays of sensors, or of all inputs: where they are expanded is moved to where they are.

An output whose delay is asked for has it as a parameter of the model (`models/augmentation/delay.py`), expanded about a time d_0 by which
the samples were moved back (`recordings/delay.py`): whole intervals of the rows that come most quickly, so that rows stay rows where
time stamps are even. Its derivatives make the estimate exact enough, with a deviation. Inputs that act late are outputs that all lag:
everything is then told on the inputs' clock.

A sample that was moved by d_0 saw the machine d_0 - d later than its row. The series is taken with what acts from that row on, inputs
and residual forces, so it holds from there to the next row: d is sought within the interval that ends at d_0. Elsewhere the acceleration
at a row would be one that the sample cannot have seen, a freedom to explain noise with, the more so the further off. Where d ends on an
edge of its interval, d_0 moves that way, by strides that grow as long as the evidence per sample does and shrink where they went too far.
In the end the samples are moved by d itself, between the rows, so that the estimate hangs on no series; its deviation does.

The first solve may leave its interval by AHEAD of them: on a mesh that is about as coarse it tells well enough where to look. Until d is
within its interval solves are rough ones, and every solve goes on from the best one before it, from its trajectories, weights and
parameters: only the delays are others. Where that leads no further on an edge, solves
from the samples some strides ahead are asked before the search ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from backsight.models.augmentation.delay import INPUTS, delay_name, with_samples_moved
from backsight.models.errors import InputError

from ..problem import Free, Problem
from ..recordings.delay import moved
from ..results import Smoothing
from .begun import Begun

PASSES = 16
FARTHEST = 0.5  # of the shortest recording: a longer delay would cost more samples than it leaves
MARGIN = 0.1  # intervals by which d may leave its interval, so that a delay of whole ones does not go to and fro
GROWTH = 3.0  # of the stride, after one that leads on; where it went too far it shrinks as much
LAST, NEAR = 3, 0.5  # solves about the delays themselves; deviations that they may be from where they are expanded
AROUND = 0.5  # intervals by which d may leave its interval then: the rough solve before it has it less exactly
AHEAD = 5.0  # intervals by which d may leave its interval at first, on a mesh about as coarse, to tell where to look
ON_THE_EDGE = 1e-6  # intervals

Smooth = Callable[[Problem, Begun | None], Smoothing]


def settled(problem: Problem, smooth: Smooth, roughly: Smooth) -> tuple[Problem, Smoothing]:
    """The problem as posed in the end, the samples of delayed outputs moved to about where their delays are expanded, and smoothed.

    smooth: a problem as it is posed, from what was found before, if anything was; roughly: the same, no better than a search for delays
    asks for. Where no expansion was found that holds at the delay it gives, a note of the result says so.
    """
    sought = _sought(problem)
    if not sought:
        return problem, smooth(problem, None)
    interval = min(r.input_sampling for r in problem.fitted)
    farthest = FARTHEST * min(float(r.time[-1] - r.time[0]) for r in problem.fitted) / interval
    guesses = {name: (p.guess if isinstance(p, Free) else p) / interval for name, p in sought.items()}
    for name, guess in guesses.items():
        if abs(guess) > farthest:
            raise InputError(
                f"delay of {_of(name)}: {guess * interval:g} s is more than {FARTHEST:g} of the shortest recording, "
                f"{farthest * interval:g} s; give it in seconds, or leave the recording out."
            )
    search = _Search(asked=problem, sought=sought, interval=interval, farthest=farthest, smooth=smooth, roughly=roughly)
    last = search.best(search.found(search.began(guesses)))
    return last.posed, replace(last.result, notes=(*last.result.notes, *_notes(last.about, sought, interval, search.open(last))))


@dataclass(frozen=True, kw_only=True)
class _Placed:
    """A problem with delays expanded about d_0 [intervals], which they may leave by a margin [intervals], and its result; whether rough."""

    about: dict[str, float]
    posed: Problem
    result: Smoothing
    margin: float = MARGIN
    rough: bool = True

    @property
    def arrived(self) -> bool:
        return _arrived(self.result)


@dataclass(frozen=True, kw_only=True)
class _Search:
    """What stays the same over all solves; interval: [s], farthest: [intervals]. aside: passed by, with delays where they were sought."""

    asked: Problem
    sought: Mapping[str, Free | float]
    interval: float
    farthest: float
    smooth: Smooth
    roughly: Smooth
    aside: list[_Placed] = field(default_factory=list)

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        return {name: _range(p, self.interval) for name, p in self.sought.items()}

    def opened(self, delays: Mapping[str, float]) -> dict[str, float]:
        """d_0 of the intervals in which delays are [intervals]; what is given needs no series."""
        ends = {n: float(np.floor(d)) + 1.0 if isinstance(self.sought[n], Free) else d for n, d in delays.items()}
        far = max(float(np.floor(self.farthest)), 1.0)
        return {
            name: float(np.clip(d, max(low, -far), min(high, far)))
            for (name, d), (low, high) in zip(ends.items(), self.ranges.values(), strict=True)
        }

    def began(self, guesses: Mapping[str, float]) -> _Placed:
        """The interval in which delays are, as seen from that of their guesses, or that one where nothing is seen from there."""
        about = self.opened(guesses)
        if not any(isinstance(p, Free) for p in self.sought.values()):
            about = dict(guesses)
            posed = _posed(self.asked, about, guesses, self.interval)
            return _Placed(about=about, posed=posed, result=self.smooth(posed, None), rough=False)
        posed = _posed(self.asked, about, guesses, self.interval, AHEAD)
        far = _Placed(about=about, posed=posed, result=self.roughly(posed, None), margin=AHEAD)
        if far.arrived:
            seen = self.delays(far)
            near = self.onward(far, self.opened(seen), seen, self.roughly)
        else:
            near = self.anew(about, guesses)
        return near if near.arrived else replace(near, result=self.smooth(near.posed, None), rough=False)

    def found(self, here: _Placed) -> _Placed:
        """Delays expanded about the ends of the intervals in which they are; as near as strides led."""
        tried, stride, growth, way = [here.about], 1.0, GROWTH, dict.fromkeys(self.sought, 0.0)
        for _ in range(PASSES if here.arrived else 0):
            towards = self.edges(here)
            if any(way[name] * side < 0 for name, side in towards.items()):
                stride, growth = max(map(abs, way.values())) / GROWTH, 1.0  # it went too far: back by less than it came
            there = _moved(here.about, towards, stride, self.ranges)
            while stride > 1.0 and (there in tried or max(map(abs, there.values())) > self.farthest):
                stride, growth = stride / GROWTH, 1.0
                there = _moved(here.about, towards, stride, self.ranges)
            if there in tried or max(map(abs, there.values())) > self.farthest:
                break
            tried.append(there)
            other = self.onward(here, there, _midst(there), self.roughly)
            self._seen(other)
            if not _better(other.result, here.result) and stride <= 1.0:
                other = self.beyond(here, towards) or other
                there = other.about
            if _better(other.result, here.result):
                way = {name: there[name] - d for name, d in here.about.items()}
                here, stride = other, stride * growth
            elif stride > 1.0:
                stride, growth = stride / GROWTH, 1.0
            else:
                break
        return here

    def best(self, here: _Placed) -> _Placed:
        """What a search found; where that is on an edge in the end, and so nowhere, what it passed by that is not.

        With gross outliers evidence is no judge: what explains them by more noise loses least.
        """
        last = self.ended(here)
        if not self.open(last) or not self.aside:
            return last
        other = self.aside[0]
        for one in self.aside[1:]:
            other = one if _better(one.result, other.result) else other
        other = self.ended(other)
        return last if self.open(other) else other

    def beyond(self, here: _Placed, towards: Mapping[str, float]) -> _Placed | None:
        """What is better some strides ahead, from the samples themselves, where the next one is not: None where nothing is.

        With gross outliers, and far from the delay, what was carried over is astray, and evidence rises and falls on the way.
        """
        for stride in (GROWTH, GROWTH**2):
            there = _moved(here.about, towards, stride, self.ranges)
            if max(map(abs, there.values())) > self.farthest:
                break
            other = self.anew(there, _midst(there))
            self._seen(other)
            if _better(other.result, here.result):
                return other
        return None

    def _seen(self, there: _Placed) -> None:
        if there.arrived and not self.open(there):
            self.aside.append(there)

    def ended(self, here: _Placed) -> _Placed:
        """The whole about the delays themselves, where nothing is left of the series, if they are where they were sought."""
        if not here.arrived or not (here.rough or self.open(here) or not self.near(here)):
            return here
        for _ in range(LAST if not self.open(here) else 0):
            there = self.delays(here)
            other = self.onward(here, there, there, self.smooth, AROUND)
            if not other.arrived or self.open(other):
                break
            here = replace(other, rough=False)
            if self.near(here):
                break
        return here if not here.rough else replace(self.onward(here, here.about, self.delays(here), self.smooth), rough=False)

    def onward(
        self, here: _Placed, there: dict[str, float], guesses: Mapping[str, float], smooth: Smooth, margin: float = MARGIN
    ) -> _Placed:
        """From a result to delays expanded about others; from the samples themselves where that leads nowhere."""
        posed = _posed(self.asked, there, guesses, self.interval, margin)
        later = (there.get(INPUTS, 0.0) - here.about.get(INPUTS, 0.0)) * self.interval
        anew = {delay_name(name) for name in there}
        begin = None if here.result.solution is None else Begun.going_on(here.result.solution, posed, anew, later)
        result = smooth(posed, begin)
        if begin is not None and not _arrived(result):
            result = smooth(posed, None)
        return _Placed(about=there, posed=posed, result=result, margin=margin)

    def anew(self, there: dict[str, float], guesses: Mapping[str, float]) -> _Placed:
        """Delays expanded about these from the samples themselves."""
        posed = _posed(self.asked, there, guesses, self.interval)
        return _Placed(about=there, posed=posed, result=self.roughly(posed, None))

    def delays(self, here: _Placed) -> dict[str, float]:
        """As they were estimated, or given [intervals]."""
        return {name: here.result.parameters[delay_name(name)].value / self.interval for name in here.about}

    def edges(self, here: _Placed) -> dict[str, float]:
        """Of every delay: 1 where its estimate ended on the late edge of what is believed about d_0, -1 on the early one, 0 in between."""
        rest = {name: d - here.about[name] if isinstance(self.sought[name], Free) else 0.0 for name, d in self.delays(here).items()}
        late, early = here.margin - ON_THE_EDGE, -1.0 - here.margin + ON_THE_EDGE
        return {name: float(r > late) - float(r < early) for name, r in rest.items()}

    def open(self, here: _Placed) -> list[str]:
        """The delays that are not where they are expanded."""
        return [name for name, side in self.edges(here).items() if side]

    def near(self, here: _Placed) -> bool:
        """Whether delays are where they are expanded, as near as the recordings tell."""
        stds = {name: here.result.parameters[delay_name(name)].std for name in here.about}
        return all(
            std is None or abs(self.delays(here)[name] - here.about[name]) * self.interval <= NEAR * std for name, std in stds.items()
        )


def _range(given: Free | float, interval: float) -> tuple[float, float]:
    """Least and largest d_0 [intervals] whose interval has a part within the bounds."""
    if not isinstance(given, Free):
        return -np.inf, np.inf
    return float(np.floor(given.min / interval)) + 1.0, float(np.ceil(given.max / interval))


def _moved(
    about: Mapping[str, float], towards: Mapping[str, float], stride: float, ranges: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """d_0 [intervals] a stride further, of at least one, within the ranges."""
    step = max(float(np.round(stride)), 1.0)
    return {name: float(np.clip(d + step * towards[name], *ranges[name])) for name, d in about.items()}


def _midst(about: Mapping[str, float]) -> dict[str, float]:
    """Where delays start in the intervals that end at these [intervals]."""
    return {name: d - 0.5 for name, d in about.items()}


def delays_of(problem: Problem) -> dict[str, Free | float]:
    """Delayed output, or INPUTS -> its delay, estimated or given."""
    names = (INPUTS, *(q.name for q in problem.dae.outputs))
    return {name: problem.parameters[delay_name(name)] for name in names if delay_name(name) in problem.parameters}


def _sought(problem: Problem) -> dict[str, Free | float]:
    """The delays that are to have a place: not what has its own already, or varies and has no one place."""
    placed = problem.recordings[0].advanced
    return {name: p for name, p in delays_of(problem).items() if (not p.varies if isinstance(p, Free) else name not in placed)}


def _arrived(result: Smoothing) -> bool:
    """Whether the solver did: that it is no minimum may be for a delay that is expanded too far from where it is."""
    return result.solver.converged or (result.solution is not None and result.solution.solved.status.converged)


def _better(one: Smoothing, other: Smoothing) -> bool:
    """Whether it has more evidence by the sample, as samples that are moved beyond the start are lost; so where nobody can tell."""
    if not _arrived(one):
        return False
    if other.criteria is None or other.criteria.log_evidence is None:
        return True
    if one.criteria is None or one.criteria.log_evidence is None:
        return False
    return one.criteria.log_evidence / one.criteria.samples >= other.criteria.log_evidence / other.criteria.samples


def _posed(asked: Problem, expanded: Mapping[str, float], guesses: Mapping[str, float], interval: float, margin: float = MARGIN) -> Problem:
    """The problem with the samples of delayed outputs, or of all for the INPUTS, moved back, and their delays within reach.

    expanded, guesses: d_0 and where delays start [intervals], the latter but where a prior says what the guess means.
    """
    before = asked.recordings[0].advanced
    about = {name: d * interval for name, d in expanded.items()}
    moves = {name: d_0 - before.get(name, 0.0) for name, d_0 in about.items()}
    dae, parameters = asked.dae, dict(asked.parameters)
    for name, by in moves.items():
        dae = with_samples_moved(dae, name, by) if by else dae
        free = parameters[delay_name(name)]
        if isinstance(free, Free):
            low, high = max(free.min, about[name] - (1.0 + margin) * interval), min(free.max, about[name] + margin * interval)
            guess = free.guess if free.std is not None else float(np.clip(guesses[name] * interval, low, high))
            parameters[delay_name(name)] = replace(free, guess=guess, min=min(low, guess), max=max(high, guess))
    recordings = [
        replace(moved(r, {name: moves.get(name, 0.0) + moves.get(INPUTS, 0.0) for name in r.outputs}), advanced={**before, **about})
        for r in asked.recordings
    ]
    return replace(asked, model=dae, parameters=parameters, recordings=recordings)


def _notes(about: Mapping[str, float], sought: Mapping[str, Free | float], interval: float, open_ends: Sequence[str]) -> list[str]:
    """What a reader should know of how the delays came out; open_ends: of those that are not where they were expanded."""
    notes = [
        f"The samples of {_of(name)} were moved back by {d * interval:.6g} s, "
        f"{'about the delay that was found' if isinstance(sought[name], Free) else 'the delay that was given'}; times are theirs then."
        for name, d in about.items()
        if d != 0.0
    ]
    if open_ends:
        names = ", ".join(f'"{delay_name(name)}"' for name in open_ends)
        what = f"the delay of {' and '.join(map(_of, open_ends))}"
        notes.append(f"No settled value was found for {what}: give it as a number, or bounds by the parameter {names}.")
    return notes


def _of(name: str) -> str:
    return "all outputs" if name == INPUTS else name
