"""The model as it is, before anything is looked for: how it comes to rest, and how candidates are fitted beside it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import partial

from backsight.models.errors import InputError

from ...problem import Problem
from ...results import Smoothing
from ...smoothing.explaining import EXPLAINS_NOTHING
from ...smoothing.program import Settings
from ...smoothing.smoother import smoothing
from ...smoothing.unseen import unseen_states
from ..evidence.latent import as_tight, straining
from ..scores.shares import left_over
from ..search.fits import Progress
from ..search.keep import Keep
from ..search.refit import FAILURES, HELD, PATIENT, QUICKLY, beyond_all_bounds, comparable
from ..search.runaway import wild
from .misread import Reading, idle, lost, misread

BASE = 400.0  # s, of the model as it is with weights from the data; no healthy one takes as long
MISREAD, READINGS = 15.0, 90.0  # s, of the model as it is with columns read in another way; s, of all of them together
SHORTER = 250.0  # s, of the same beside what held weights have left
ROUGHLY = replace(PATIENT, tolerance=0.1)  # deviations: what all else is found beside need not be more exact
AT_LEAST = 60.0  # s, that each way to it has all the same


class RanAway(InputError):
    """A model of which an inertia grew without end."""


@dataclass(frozen=True, kw_only=True)
class AsItIs:
    """The model as it is, smoothed, and the settings of fits beside it. problem: with a force without a name where it needs one."""

    problem: Problem
    result: Smoothing
    settings: Settings


def as_it_is(problem: Problem, kept: Keep, say: Progress, end: float = math.inf, *, asking: bool = False, running: bool = True) -> AsItIs:
    """The model as it is, and how candidates are fitted beside it.

    What no output shows can be anything, at a price, as long as weights come from the data and the model is wrong: they would wander with
    the parameters. There, and where the data's own weights do not come to rest, forces have a share of the balances at first. Where these
    do not come to rest a force without a name is tried at the places that strain (`latent.py`); and where that does not help their
    parameters may have gone anywhere, so that weights from the data begin at the recordings all the same, and where they do not come to
    rest from there either, where the held ones were left. A model that does not come to rest in any way is taken as it was left with held
    ones: what it lacks may be what keeps it from that.
    end: on the clock of `time.time`, by which it should be there. asking: whether one that explains nothing has its columns doubted.
    running: whether one of which an inertia grows without end is waited for: RanAway is raised where it is not.
    """

    def smoothed(what: str, way: Settings, begin: Smoothing | None = None, posed: Problem = problem) -> Smoothing | None:
        say(f"the model as it is{what}")
        way = replace(way, seconds=min(way.seconds, max(end - time.time(), AT_LEAST)))
        call = partial(smoothing, posed, settings=way, begin=None if begin is None else begin.solution, progress=say)
        with beyond_all_bounds():
            return kept.smoothed(kept.name(f"the model as it is{what}"), call, way.options.seconds)

    weighed, held = Settings(hasty=True, marginal=False, seconds=BASE), replace(HELD, seconds=BASE, options=PATIENT)
    onward = replace(weighed, check_mesh=False, finest=QUICKLY.finest, options=PATIENT)
    hidden = bool(unseen_states(problem.plain))
    near = smoothed(", with weights from the forces' sizes", held) if hidden else None
    if near is not None and near.solver.converged:
        return AsItIs(problem=problem, result=near, settings=HELD)
    for place, posed in straining(problem, near, left_over(problem, near)) if near is not None else ():
        try:
            found = smoothed(f", with a force at {place}", replace(held, options=ROUGHLY), posed=posed)
        except FAILURES:
            continue
        if near is not None and found is not None and found.solver.converged:
            return AsItIs(problem=as_tight(posed, near, found), result=found, settings=HELD)
    weighed = weighed if near is None else replace(weighed, seconds=SHORTER)
    try:
        found = smoothed("", weighed)
    except FAILURES:
        if near is None or not comparable(problem, near):
            raise
        found = None
    if not running and found is not None and wild(problem, found):
        raise RanAway(f"diagnose: the model as it is could not be smoothed ({found.solver.status.rstrip('.')}); give better guesses.")
    if asking and found is not None and (lost(found) or idle(found)) and (said := _misread(problem, found, kept, say, end)):
        raise InputError(f"diagnose: {EXPLAINS_NOTHING} of what was recorded. It explains more if {said}.")
    if found is not None and not found.solver.converged and comparable(problem, found):
        found = smoothed(", from where it was left", onward, found) or found
    if found is not None and found.solver.converged:
        return AsItIs(problem=problem, result=found, settings=QUICKLY)
    if not hidden:
        near = smoothed(", with weights from the forces' sizes", held)
        if near is not None and near.solver.converged:
            return AsItIs(problem=problem, result=near, settings=HELD)
    tried = near or found
    near = near if near is not None and comparable(problem, near) else None
    if near is not None and hidden and found is not None:
        last = smoothed(", with weights from the data from there", weighed, near)
        if last is not None and last.solver.converged:
            return AsItIs(problem=problem, result=last, settings=QUICKLY)
    if near is not None:
        return AsItIs(problem=problem, result=near, settings=HELD)
    status = "it took too long" if tried is None else tried.solver.status.rstrip(".")
    notes = [] if tried is None else [note for note in tried.notes if note.startswith("residual.")]
    raise InputError(" ".join([f"diagnose: the model as it is could not be smoothed ({status}); give better guesses.", *notes]))


def _misread(problem: Problem, result: Smoothing, kept: Keep, say: Progress, end: float) -> str:
    """What the columns of a study may be instead."""
    end = min(end, time.time() + READINGS)

    def smoothed(what: str, read: Reading) -> Smoothing | None:
        if time.time() > end:
            return None
        say(f"the model as it is{what}")
        way = replace(QUICKLY, marginal=False, seconds=MISREAD, options=replace(HELD.options, seconds=MISREAD))
        try:
            with beyond_all_bounds():
                call = partial(smoothing, read(problem), settings=way)
                return kept.smoothed(kept.name(f"the model as it is{what}"), call, way.options.seconds)
        except FAILURES:
            return None

    return misread(problem, result, smoothed)
