"""Fits of a search, side by side and kept on disk: of candidates, of the model as it is, of other problems from where that came to rest."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

from backsight.models import Model
from backsight.models.errors import InputError, SolveError
from backsight.ocp import Solution

from ...problem import Free, Problem
from ...results import Smoothing
from ...smoothing.begun import Begun
from ...smoothing.program import Settings
from ...smoothing.smoother import smoothing
from ...workers import as_finished
from ..candidates.candidate import Candidate
from ..evidence.offsets import without_idle
from ..scores.screen import Screened
from .findings import Judged
from .keep import DIGITS, Keep
from .refit import HELD, PATIENT, QUICKLY, Fitted, begun, fitted_there, settled, with_weights_of

Progress = Callable[[str], None]

LONGEST = 0.25  # of the time that is left: what one of several fits may take, so that one which does not arrive leaves some to the others


@dataclass(frozen=True, kw_only=True)
class Base:
    """What fits begin at: a problem, its model and its smoothing; settings of the fits; what changes made it, in words."""

    problem: Problem
    model: Model
    result: Smoothing
    settings: Settings
    changes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Fits:
    """Where fits run and stay. ahead: how many at once; end: on the clock of `time.time`, after which none begins.

    jobs: processors of this machine that are there for the rest. owed: time before the end that belongs to what has to come after fits [s].
    """

    pool: Executor
    ahead: int
    kept: Keep
    say: Progress
    end: float
    jobs: int = 1
    owed: float = 0.0

    @property
    def until(self) -> float:
        """When fits are over, on the same clock."""
        return self.end - self.owed

    @property
    def left(self) -> float:
        """Time that fits have [s]."""
        return max(self.until - time.time(), 0.0)

    def candidates(self, base: Base, wanted: Sequence[tuple[Candidate, Screened | None]], *, anew: bool = False) -> list[Judged]:
        """The candidates fitted, from where the base came to rest. anew: from the guesses of its problem instead."""
        if not wanted:
            return []
        values = _found(base.result)
        begun_at = base.problem if anew else settled(base.problem, base.result)
        blob = pickle.dumps((begun_at, base.model, base.result, base.result.solution))
        starts = [begun(c, s, values) for c, s in wanted]
        before = repr((sorted(values.items()), list(base.changes), base.settings.weigh, anew, _given(base.problem)))
        names = [self.kept.name(before, c, start) for (c, _), start in zip(wanted, starts, strict=True)]
        found = {name: part for name in names if (part := self.kept.get(name)) is not None}
        open_ones = [(name, c, start) for name, (c, _), start in zip(names, wanted, starts, strict=True) if name not in found]

        def calls() -> Iterator[tuple[str, Callable[[], Fitted]]]:
            for k, (name, c, start) in enumerate(open_ones):
                self.say(f"fit {len(wanted) - len(open_ones) + k + 1} of {len(wanted)}: {c.title}")
                share = max(LONGEST, 1.0 / (len(open_ones) - k + 1))
                yield name, partial(fitted_there, blob, c.sent, start, base.settings, anew, self.until, share)

        for name, fit in as_finished(self.pool, calls(), self.ahead):
            found[name] = fit
            if not fit.late:
                self.kept.put(name, fit)
        return [(c, s, found[name]) for (c, s), name in zip(wanted, names, strict=True)]

    def again(self, base: Base, problem: Problem, what: str, *, least: float = 0.0) -> Smoothing | None:
        """Another problem, smoothed as candidates are from where the base came to rest; None where it does not arrive.

        least: time that it has when the search's is over [s].
        """
        solution = base.result.solution
        if solution is None:
            return None
        weighed = problem if base.settings.weigh else with_weights_of(solution, problem)
        settings = replace(base.settings, seconds=min(base.settings.seconds, max(self.left / 2, least)))
        name = self.kept.name(repr((what, list(base.changes), base.settings.weigh, _given(problem))), start=_found(base.result))
        return self._arrived(name, weighed, settings, Begun.of(solution, weighed))

    def anew(self, base: Base, problem: Problem) -> tuple[Problem, Smoothing] | None:
        """A problem smoothed from its own guesses, at the base's weights or as these are: from the data. None where it does not arrive."""
        if (solution := base.result.solution) is None:
            return None
        posed = problem if base.settings.weigh else with_weights_of(solution, problem)
        settings = replace(HELD, options=PATIENT, supposed=base.settings.supposed, seconds=LONGEST * self.left)
        name = self.kept.name(repr(("anew", list(base.changes), base.settings.weigh, _given(problem))), start=_found(base.result))
        found = self._arrived(name, posed, settings, None)
        if found is None:
            return None
        return self.weighed(base, problem, found) if base.settings.weigh else (problem, found)

    def weighed(self, base: Base, problem: Problem, near: Smoothing) -> tuple[Problem, Smoothing] | None:
        """A problem smoothed with weights from the data, starting where another one of it came to rest; None where it does not."""
        problem = without_idle(settled(problem, near), near)
        name = self.kept.name(repr(("weighed", list(base.changes), _given(problem))), start=_found(near))
        settings = replace(QUICKLY, seconds=self.left / 2, supposed=base.settings.supposed)
        begin: Solution | Begun | None = near.solution
        if near.solution is not None and not _as_many_states(near.solution, problem):
            begin = Begun.of(near.solution, problem)  # a lag that was there is gone
        found = self._arrived(name, problem, settings, begin)
        return None if found is None else (problem, found)

    def _arrived(self, name: str, problem: Problem, settings: Settings, begin: Solution | Begun | None) -> Smoothing | None:
        """A problem smoothed, or as it was kept; None where it does not come to rest."""
        try:
            call = partial(smoothing, problem, settings=settings, begin=begin, progress=self.say)
            found = self.kept.smoothed(name, call, settings.options.seconds)
        except (SolveError, InputError):
            return None
        return found if found is not None and found.solver.converged else None


def _as_many_states(solution: Solution, problem: Problem) -> bool:
    return [q.name for q in solution.transcription.dae.states] == [q.name for q in problem.posed.dae.states]


def _given(problem: Problem) -> list[tuple[str, str]]:
    """What is given of the parameters, but for roundings: a fit within other bounds, or from other guesses, is another one."""

    def said(given: Free | float) -> str:
        if not isinstance(given, Free):
            return f"{given:.{DIGITS}g}"
        return f"{given.guess:.{DIGITS}g} {given.min:.{DIGITS}g} {given.max:.{DIGITS}g} {given.std} {given.drift}"

    return sorted((name, said(given)) for name, given in problem.parameters.items())


def _found(result: Smoothing) -> dict[str, float]:
    return {p.name: p.value for p in result.parameters.values()}
