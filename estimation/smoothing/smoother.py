"""Whole-horizon smoothing: states, residual forces and parameters of all recordings at once.

recordings -> follow the samples -> mesh -> program -> weights left out (iterated) -> a better mesh where it matters -> estimates
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from backsight.models.errors import InputError, SolveError
from backsight.ocp import Options, Solution

from ..arguments import check_kind
from ..holds import with_better_hold
from ..problem import Problem
from ..recordings.gaps import rates_note
from ..results import Smoothing
from .beforehand import blamed, freed
from .begun import Begun
from .delays import settled
from .horizons import check_varies, output_stds, shown_noise
from .lifted import lifted, measured_by
from .marginal import UNMOVED
from .outcome import outcome
from .prediction import predict
from .program import Settings
from .rest import friction_laws, smoothing_widths
from .start import from_samples, from_solution
from .unseen import moving_unseen, unseen_states
from .until import Until
from .variances import LEAST_NOISE
from .work import ROUGH, Work, to_the_end

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Stds = list[dict[str, float]]

SOON = 100  # steps with exact second derivatives to the start of a prediction, at most


def smooth(
    problem: Problem,
    *,
    settings: Settings | None = None,
    begin: Solution | Begun | None = None,
    progress: Callable[[str], None] | None = None,
) -> Smoothing:
    """Smooth the fitted recordings of a problem, and predict those that are held out.

    Weights that the problem leaves out are chosen from the data (`variances.py`). Returns the estimates even when the solver did not
    converge: `solver.converged` tells. settings: numerics (default: chosen). begin: a solution of the same recordings by a model with the
    same states and algebraic variables, or what a solution by another model is for this one (`begun.py`), from whose trajectories, weights
    and mesh it starts; guesses are taken for what they are, where no std makes them more than a start.
    Raises InputError for a problem that cannot be posed, OutOfTime after `settings.seconds`.
    """

    check_kind(problem, Problem, "smooth(...): the problem", "write smooth(Problem(model=..., recordings=[...]))")
    say = progress or (lambda _: None)
    check_varies(problem)
    if (note := rates_note([r for r in problem.recordings if r.role == "fit"])) is not None:
        say(note)
    result = smoothing(problem, settings=settings, begin=begin, progress=progress)
    if result.solver.converged or (plain := freed(problem)) is None:
        return result
    say("without what was given beforehand")
    plain = replace(plain, recordings=[r for r in plain.recordings if r.role == "fit"])
    try:
        without = smoothing(plain, settings=settings, begin=begin, progress=progress)
    except (SolveError, InputError):
        return result
    return replace(result, notes=(blamed(problem, without), *result.notes)) if without.solver.converged else result


def smoothing(
    problem: Problem,
    *,
    settings: Settings | None = None,
    begin: Solution | Begun | None = None,
    progress: Callable[[str], None] | None = None,
) -> Smoothing:
    """`smooth` as a part of something else: the recordings are known to tell something, and nothing is tried when it does not converge."""
    settings, say = settings or Settings(), progress or (lambda _: None)
    if settings.seconds < math.inf:
        settings = replace(settings, options=replace(settings.options, seconds=min(settings.options.seconds, settings.seconds)))
        say = Until(time.monotonic() + settings.seconds, say)

    first = Begun.at(begin) if isinstance(begin, Solution) else begin

    def once(posed: Problem, onward: Begun | None = None, how: Settings = settings) -> Smoothing:
        # what no output shows needs the whole way (`Work.apart`), and weights that are held are those of the start
        whole = onward is None or not settings.weigh or unseen_states(posed.plain)
        return _smoothed(posed, how, first if whole else onward, say)

    roughly = partial(once, how=replace(settings, check_mesh=False, marginal=False, options=_rougher(settings.options)))
    posed, result = with_better_hold(problem, lambda held: settled(held, once, roughly), once)
    if all(r.role == "fit" for r in posed.recordings) or not result.solver.converged:
        return result
    say("predicting what was held out")
    held_out, notes = predict(posed, result, partial(smoothing, settings=_of_heads(settings)))
    return replace(result, held_out=held_out, notes=(*result.notes, *notes))


def _of_heads(settings: Settings) -> Settings:
    """A start has a deviation of its own, far larger than a rough tolerance; and what is not found soon is found in pieces, or not."""
    options = _rougher(settings.options)
    return replace(settings, step=None, options=replace(options, max_iterations=min(options.max_iterations, SOON)))


def _rougher(options: Options) -> Options:
    return replace(options, tolerance=max(options.tolerance, ROUGH.tolerance))


def _smoothed(problem: Problem, settings: Settings, begin: Begun | None, say: Callable[[str], None]) -> Smoothing:
    began = time.perf_counter()
    asked, plain, problem = problem, problem.plain, problem.posed
    stds, open_outputs = output_stds(problem)
    laws, parameters, noise = friction_laws(plain), problem.values, LEAST_NOISE * shown_noise(problem)[0]
    if begin is None:
        begun = from_samples(plain, stds, laws, settings, say)
    else:
        stds = begin.with_noise(stds, open_outputs)
        begun = from_solution(problem, plain, begin, settings.supposed)
        # it may have been found to be less than samples seem to show
        noise = np.minimum(noise, [[table.get(q.name, np.inf) for q in problem.dae.outputs] for table in stds])
    followed, start = begun.followed, begun.parameters
    places = dict(enumerate(p.name for p in problem.dae.places))
    given = {k: problem.weights.W[name] for k, name in places.items() if name in problem.weights.W}
    force_std = {**begun.force_std, **given}
    along_it = plain if begin is None else problem  # what `followed` has the unknowns of
    for index, width in smoothing_widths(along_it, laws, followed, moving_unseen(plain)).items():
        parameters[index] = start[index] = settings.widths.get(problem.dae.parameters[index].name, width)
    parameters = measured_by(problem, parameters, start)
    work = Work(
        problem=problem,
        settings=settings,
        laws=laws,
        parameters=parameters,
        given=given if settings.weigh else force_std,
        open_outputs=tuple(open_outputs),
        say=say,
        floor=begun.floor,
        noise=noise,
        apart=begin is None and bool(plain.free and unseen_states(plain)) and to_the_end(settings),
        strengths=begun.strengths,
        ceiling={k: min(most, settings.most.get(places[k], np.inf)) for k, most in begun.ceiling.items()},
    )
    followed = followed if begin is not None else lifted(problem, plain, followed, start)
    run, build = work.run(followed, stds, force_std, start, begin)
    if work.apart and (UNMOVED in run.said or not run.choice.solution.solved.status.converged):
        say("parameters together with the trajectories")
        run, build = replace(work, apart=False).run(followed, stds, force_std, start, begin)
    build -= began
    return outcome(asked, run, build=build, seconds=time.perf_counter() - began - build)
