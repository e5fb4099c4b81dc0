"""The search for what a model leaves out.

    smooth the base model -> score all candidates -> fit the best -> keep one that the evidence, its size and its numbers bear out -> again

and then the proof on what was held out. Everything is judged with trajectories, parameters and the weights that nobody gave chosen anew.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from numpy.linalg import LinAlgError

from backsight.models import Model
from backsight.models.errors import InputError, SolveError

from ..problem import Problem
from ..recordings.split import with_held_out
from ..results import Smoothing
from ..smoothing.explaining import EXPLAINS_NOTHING
from ..smoothing.program import Settings
from ..smoothing.smoother import smoothing
from ..smoothing.unseen import unseen_states
from ..workers import at_hand, workers
from .contradicted import contradicted
from .delays import without_delays
from .fits import Fits, Progress
from .frames import with_heading
from .hold import with_better_hold
from .keep import Keep
from .mismatch import mismatches
from .misread import Reading, idle, lost, misread
from .offsets import at_nothing, own_of, with_offsets, without_offsets
from .proof import Case, Proof
from .refit import HELD, PATIENT, QUICKLY, comparable
from .search import Search
from .sizes_known import with_sizes_known
from .standing import Standing
from .verdict import Diagnosis
from .words import CONTRADICTED, withdrawn

BASE = 400.0  # s, of the model as it is with weights from the data; no healthy one takes as long
MISREAD, READINGS = 15.0, 90.0  # s, of the model as it is with columns read in another way; s, of all of them together
SHORTER = 250.0  # s, of the same beside what held weights have left
OF_BASE, AT_LEAST = 0.6, 60.0  # of the search's time, that the model as it is may take; s, that each way to it has all the same
SEARCH = 840.0  # s, from the beginning to the end of the search
PROOF = 240.0  # s, from there to the end of the last smoothing of what was held out
ALONE = 60.0  # s, that this may take where there is nothing to prove


def diagnose(
    problem: Problem,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    keep: Path | None = None,
    seed: int = 0,
    seconds: float = SEARCH,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what the model of a problem leaves out, name it, put it into the model, and prove the gain on what was held out.

    jobs: processes of this machine; scheduler: address of a Dask cluster instead. keep: a folder where finished fits stay, so that an
    interrupted diagnosis goes on. seed: of what is drawn, which is how likely a gain is by chance. seconds: after which the search ends
    with what it has and says so; the proof comes after it and has a limit of its own. Raises InputError where the problem cannot be
    smoothed at all, or its model is not made of components.
    """
    began, end, say = time.perf_counter(), time.time() + seconds, progress or (lambda _: None)
    problem, late = without_delays(problem)
    if not isinstance(problem.model, Model):
        raise InputError("diagnose: the model is a compiled Dae, which has no places to put components at; give the Model itself.")
    recordings, split = with_held_out(problem.recordings)
    posed = replace(problem, recordings=[r for r in recordings if r.role == "fit"])
    with workers(jobs, scheduler) as pool:
        steadied = with_offsets(with_heading(posed, problem.model))

        def based(other: Problem, *, asking: bool = False) -> tuple[Smoothing, Settings]:
            return _base(other, Keep(keep, other), say, end - (1.0 - OF_BASE) * seconds, asking=asking)

        as_said = based(steadied, asking=True)
        steadied, open_ones = with_sizes_known(steadied, as_said[0])
        as_said = based(steadied) if open_ones else as_said
        better, (first, settings), straight = with_better_hold(steadied, problem.model, as_said, based)
        search = Search(
            standing=Standing(problem=better, model=problem.model, result=first),
            fits=Fits(pool=pool, ahead=at_hand(jobs, scheduler), kept=Keep(keep, better), say=say, end=end, jobs=jobs),
            settings=settings,
            seed=seed,
            held=tuple(steadied.recordings) if straight else None,
        )
        search.run()
    first = search.first
    if straight and search.held is None:
        straight, first = "", as_said[0]
    verdict, first = search.verdict(), without_offsets(first)
    notes = [said for said in (late, split, straight, open_ones) if said]
    if straight:
        recordings = [replace(r, hold="linear") for r in recordings]
        posed = replace(posed, recordings=[r for r in recordings if r.role == "fit"])
    if not first.solver.converged:
        notes.append(f"The model as it is did not come to rest ({first.solver.status.rstrip('.')}): what is told beside it is rough.")
    if not settings.weigh:
        notes.append("Models were compared with residual forces of a share of the forces at every place, not of what the data say.")
    held_out, unseen = None, [r for r in recordings if r.role == "held_out"]
    say(f"{'proof' if search.standing.named else 'the model'} on what was held out")
    left = seconds + PROOF - (time.perf_counter() - began)
    proof = Proof(
        recordings=unseen,
        role="held_out" if split is None else "last third",
        end=time.monotonic() + (left if search.standing.named else min(left, ALONE)),
        say=say,
    )

    def seen(case: Case) -> Case:
        return replace(case[0], recordings=recordings, initial=problem.initial), at_nothing(case[1])

    try:
        if unseen:
            base = proof.predictor((replace(posed, recordings=recordings), first), "the base model")
        if unseen and search.standing.named:
            repaired = proof.predictor(seen((search.problem, search.result)), "the repaired model", base)
            repaired, gone = contradicted(search, proof, repaired, seen)
            notes, verdict = [*notes, *gone], search.verdict() if gone else verdict
            held_out = proof.compared(base, repaired)
        elif unseen:
            held_out = proof.compared(base, base).unrepaired
    except (SolveError, InputError, ArithmeticError, LinAlgError) as error:
        notes.append(f"What was held out could not be predicted: {error}")
    if held_out is not None and held_out.refuting:
        if search.standing.faint:
            notes.append(withdrawn(search.standing.findings, held_out))
            search.withdraw()
            verdict, held_out = search.verdict(), held_out.unrepaired
        else:
            notes.append(CONTRADICTED)
            verdict = verdict if verdict == "unknown_physics" else "undecided"
    if verdict == "none" and not first.solver.converged:
        verdict = "undecided"
    return Diagnosis(
        verdict=verdict,
        findings=search.standing.findings,
        before=first,
        after=without_offsets(search.result),
        repaired=replace(
            search.problem, model=search.standing.model, parameters=own_of(search.problem), recordings=recordings, initial=problem.initial
        ),
        held_out=held_out,
        undetectable=tuple(search.undetectable),
        tried=tuple(search.tried),
        mismatch=(*mismatches(first), *(mismatches(search.result) if search.standing.findings else ())),
        seconds=time.perf_counter() - began,
        seed=seed,
        notes=(*notes, *search.notes),
    )


def _base(problem: Problem, kept: Keep, say: Progress, end: float = math.inf, *, asking: bool = False) -> tuple[Smoothing, Settings]:
    """The model as it is, and how candidates are fitted beside it.

    What no output shows can be anything, at a price, as long as weights come from the data and the model is wrong: they would wander with
    the parameters. There, and where the data's own weights do not come to rest, forces have a share of the balances at first. Where these
    do not come to rest their parameters may have gone anywhere, so that weights from the data begin at the recordings all the same, and
    where they do not come to rest from there either, where the held ones were left. A model that does not come to rest in any way is taken
    as it was left with held ones: what it lacks may be what keeps it from that.
    end: on the clock of `time.time`, by which it should be there. asking: whether one that explains nothing has its columns doubted.
    """

    def smoothed(what: str, way: Settings, begin: Smoothing | None = None) -> Smoothing | None:
        say(f"the model as it is{what}")
        way = replace(way, seconds=min(way.seconds, max(end - time.time(), AT_LEAST)))
        call = partial(smoothing, problem, settings=way, begin=None if begin is None else begin.solution, progress=say)
        return kept.smoothed(kept.name(f"the model as it is{what}"), call)

    weighed, held = Settings(hasty=True, marginal=False, seconds=BASE), replace(HELD, seconds=BASE, options=PATIENT)
    onward = replace(weighed, check_mesh=False, finest=QUICKLY.finest, options=PATIENT)
    hidden = bool(unseen_states(problem.plain))
    near = smoothed(", with weights from the forces' sizes", held) if hidden else None
    if near is not None and near.solver.converged:
        return near, HELD
    weighed = weighed if near is None else replace(weighed, seconds=SHORTER)
    found = smoothed("", weighed)
    if asking and found is not None and (lost(found) or idle(found)) and (said := _misread(problem, found, kept, say, end)):
        raise InputError(f"diagnose: {EXPLAINS_NOTHING} of what was recorded. It explains more if {said}.")
    if found is not None and not found.solver.converged and comparable(problem, found):
        found = smoothed(", from where it was left", onward, found) or found
    if found is not None and found.solver.converged:
        return found, QUICKLY
    if not hidden:
        near = smoothed(", with weights from the forces' sizes", held)
        if near is not None and near.solver.converged:
            return near, HELD
    tried = near or found
    near = near if near is not None and comparable(problem, near) else None
    if near is not None and hidden and found is not None:
        last = smoothed(", with weights from the data from there", weighed, near)
        if last is not None and last.solver.converged:
            return last, QUICKLY
    if near is not None:
        return near, HELD
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
            return kept.smoothed(kept.name(f"the model as it is{what}"), partial(smoothing, read(problem), settings=way))
        except (SolveError, InputError, ArithmeticError, LinAlgError):
            return None

    return misread(problem, result, smoothed)
