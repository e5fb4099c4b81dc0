"""The search for what a model leaves out.

    smooth the base model -> score all candidates -> fit the best -> keep one that the evidence, its size and its numbers bear out -> again

and then the proof on what was held out. Everything is judged with trajectories, parameters and the weights that nobody gave chosen anew.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from backsight.models import Model
from backsight.models.errors import InputError, SolveError

from ..problem import Problem
from ..recordings.split import with_held_out
from ..results import Smoothing
from ..smoothing.smoother import smooth
from ..workers import workers
from .keep import Keep
from .mismatch import mismatches
from .proof import prove
from .search import Progress, Search
from .verdict import Diagnosis


def diagnose(
    problem: Problem,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    keep: Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what the model of a problem leaves out, name it, put it into the model, and prove the gain on what was held out.

    jobs: processes of this machine; scheduler: address of a Dask cluster instead. keep: a folder where finished fits stay, so that an
    interrupted diagnosis goes on. seed: goes into the results; nothing is drawn yet. Raises InputError where the problem cannot be smoothed
    at all, or its model is not made of components.
    """
    began, say = time.perf_counter(), progress or (lambda _: None)
    if not isinstance(problem.model, Model):
        raise InputError("diagnose: the model is a compiled Dae, which has no places to put components at; give the Model itself.")
    recordings, split = with_held_out(problem.recordings)
    posed = replace(problem, recordings=[r for r in recordings if r.role == "fit"])
    with workers(jobs, scheduler) as pool:
        kept = Keep(keep, posed)
        first = _smoothed(posed, kept, say)
        if not first.solver.converged:
            raise InputError(
                f"diagnose: the model as it is could not be smoothed ({first.solver.status.rstrip('.')}); give better guesses."
            )
        search = Search(problem=posed, model=problem.model, result=first, say=say, pool=pool, kept=kept)
        search.run()
    verdict = search.verdict()
    notes = [split] if split else []
    held_out = None
    if search.findings and search.model is not problem.model:
        say("proof on what was held out")
        pair = (replace(posed, recordings=recordings), first), (replace(search.problem, recordings=recordings), search.result)
        try:
            held_out = prove(*pair, role="held_out" if split is None else "last third", progress=say)
        except (SolveError, InputError) as error:
            notes.append(f"What was held out could not be predicted: {error}")
    return Diagnosis(
        verdict=verdict,
        findings=tuple(search.findings),
        before=first,
        after=search.result,
        repaired=replace(search.problem, model=search.model, recordings=recordings),
        held_out=held_out,
        undetectable=tuple(search.undetectable),
        tried=tuple(search.tried),
        mismatch=(*mismatches(first), *(mismatches(search.result) if search.findings else ())),
        seconds=time.perf_counter() - began,
        seed=seed,
        notes=(*notes, *search.notes),
    )


def _smoothed(problem: Problem, kept: Keep, say: Progress) -> Smoothing:
    """The model as it is."""
    say("the model as it is")
    name = kept.name("the model as it is")
    part = kept.get(name)
    if part is None:
        result = smooth(problem, progress=say)
        part = result, result.solution
        kept.put(name, part)
    first: Smoothing = replace(part[0], solution=part[1])
    return first
