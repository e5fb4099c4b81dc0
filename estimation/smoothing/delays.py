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
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from backsight.models.augmentation.delay import INPUTS, delay_name, with_samples_moved
from backsight.models.errors import InputError

from ..problem import Free, Problem
from ..recordings.delay import moved
from ..results import Smoothing

PASSES = 16
FARTHEST = 0.5  # of the shortest recording: a longer delay would cost more samples than it leaves
MARGIN = 0.1  # intervals by which d may leave its interval, so that a delay of whole ones does not go to and fro
GROWTH = 3.0  # of the stride, after one that leads on; where it went too far it shrinks as much
ON_THE_EDGE = 1e-6  # intervals


def settled(problem: Problem, smooth: Callable[[Problem], Smoothing]) -> tuple[Problem, Smoothing]:
    """The problem as posed in the end, the samples of delayed outputs moved to about where their delays are expanded, and smoothed.

    Where no expansion was found that holds at the delay it gives, a note of the result says so.
    """
    sought = _sought(problem)
    if not sought:
        return problem, smooth(problem)
    interval = min(r.input_sampling for r in problem.fitted)
    farthest = FARTHEST * min(float(r.time[-1] - r.time[0]) for r in problem.fitted) / interval
    guesses = {name: (p.guess if isinstance(p, Free) else p) / interval for name, p in sought.items()}
    for name, guess in guesses.items():
        if abs(guess) > farthest:
            raise InputError(
                f"delay of {_of(name)}: {guess * interval:g} s is more than {FARTHEST:g} of the shortest recording, "
                f"{farthest * interval:g} s; give it in seconds, or leave the recording out."
            )
    ranges = {name: _range(p, interval) for name, p in sought.items()}
    # an estimate begins in the interval that ends after its guess; what is given needs no series
    about = {n: float(np.floor(g)) + 1.0 if isinstance(sought[n], Free) else g for n, g in guesses.items()}
    about = {name: float(np.clip(d, *ranges[name])) for name, d in about.items()}
    posed = _posed(problem, about, guesses, interval)
    result, tried, stride, way = smooth(posed), [about], 1.0, dict.fromkeys(sought, 0.0)
    growth = GROWTH
    for _ in range(PASSES if _arrived(result) else 0):
        towards = _edges(result, about, sought, interval)
        if any(way[name] * side < 0 for name, side in towards.items()):
            stride, growth = max(map(abs, way.values())) / GROWTH, 1.0  # it went too far: back by less than it came
        there = _moved(about, towards, stride, ranges)
        while stride > 1.0 and (there in tried or max(map(abs, there.values())) > farthest):
            stride, growth = stride / GROWTH, 1.0
            there = _moved(about, towards, stride, ranges)
        if there in tried or max(map(abs, there.values())) > farthest:
            break
        tried.append(there)
        further = _posed(problem, there, {name: d - 0.5 for name, d in there.items()}, interval)
        other = smooth(further)
        if _better(other, result):
            way = {name: there[name] - d for name, d in about.items()}
            about, posed, result, stride = there, further, other, stride * growth
        elif stride > 1.0:
            stride, growth = stride / GROWTH, 1.0
        else:
            break
    open_ends = [name for name, side in _edges(result, about, sought, interval).items() if side]
    there = {name: result.parameters[delay_name(name)].value / interval for name in about}
    if _arrived(result) and not open_ends and there != about:
        # once more about the delays themselves, where nothing is left of the series
        further = _posed(problem, there, there, interval)
        other = smooth(further)
        if _arrived(other) and not any(_edges(other, there, sought, interval).values()):
            about, posed, result = there, further, other
    return posed, replace(result, notes=(*result.notes, *_notes(about, sought, interval, open_ends)))


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


def _edges(result: Smoothing, about: Mapping[str, float], sought: Mapping[str, Free | float], interval: float) -> dict[str, float]:
    """Of every delay: 1 where its estimate ended on the late edge of what is believed about d_0, -1 on the early one, 0 in between."""
    rest = {name: result.parameters[delay_name(name)].value / interval - d for name, d in about.items() if isinstance(sought[name], Free)}
    sides = {name: float(r > MARGIN - ON_THE_EDGE) - float(r < -1.0 - MARGIN + ON_THE_EDGE) for name, r in rest.items()}
    return {name: sides.get(name, 0.0) for name in about}


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


def _posed(asked: Problem, expanded: Mapping[str, float], guesses: Mapping[str, float], interval: float) -> Problem:
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
            low, high = max(free.min, about[name] - (1.0 + MARGIN) * interval), min(free.max, about[name] + MARGIN * interval)
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
        f"The samples of {_of(name)} were moved back by {d * interval:.6g} s, the delay that was "
        f"{'found' if isinstance(sought[name], Free) else 'given'}; times in other notes are theirs then."
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
