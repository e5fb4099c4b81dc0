"""The search for what a model leaves out.

    smooth the base model -> score all candidates -> fit the best -> keep one that the evidence, its size and its numbers bear out -> again

and then the proof on what was held out. Everything is judged with trajectories, parameters and the weights that nobody gave chosen anew.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from backsight.models import Dae

from ..problem import Known, Problem
from ..workers import at_hand, workers
from .answer.mismatch import mismatches
from .answer.verdict import Diagnosis
from .candidates.memory import remembered
from .evidence.latent import without_force
from .evidence.offsets import at_nothing, own_of, without_offsets
from .proof.proof import Case, Proof
from .proof.ruling import ruling
from .scores.onsets import clocks_notes
from .search.findings import ranked
from .search.fits import Fits, Progress
from .search.keep import Keep
from .search.refit import known_of
from .search.runaway import free_again, wild
from .search.search import Search
from .search.standing import Standing
from .start.beginning import beginning

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
    with workers(jobs, scheduler) as pool:
        start = beginning(problem, keep, say, end - (1.0 - OF_BASE) * seconds)
        now, held = start.now, start.held
        search = Search(
            standing=Standing(problem=now.problem, model=start.model, result=now.result),
            fits=Fits(pool=pool, ahead=at_hand(jobs, scheduler), kept=Keep(keep, now.problem), say=say, end=end, jobs=jobs),
            settings=now.settings,
            seed=seed,
            held=Standing(problem=held.problem, model=start.model, result=held.result) if held is not None else None,
            beforehand=start.findings,
        )
        search.run()
        start = start.as_left(straight=search.held is not None)
        declared = start.declared(search.first, search.first_weights)
        left = seconds + PROOF - (time.perf_counter() - began)
        proof = Proof(
            recordings=start.unseen,
            role="last third" if start.last_third else "held_out",
            end=time.monotonic() + (left if search.repaired else min(left, ALONE)),
            say=say,
        )

        def known(dae: Dae) -> dict[str, float | Known]:
            own = {state: at for c in search.standing.accepted for state, at in remembered(start.problem, c).items()}
            return known_of(start.problem, dae, own)

        def seen(case: Case) -> Case:
            return replace(case[0], recordings=start.problem.recordings, initial=known(case[0].dae)), at_nothing(case[1])

        ruled = ruling(search, proof, declared, seen)
    verdict, notes, first = ruled.verdict, [*start.remarks(declared[1]), *ruled.notes], declared[1]
    if verdict == "none" and (not first.solver.converged or wild(start.problem, first) or (start.astray and search.near)):
        verdict = "undecided"
    if verdict in ("unknown_physics", "undecided") or any(f.onset is not None or f.explanation.changes for f in search.standing.findings):
        notes += clocks_notes(start.fitted)
    found = (*start.findings, *search.standing.findings)
    return Diagnosis(
        verdict=verdict,
        findings=ranked(found),
        before=first,
        after=without_offsets(search.result) if found else first,
        repaired=replace(
            without_force(search.problem),
            model=search.standing.model,
            parameters=own_of(free_again(search.problem)),
            recordings=start.problem.recordings,
            initial=known(search.problem.dae),
        ),
        held_out=ruled.held_out,
        undetectable=tuple(search.undetectable),
        tried=tuple(search.tried),
        mismatch=(*mismatches(first), *(mismatches(search.result) if found else ())),
        seconds=time.perf_counter() - began,
        seed=seed,
        notes=(*notes, *search.notes, *search.closing),
    )
