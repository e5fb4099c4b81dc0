"""A candidate as a full problem: the edited model with its parameters free beside those of the base model, smoothed anew.

Weights that the base problem leaves open are chosen again, so what the candidate explains leaves the residual forces. It starts where the
base model arrived (`smoothing/begun.py`), or as any study from the guesses (`anew`), and then goes on where its limit of iterations left
it. On a body that no output shows no candidate has more of a residual force than the model without it, which it holds: where weights have
several ends, that of large forces would explain for it, or against it.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from backsight.models import Dae, Model, compile_model
from backsight.models.augmentation.parameters import without_case
from backsight.models.errors import InputError, ModelError, OutOfTime, SolveError
from backsight.models.gauges import Gauges
from backsight.ocp import Options, Solution

from ...problem import Free, Known, Problem
from ...results import Smoothing
from ...smoothing.begun import Begun, followed_by, force_stds
from ...smoothing.horizons import sampling_interval
from ...smoothing.program import Settings
from ...smoothing.rest import friction_laws, other_widths
from ...smoothing.smoother import smoothing
from ...smoothing.unseen import moving_unseen
from ...supposed import left_out
from ..candidates.candidate import Candidate
from ..candidates.edits import Change
from ..candidates.memory import remembered
from ..evidence.held import rescaled
from ..evidence.latent import held_there, without_force
from ..evidence.offsets import counted_out, with_those_of
from ..evidence.worth import NONE, Worth
from ..scores.screen import Screened

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


FAILURES = (InputError, SolveError, ArithmeticError, np.linalg.LinAlgError)  # of a smoothing whose model may be wrong
HOPELESS = 1.5  # times the base model's cost: a coupling that leaves more at its weights, from where a fit starts, is none
PLAINLY = 100.0  # nats: a coupling that gains so much where it has not come to rest has not been fitted for nothing
ONWARD = 3  # times that a fit from the guesses, or of a coupling, goes on where its limit of iterations left it, at most
SHARE = 0.9  # of the way to where a parameter cannot be: by no more does a fit begin with it changed
HOLDING = ("coulomb_friction", "stribeck_friction")
PATIENT = Options(
    tolerance=1e-2, gauss_newton_iterations=200, max_iterations=100, seconds=120.0
)  # a hundredth of a deviation is near enough, and friction is rough; what has not come to rest by then is left there
THERE = Options(gauss_newton_iterations=0, max_iterations=0, hopeless=0.0)  # no step at all
QUICKLY = Settings(check_mesh=False, finest=1.0, hasty=True, options=Options(tolerance=1e-2, gauss_newton_iterations=15, max_iterations=40))
HELD = Settings(check_mesh=False, finest=1.0, weigh=False, options=Options(tolerance=1e-2, gauss_newton_iterations=40, max_iterations=40))


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A candidate after its fit. model: with it; failed: why there is no result; late: for want of time, or why there is no better one.

    gain: nats over the model without it, and their doubt (`worth.py`) where no score tells what they are worth. spared: nats more in a
    model without what was found before and is idle beside it; beside: how many effects stay.
    """

    candidate: Candidate
    problem: Problem | None = None
    model: Model | None = None
    result: Smoothing | None = None
    worth: Worth = NONE
    failed: str = ""
    late: bool = False
    gain: float = -np.inf
    doubt: float = 0.0
    spared: float = 0.0
    beside: int = 0

    @property
    def ends_with(self) -> float:
        """Nats gained in the end."""
        return self.gain + self.spared

    @property
    def whole(self) -> Smoothing | None:
        """The result with its solution, which a result alone leaves behind where it comes from another process."""
        return None if self.result is None else replace(self.result, solution=self.worth.solution)


def evidence(problem: Problem, result: Smoothing, *, ended: bool = True) -> float:
    """Log evidence; -inf where there is none. Of a parameter or a first state of which nothing is known, as much is as one sample tells.

    ended: there is none either where the solver has not come to rest.

    With p ~ N(p^, n std^2) (unit information: R. E. Kass, L. Wasserman, J. Amer. Statist. Assoc. 90, 1995) for the even spread over its
    nominal size of `Criteria`, evidences do not hang on units: two names of one effect, in N and in m/s, have the same.
    """
    c = result.criteria
    if (ended and not result.solver.converged) or c is None or c.log_evidence is None:
        return -np.inf
    total = c.log_evidence + c.first_states
    for info in problem.posed.dae.parameters:
        found, given = result.parameters.get(info.name), problem.parameters.get(without_case(info.name))
        if isinstance(given, Free) and given.std is None and found is not None and found.std and not found.on_bound:
            size = abs(info.nominal) or abs(info.value) or 1.0
            total += float(np.log(size / found.std) - 0.5 * np.log(2.0 * np.pi * c.samples))
    return total + counted_out(result)[0]


def worth_of(problem: Problem, result: Smoothing, *, weighed: bool, ended: bool = False) -> Worth:
    """What a model is worth beside others.

    weighed: with weights from the data, not held ones. ended: nothing where the solver has not come to rest.
    """
    nats, more, factor = evidence(problem, result, ended=ended), 0.0, 1.0
    if not weighed and result.solution is not None and (result.solver.converged or not ended):
        more, factor = rescaled(result.solution)
    return Worth(nats=nats + more, solution=result.solution, factor=factor)


def comparable(problem: Problem, result: Smoothing) -> bool:
    """Whether a result has an evidence that others can be held against, come to rest or not."""
    return bool(np.isfinite(evidence(problem, result, ended=False)))


def posed(problem: Problem, model: Model, candidate: Candidate, start: Mapping[str, float]) -> tuple[Problem, Model]:
    """The problem with a candidate in its model, instead of a latent force (`latent.py`). start: parameter -> where it begins."""
    problem, edited = without_force(problem), candidate.edited(model)
    parameters: dict[str, Free | float] = dict(problem.parameters)
    places = [name for name in problem.weights.W if name in {p.name for p in compile_model(edited).dormant_places}]
    dae = with_those_of(problem, compile_model(edited, places=places) if places else compile_model(edited))
    info = {p.name: p for p in dae.parameters}
    for base, taken in candidate.absorbs.items():
        given = parameters.get(base, 0.0)
        if base in info:
            parameters[base] = 0.0 if taken else given.guess if isinstance(given, Free) else given
    for name in list(parameters):
        if name not in info:
            del parameters[name]
    for name, factor in candidate.beside.items():
        if isinstance(free := parameters.get(name), Free):
            parameters[name] = replace(free, guess=float(np.clip(factor * free.guess, free.min, free.max)))
    room = {change.name: _room(change, parameters.get(change.path)) for change in candidate.changes}
    for name in (*candidate.strengths, *candidate.start):
        guess, low, high = candidate.start.get(name, (info[name].value, info[name].minimum, info[name].maximum))
        low, high = max(low, info[name].minimum), min(high, info[name].maximum)
        value = np.clip(start.get(name, guess), *room.get(name, (-np.inf, np.inf)))
        parameters[name] = Free(float(np.clip(value, low, high)), low, high)
    now = replace(problem, model=dae, parameters=parameters, initial=known_of(problem, dae, remembered(problem, candidate)))
    return (_put_somewhere(now, candidate) if problem.split.stands or left_out(problem) else now), edited


def _room(change: Change, given: Free | float | None) -> tuple[float, float]:
    """By how much a parameter may change where a fit begins: not to where it cannot be, from the value that the study has of it."""
    if given is None:
        return -np.inf, np.inf
    value = given.guess if isinstance(given, Free) else given
    return SHARE * (change.least - value), SHARE * (change.most - value)


def _put_somewhere(problem: Problem, candidate: Candidate) -> Problem:
    """Of a machine that stands anywhere without the candidate, the problem with that candidate's phases and positions where fits begin.

    Where the machine stands is told from there then; both could be shifted alike.
    """
    lean, own = problem.split, {*candidate.strengths, *candidate.start}
    along = [i for i in lean.free if lean.dae.parameters[i].name in own]
    if not along:
        return problem
    piece = lean.fitted[0]
    held = Gauges(lean.dae, lean.values, along).taken_along(piece.outputs, lean.known_at(piece))
    given = {lean.dae.parameters[along[k]].name: float(lean.values[along[k]]) for k in held}
    return replace(problem, parameters={**problem.parameters, **given})


def known_of(problem: Problem, dae: Dae, more: Mapping[str, Known] | None = None) -> dict[str, float | Known]:
    """What is known of the start, of the states that another model has: an edit may make another one stand for a joint. more: beside it."""
    states = {q.name for q in dae.states}
    return {name: value for name, value in {**(more or {}), **problem.initial}.items() if name in states}


def begun(candidate: Candidate, screened: Screened | None, values: Mapping[str, float]) -> dict[str, float]:
    """Where the fit of a candidate starts, by its score and the base model's parameters."""
    start = {name: guess for name, (guess, _, _) in candidate.start.items()}
    if screened is None:
        taken = {name: values[base] for base, names in candidate.absorbs.items() if values.get(base) for name in names.split()}
        return taken | start
    start |= screened.look.shape
    if candidate.signals:
        return start | {name: start[name] * float(screened.estimate[0]) for name in candidate.grows}
    a = screened.estimate
    if candidate.quadrature:
        first, second = a[: len(a) // 2], a[len(a) // 2 :]
        size = float(np.hypot(first[0], second[0]))
        start[candidate.quadrature] = float(np.arctan2(second[0], first[0]))
        name = candidate.strengths[0]
        if candidate.ratio:
            level = sum(values[base] for base, taken in candidate.absorbs.items() if taken) or size
            start[name], start[candidate.ratio] = level, min(size / level, 0.9) if level > 0 else 0.5
        else:
            start[name] = size
        return start
    for name, value in zip(candidate.strengths, a, strict=True):
        start[name] = values.get(name, candidate.neutral(name)) + float(value)
    for base, names in candidate.absorbs.items():
        for name in names.split():
            if name in start:
                start[name] += values.get(base, 0.0)
    return start


def fitted(
    problem: Problem,
    model: Model,
    base: Smoothing,
    candidate: Candidate,
    start: Mapping[str, float],
    settings: Settings = QUICKLY,
    *,
    anew: bool = False,
) -> Fitted:
    """The candidate's problem smoothed, its parameters from `start`; base: the base model's smoothing, with its solution.

    anew: not from there, but from the problem's own guesses, as any study is; at the weights of that solution, where weights are held.
    A coupling that its limit of iterations left goes on where it is not plainly worse than the model that it holds. One whose contacts keep
    it from coming to rest counts all the same where it gains plainly.
    """
    begin = base.solution
    if begin is None:
        raise ValueError("a fit begins where a smoothing with its solution came to rest")
    end, late = time.monotonic() + settings.seconds, False
    try:
        now, edited = posed(problem, model, candidate, start)
        there, stood = None if anew else Begun.of(begin, now), held_there(problem, now)
        if there is not None and stood:
            there = replace(there, force_std={**there.force_std, **stood})
        weighed = now if settings.weigh else with_weights_of(begin, now, stood)
        if candidate.dear:
            settings = replace(settings, finest=max(settings.finest, _fineness(problem, begin)))
        if settings.weigh:
            settings = replace(settings, hopeless=HOPELESS * begin.solved.cost if candidate.dear else np.inf)
            unseen = hidden(problem)
            settings = replace(settings, most={name: std for name, std in force_stds(begin).items() if name in unseen})
        elif not (anew or stood):
            # at the same weights a model that holds another one costs no more
            settings = replace(settings, options=replace(settings.options, hopeless=begin.solved.cost))
        result = smoothing(weighed, settings=settings, begin=there)
        if anew:
            result, late = _gone_on(weighed, result, settings, ONWARD, end)
        if there is not None and (widths := _other_widths(now, result)):
            wider = replace(settings, widths=widths)
            again = _in_time(settled(weighed, result), wider, there, end)
            again, late = (None, True) if again is None else _gone_on(weighed, again, wider, 1, end)
            result = again if again is not None and again.solver.converged else result
        plain = False
        if candidate.dear and not result.solver.converged:

            def gained(there: Smoothing) -> float:
                return _gained(now, there, problem, base, settings)

            result, late = _gone_on(weighed, result, settings, ONWARD, end, lambda there: gained(there) > -PLAINLY)
            plain = not result.solver.converged and gained(result) > PLAINLY
    except (*FAILURES, ModelError, RuntimeError) as error:  # one candidate of many
        return Fitted(candidate=candidate, failed=str(error), late=isinstance(error, OutOfTime))
    worth = worth_of(now, result, weighed=settings.weigh, ended=not plain)
    return Fitted(candidate=candidate, problem=now, model=edited, result=result, worth=worth, late=late)


def _gone_on(
    problem: Problem, result: Smoothing, settings: Settings, times: int, end: float, hopeful: Callable[[Smoothing], bool] = lambda _: True
) -> tuple[Smoothing, bool]:
    """A smoothing that goes on where its limit of iterations left it, until it rests, so many times at most; and whether time was over.

    hopeful: whether one that has not come to rest is worth going on from. Where one cannot be done the one before stays.
    """
    for _ in range(times):
        if result.solver.converged or result.solution is None or not hopeful(result):
            break
        try:
            further = _in_time(settled(problem, result), settings, result.solution, end)
        except (*FAILURES, RuntimeError):
            break
        if further is None:
            return result, True
        result = further
    return result, False


def _in_time(problem: Problem, settings: Settings, begin: Solution | Begun, end: float) -> Smoothing | None:
    """One more smoothing, in what is left of the time until `end` [s of `time.monotonic`]; None where that is not enough."""
    left = end - time.monotonic()
    try:
        return smoothing(problem, settings=replace(settings, seconds=left), begin=begin) if left > 0 else None
    except OutOfTime:
        return None


def _gained(now: Problem, result: Smoothing, problem: Problem, base: Smoothing, settings: Settings) -> float:
    """Nats by which a model is more probable than the one it holds, though it may be better still: the least, but for its curvature."""
    return worth_of(now, result, weighed=settings.weigh).over(worth_of(problem, base, weighed=settings.weigh))


def _other_widths(problem: Problem, result: Smoothing) -> dict[str, float]:
    """Widths of friction laws with which it is worth another fit, for its own motion asks for them."""
    solution = result.solution
    if solution is None or not solution.solved.status.converged:
        return {}
    return other_widths(problem.posed, solution, followed_by(solution), moving_unseen(problem.plain))


def _fineness(problem: Problem, solution: Solution) -> float:
    """Sampling intervals in one of a solution's mesh: of the recording where these are fewest.

    A coupling of guessed stiffness asks for more than it has to tell; where one is kept the mesh is made anew.
    """
    pairs = zip(problem.fitted, solution.transcription.horizons, strict=True)
    return min(float(np.median(h.mesh.steps)) / sampling_interval(r) for r, h in pairs)


def beyond_all_bounds() -> np.errstate:
    """What is no machine's leads to numbers that none can hold; notes and what does not come to rest say so, and numpy need not."""
    return np.errstate(over="ignore", invalid="ignore")


@beyond_all_bounds()
def fitted_there(
    blob: bytes, candidate: Candidate, start: dict[str, float], settings: Settings, anew: bool, end: float, share: float = 1.0
) -> Fitted:
    """`fitted` in a worker, of the pickled (problem, model, smoothing, solution), in a share of the time until `end` (`time.time`)."""
    problem, model, base, solution = _shared(blob)
    left = min(settings.seconds, share * (end - time.time()))
    if left <= 0:
        return Fitted(candidate=candidate, failed="no time was left", late=True)
    return fitted(problem, model, replace(base, solution=solution), candidate, start, replace(settings, seconds=left), anew=anew)


@lru_cache(maxsize=1)
def _shared(blob: bytes) -> Any:
    return pickle.loads(blob)


def holds(c: Candidate, bodies: Collection[str]) -> bool:
    """Whether it may hold one of these bodies at rest."""
    return c.place in bodies and c.physics in HOLDING


def hidden(problem: Problem) -> set[str]:
    """Places of bodies of which no output tells."""
    plain = problem.plain
    return {plain.dae.places[k].name for k in moving_unseen(plain)}


def at_work(problem: Problem) -> set[str]:
    """Places of friction laws in the model, but of those whose strengths are fixed at nothing."""
    plain = problem.plain
    return {plain.dae.places[k].name for law in friction_laws(plain) for k in law.places}


def bared(problem: Problem, result: Smoothing) -> tuple[Problem, Solution]:
    """A problem and its solution as scores see them: where it came to rest, without a force that stands for what may be missing.

    Raises ValueError without a solution.
    """
    if (solution := result.solution) is None:
        raise ValueError("a smoothed model has its solution")
    plain = without_force(problem)
    if plain is problem:
        return problem, solution
    plain = settled(plain, result)
    posed = with_weights_of(solution, plain, held_there(problem, plain))
    try:
        there = smoothing(posed, settings=replace(HELD, options=THERE), begin=Begun.of(solution, posed)).solution
    except FAILURES:
        there = None
    return (plain, there) if there is not None else (problem, solution)


def with_weights_of(begin: Solution, problem: Problem, others: Mapping[str, float] | None = None) -> Problem:
    """The problem with the residual forces' deviations of a solution, of all places that both have. others: place -> another one."""
    places = {p.name for p in problem.posed.dae.places}
    W = {name: std for name, std in force_stds(begin).items() if name in places} | dict(others or {})
    return replace(problem, weights=replace(problem.weights, W=W | dict(problem.weights.W)))


def settled(problem: Problem, result: Smoothing) -> Problem:
    """The problem with what was found as its guesses; those that have a std say what was known before, and stay."""
    values, known = {p.name: p.value for p in result.parameters.values()}, dict(problem.parameters)
    for name, free in problem.parameters.items():
        if isinstance(free, Free) and free.std is None and name in values:
            known[name] = replace(free, guess=float(np.clip(values[name], free.min, free.max)))
    return replace(problem, parameters=known)
