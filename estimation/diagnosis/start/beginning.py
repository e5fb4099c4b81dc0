"""Where a search begins: recordings as they are to be taken, and the model as it is beside them.

    delays, noise -> dropouts -> clocks -> inertias near their guesses -> sizes of what nobody can tell -> noise as shown -> hold of inputs

Each step takes the problem and the model as it is and gives both back as they are better, with what there is to say.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from backsight.models import Model
from backsight.models.errors import InputError

from ...problem import Problem, Weights
from ...recordings.recording import Recording
from ...recordings.split import with_held_out
from ...results import Smoothing
from ..answer.verdict import Finding
from ..candidates.frames import with_heading
from ..evidence.latent import Latent
from ..evidence.offsets import with_offsets, without_offsets
from ..search.fits import Progress
from ..search.keep import Keep
from ..search.refit import FAILURES
from ..search.runaway import with_all_near, with_inertias_near
from .as_it_is import AsItIs, RanAway, as_it_is
from .delays import without_delays
from .dropouts import Torn, with_whole_signals
from .hold import with_better_hold
from .noise_shown import with_noise_as_shown, with_noise_at_least
from .sizes_known import with_sizes_known
from .time_stamps import with_clock


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """What is diagnosed. problem: of all recordings, without what only the search supposes.

    model: as it was declared. now: the model as it is. held: the same with its inputs held, as the study has them, where straight ones are
    better, and straight: how much. torn: signals that drop out. astray: whether it only comes to rest with its inertias near their guesses.
    last_third: whether that is what was held out. notes: on all but the inputs.
    """

    problem: Problem
    model: Model
    now: AsItIs
    held: AsItIs | None = None
    torn: Torn | None = None
    astray: bool = False
    last_third: bool = False
    straight: str = ""
    notes: tuple[str, ...] = ()

    @property
    def fitted(self) -> list[Recording]:
        """The recordings that are fitted."""
        return [r for r in self.problem.recordings if r.role == "fit"]

    @property
    def unseen(self) -> list[Recording]:
        """Those that were held out."""
        return [r for r in self.problem.recordings if r.role == "held_out"]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found before anything is looked for."""
        return self.torn.findings if self.torn is not None else ()

    def as_left(self, *, straight: bool) -> Beginning:
        """As a search leaves it, with its inputs straight or not: what was missing may have made them look so."""
        if not (self.straight and straight):
            return replace(self, held=None, straight="")
        recordings = [replace(r, hold="linear") for r in self.problem.recordings]
        return replace(self, problem=replace(self.problem, recordings=recordings))

    def declared(self, found: Smoothing, weights: Weights) -> tuple[Problem, Smoothing]:
        """The model as declared, that a repair is held against: with signals as they were recorded, where it came to an end with these.

        found, weights: as the search has it.
        """
        if self.torn is not None and self.torn.before is not None:
            found, weights = self.torn.before.result, self.torn.before.problem.weights
        return replace(self.problem, weights=weights), without_offsets(found)

    def remarks(self, declared: Smoothing) -> list[str]:
        """All there is to say of it. declared: the model as declared."""
        said = [*self.notes, *((self.straight,) if self.straight else ())]
        if not declared.solver.converged:
            said.append(f"The model as it is did not come to rest ({declared.solver.status.rstrip('.')}): what is told beside it is rough.")
        if isinstance(self.now.problem.weights, Latent):
            said.append(f"The model as it is did not come to rest without a force of any course at {self.now.problem.weights.place}.")
        if not self.now.settings.weigh:
            said.append("Models were compared with residual forces of a share of the forces at every place, not of what the data say.")
        return said


def beginning(problem: Problem, keep: Path | None, say: Progress, end: float) -> Beginning:
    """Where the search of a problem begins.

    keep: a folder where finished smoothings stay. end: on the clock of `time.time`. Raises InputError where the problem cannot be smoothed
    at all, or its model is not made of components.
    """
    problem, late = without_delays(problem)
    problem, quiet = with_noise_at_least(problem)
    if not isinstance(model := problem.model, Model):
        raise InputError("diagnose: the model is a compiled Dae, which has no places to put components at; give the Model itself.")
    recordings, split = with_held_out(problem.recordings)

    def based(other: Problem, *, asking: bool = False, running: bool = True) -> AsItIs:
        return as_it_is(other, Keep(keep, other), say, end, asking=asking, running=running)

    posed = with_offsets(with_heading(replace(problem, recordings=[r for r in recordings if r.role == "fit"]), model))
    posed, found, torn, astray = _with_whole_signals(posed, based)
    recordings = recordings if torn is None else torn.mended(recordings)
    posed, found, off, jitter = with_clock(posed, found, based)
    recordings = off(recordings)
    posed, found, large = _held(with_inertias_near, posed, found, based)
    posed, open_ones = with_sizes_known(posed, found.result)
    found = based(posed) if open_ones else found
    posed, found, loud = _held(with_noise_as_shown, posed, found, based)
    larger = ""
    if loud:  # what passed for noise may have had inertias stand for it
        posed, found, larger = _held(with_inertias_near, posed, found, based)
    now, straight = with_better_hold(posed, model, found, based)
    return Beginning(
        problem=replace(problem, recordings=recordings),
        model=model,
        now=now,
        held=found if straight else None,
        torn=torn,
        astray=bool(astray),
        last_third=split is not None,
        straight=straight,
        notes=tuple(said for said in (late, quiet, split, jitter, astray, large, larger, open_ones, loud) if said),
    )


def _with_whole_signals(problem: Problem, based: Callable[..., AsItIs]) -> tuple[Problem, AsItIs, Torn | None, str]:
    """The model as it is with whole signals, and a note where it only comes to rest with its inertias near their guesses."""
    try:
        return (*with_whole_signals(problem, partial(based, asking=True, running=False)), "")
    except RanAway:
        near, said = with_all_near(problem)
    try:
        if said:
            return (*with_whole_signals(near, partial(based, asking=True)), said)
    except FAILURES:
        pass
    return (*with_whole_signals(problem, partial(based, asking=True)), "")


def _held(
    by: Callable[[Problem, Smoothing], tuple[Problem, str]], problem: Problem, found: AsItIs, based: Callable[[Problem], AsItIs]
) -> tuple[Problem, AsItIs, str]:
    """Problem and model as it is with what is held, and a note, where there is any and the model comes to rest with it.

    Not where that takes weights that are held, too.
    """
    held, said = by(problem, found.result)
    if not said:
        return problem, found, ""
    try:
        there = based(held)
    except FAILURES:
        return problem, found, ""
    as_good = there.result.solver.converged and (there.settings.weigh or not found.settings.weigh)
    return (held, there, said) if as_good else (problem, found, "")
