"""The search for what a model leaves out.

    smooth the base model -> score all candidates -> fit the best -> keep one that the evidence, its size and its numbers bear out -> again

and then the proof on what was held out. Everything is judged with trajectories, parameters and the weights that nobody gave chosen anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from backsight.models import Dae, Model
from backsight.models.errors import InputError

from ..problem import Known, Problem
from ..recordings.split import with_held_out
from ..results import Smoothing
from ..workers import at_hand, workers
from .answer.mismatch import mismatches
from .answer.verdict import Diagnosis
from .answer.words import CONTRADICTED, UNPROVED, withdrawn
from .candidates.frames import with_heading
from .candidates.memory import remembered
from .evidence.latent import Latent, without_force
from .evidence.offsets import at_nothing, own_of, with_offsets, without_offsets
from .proof.contradicted import contradicted
from .proof.proof import Case, Proof
from .scores.onsets import clocks_notes
from .search.findings import ranked
from .search.fits import Fits, Progress
from .search.keep import Keep
from .search.left_over import NAMELESS
from .search.refit import FAILURES, known_of
from .search.runaway import free_again, wild, with_all_near, with_inertias_near
from .search.search import Search
from .search.standing import Standing
from .start.as_it_is import AsItIs, RanAway, as_it_is
from .start.delays import without_delays
from .start.dropouts import Torn, with_whole_signals
from .start.hold import with_better_hold
from .start.noise_shown import with_noise_as_shown, with_noise_at_least
from .start.sizes_known import with_sizes_known
from .start.time_stamps import with_clock

OF_BASE = 0.6  # of the search's time, that the model as it is may take
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
    problem, quiet = with_noise_at_least(problem)
    if not isinstance(problem.model, Model):
        raise InputError("diagnose: the model is a compiled Dae, which has no places to put components at; give the Model itself.")
    recordings, split = with_held_out(problem.recordings)
    posed = replace(problem, recordings=[r for r in recordings if r.role == "fit"])
    with workers(jobs, scheduler) as pool:
        steadied = with_offsets(with_heading(posed, problem.model))

        def based(other: Problem, *, asking: bool = False, running: bool = True) -> AsItIs:
            return as_it_is(other, Keep(keep, other), say, end - (1.0 - OF_BASE) * seconds, asking=asking, running=running)

        steadied, as_said, torn, ran = _begun(steadied, based)
        if torn is not None:
            recordings = torn.mended(recordings)
            posed = replace(posed, recordings=[r for r in recordings if r.role == "fit"])
        steadied, as_said, off, jitter = with_clock(steadied, as_said, based)
        recordings = off(recordings)
        steadied, as_said, large = _held(with_inertias_near, steadied, as_said, based)
        steadied, open_ones = with_sizes_known(steadied, as_said.result)
        as_said = based(steadied) if open_ones else as_said
        steadied, as_said, loud = _held(with_noise_as_shown, steadied, as_said, based)
        large = " ".join(said for said in (ran, large) if said)
        if loud:  # what passed for noise may have had inertias stand for it
            steadied, as_said, larger = _held(with_inertias_near, steadied, as_said, based)
            large = " ".join(said for said in (large, larger) if said)
        now, straight = with_better_hold(steadied, problem.model, as_said, based)
        search = Search(
            standing=Standing(problem=now.problem, model=problem.model, result=now.result),
            fits=Fits(pool=pool, ahead=at_hand(jobs, scheduler), kept=Keep(keep, now.problem), say=say, end=end, jobs=jobs),
            settings=now.settings,
            seed=seed,
            held=Standing(problem=as_said.problem, model=problem.model, result=as_said.result) if straight else None,
            beforehand=torn.findings if torn is not None else (),
        )
        search.run()
    straight = straight if search.held is not None else ""
    verdict, first, weights = search.verdict(), search.first, search.first_weights
    if torn is not None and torn.before is not None:
        first, weights = torn.before.result, torn.before.problem.weights
    first, proving = without_offsets(first), bool(search.standing.named or torn)
    notes = [said for said in (late, quiet, split, jitter, straight, large, open_ones, loud) if said]
    if straight:
        recordings = [replace(r, hold="linear") for r in recordings]
        posed = replace(posed, recordings=[r for r in recordings if r.role == "fit"])
    if not first.solver.converged:
        notes.append(f"The model as it is did not come to rest ({first.solver.status.rstrip('.')}): what is told beside it is rough.")
    if isinstance(now.problem.weights, Latent):
        notes.append(f"The model as it is did not come to rest without a force of any course at {now.problem.weights.place}.")
    if not now.settings.weigh:
        notes.append("Models were compared with residual forces of a share of the forces at every place, not of what the data say.")
    held_out, unseen = None, [r for r in recordings if r.role == "held_out"]
    say(f"{'proof' if proving else 'the model'} on what was held out")
    left = seconds + PROOF - (time.perf_counter() - began)
    proof = Proof(
        recordings=unseen,
        role="held_out" if split is None else "last third",
        end=time.monotonic() + (left if proving else min(left, ALONE)),
        say=say,
    )

    def known(dae: Dae) -> dict[str, float | Known]:
        whole = replace(problem, recordings=recordings)
        return known_of(problem, dae, {state: at for c in search.standing.accepted for state, at in remembered(whole, c).items()})

    def seen(case: Case) -> Case:
        return replace(case[0], recordings=recordings, initial=known(case[0].dae)), at_nothing(case[1])

    try:
        if unseen:
            base = proof.predictor((replace(posed, weights=weights, recordings=recordings), first), "the base model")
        if unseen and proving:
            repaired = proof.predictor(seen((search.problem, search.result)), "the repaired model", base)
            repaired, gone = contradicted(search, proof, repaired, seen)
            notes, verdict = [*notes, *gone], search.verdict() if gone else verdict
            held_out = proof.compared(base, repaired)
        elif unseen:
            held_out = proof.compared(base, base).unrepaired
    except FAILURES as error:
        notes.append(f"What was held out could not be predicted: {error}")
    passing = held_out is not None and torn is None and held_out.untold and search.standing.passing(unseen)
    if held_out is not None and (held_out.refuting or passing):
        if search.standing.faint or passing:
            notes.append(withdrawn(search.standing.findings, held_out))
            left = search.most_left
            search.withdraw()
            verdict, held_out = search.verdict(), held_out.unrepaired
            verdict = "undecided" if passing and verdict == "none" and left > NAMELESS else verdict
        else:
            notes.append(CONTRADICTED)
            verdict = verdict if verdict == "unknown_physics" else "undecided"
    elif (
        held_out is not None
        and search.standing.named
        and held_out.doubtful
        and search.most_left > NAMELESS
        and verdict != "unknown_physics"
    ):
        notes.append(UNPROVED)
        verdict = "undecided"
    if verdict == "none" and (not first.solver.converged or wild(posed, first) or (ran and search.near)):
        verdict = "undecided"
    if verdict in ("unknown_physics", "undecided") or any(f.onset is not None or f.explanation.changes for f in search.standing.findings):
        notes += clocks_notes(posed.recordings)
    found = (*search.beforehand, *search.standing.findings)
    return Diagnosis(
        verdict=verdict,
        findings=ranked(found),
        before=first,
        after=without_offsets(search.result) if found else first,
        repaired=replace(
            without_force(search.problem),
            model=search.standing.model,
            parameters=own_of(free_again(search.problem)),
            recordings=recordings,
            initial=known(search.problem.dae),
        ),
        held_out=held_out,
        undetectable=tuple(search.undetectable),
        tried=tuple(search.tried),
        mismatch=(*mismatches(first), *(mismatches(search.result) if found else ())),
        seconds=time.perf_counter() - began,
        seed=seed,
        notes=(*notes, *search.notes),
    )


def _begun(problem: Problem, based: Callable[..., AsItIs]) -> tuple[Problem, AsItIs, Torn | None, str]:
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
