"""What the data tell of the weights of a problem: the greatest likelihood over all that make sense, with intervals and tests of zero.

problem with W and V left out -> smoothed -> likelihood of the weights on that mesh -> components
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from backsight.models.augmentation.parameters import case_name
from backsight.ocp import Options

from ..problem import Problem
from ..smoothing.horizons import check_varies
from ..smoothing.program import Settings
from ..smoothing.smoother import smoothing
from ..supposed import noisy_inputs
from .components import Component, Found, doubted, maximise
from .likelihood import bends
from .turned import Turned, turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Progress = Callable[[str], None]

ROUGHLY = Options(tolerance=1e-3)  # of a smoothing whose last digits the weights do not feel
CONTRADICTED = 2.0  # nats that what is given costs, from which on the data speak against it: the edge of 95 % of one variance
FOLLOWED = 0.05  # of a sensor's samples: with fewer degrees of freedom left its noise cannot be told from forces


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """whole: the problem with its weights left open, posed: its fitted recordings; knobs: the weights on the mesh of their smoothing.

    given (F,): theta of weights that were given, else NaN; best: the greatest likelihood over those that could be sought.
    """

    whole: Problem
    posed: Problem
    knobs: Turned
    given: Array
    best: Found


def variance_components(problem: Problem, *, progress: Progress | None = None) -> dict[str, Component]:
    """What the fitted recordings tell of every weight: `W of <place>`, `V of <output>` -> std, interval, and whether it may be none.

    Where the search for the greatest likelihood does not arrive there are no intervals and no p: they are NaN.
    Raises InputError for a problem that cannot be posed.
    """
    say = progress or (lambda _: None)
    told = estimated(problem, say)
    answers = {}
    for label, doubt in doubts(told).items():
        answers[label] = doubt()
        say(without_line(label, answers[label]))
    return components(told, answers)


def estimated(problem: Problem, say: Progress) -> Estimated:
    """The weights of greatest likelihood of the fitted recordings."""
    check_varies(problem)
    whole = opened(problem)
    posed = replace(whole, recordings=[r for r in whole.recordings if r.role == "fit"])
    first = smoothing(posed, settings=Settings(marginal=False), progress=say)
    if not first.solver.converged and first.solution is not None:  # from near the end a way is found that was not from the start
        say("once more from where it stopped")
        first = smoothing(posed, settings=Settings(marginal=False, options=ROUGHLY), begin=first.solution, progress=say)
    knobs = turned(posed, first)
    say("weights from the likelihood")
    given = _given(problem, knobs)
    best = _likeliest(knobs, given, np.zeros(len(given)), say)
    if bends(best.solution):
        say("weights from the likelihood, at parameters of most marginal likelihood")
        knobs = replace(knobs, bent=True)
        best = _likeliest(knobs, given, best.theta, say)
    return Estimated(whole=whole, posed=posed, knobs=knobs, given=given, best=best)


def doubts(told: Estimated) -> dict[str, Callable[[], tuple[float, float]]]:
    """Label of every weight that may be none -> call that tells how probable that is, and its std at most; each stands by itself."""
    asked = [f for f, w in enumerate(told.knobs.weights) if w.is_component and not w.is_noise and told.best.arrived]
    return {told.knobs.weights[f].label: partial(doubted, told.knobs, told.best, f) for f in asked}


def without_line(label: str, answer: tuple[float, float]) -> str:
    """What is shown when one is answered."""
    return f"without {label}: p = {answer[0]:.2g}"


def components(told: Estimated, answers: Mapping[str, tuple[float, float]]) -> dict[str, Component]:
    """What the data tell of every weight; answers: what came of the doubts."""
    best, found = told.best, dict[str, Component]()
    spread = best.std if best.arrived else np.full(len(told.knobs.weights), np.nan)
    stds = told.knobs.stds(best.theta)
    for w, log_std in zip(told.knobs.weights, spread.tolist(), strict=True):
        if w.is_component:
            p, limit = answers.get(w.label, (None if w.is_noise else np.nan, np.nan))
            found[w.label] = Component(std=stds[w.label], log_std=log_std, p_zero=p, limit=limit, unit=w.unit)
    return found


def opened(problem: Problem) -> Problem:
    """The problem without W at its balances and V of its outputs; what only a given weight makes part of it stays.

    So does what recordings have of their own: V of an output that is not the same in all is turned in all of them together.
    """
    weights, plain = problem.weights, {p.name for p in problem.dae.places}
    W = {name: std for name, std in weights.W.items() if name not in plain or name in weights.tau}
    own = own_noises(problem)
    recordings = [replace(r, output_std={name: own.get(name, {}).get(r.name) for name in r.outputs}) for r in problem.recordings]
    return replace(problem, recordings=recordings, weights=replace(weights, W=W, V=noisy_inputs(problem)))


def with_weights(problem: Problem, knobs: Turned, theta: Array) -> Problem:
    """An opened problem with the weights theta, rates of drift among them."""
    stds, of_each = knobs.stds(theta), dict[str, float]()
    for output, own in own_noises(problem).items():
        of_each |= {case_name(output, recording): std for recording, std in own.items()}
    W, V = ({w.name: stds[w.label] for w in knobs.weights if w.kind == kind} for kind in ("W", "V"))
    for w, factor in zip(knobs.weights, np.exp(theta), strict=True):
        if w.own:
            each = {**{case: std for case, std in of_each.items() if case.startswith(f"{w.name} [")}, **dict(w.own)}
            V |= {case: std * float(factor) for case, std in each.items()}
    drifts = {w.name: stds[w.label] for w in knobs.weights if w.kind == "drift"}
    drifting = {name: replace(free, drift=drifts[name]) for name, free in problem.varying.items() if name in drifts}
    weights = replace(problem.weights, W={**problem.weights.W, **W}, V={**problem.weights.V, **V})
    return replace(problem, weights=weights, parameters={**problem.parameters, **drifting})


def own_noises(problem: Problem) -> dict[str, dict[str, float]]:
    """Output -> recording -> std that is given there, of those outputs of which it is not the same in all recordings that give one."""
    found: dict[str, dict[str, float]] = {}
    for recording in problem.recordings:
        for name in recording.outputs:
            if (std := problem.weights.noise(name, recording)) is not None:
                found.setdefault(name, {})[recording.name] = std
    return {name: own for name, own in found.items() if len(set(own.values())) > 1}


def _likeliest(knobs: Turned, given: Array, start: Array, say: Progress) -> Found:
    """The weights of greatest likelihood, from theta `start` (F,).

    A sensor whose samples the residual forces can all follow does not tell its noise from them: it keeps what is given, or was at first,
    unless the data contradict that; then it stays where the search had it.
    """
    moving = np.array([w.is_component for w in knobs.weights])
    best = maximise(knobs, start, moving, say=say)
    while True:
        share = np.where(moving & knobs.noise, best.likelihood.freedom / np.maximum(best.likelihood.counts, 1), np.inf)
        f = int(np.argmin(share))
        if not share[f] < FOLLOWED:
            return best
        theta, moving = best.theta.copy(), moving & (np.arange(len(moving)) != f)
        theta[f] = given[f] if np.isfinite(given[f]) else 0.0
        held = maximise(knobs, theta, moving, say=say)
        lost = best.likelihood.value - held.likelihood.value
        refused = not np.isfinite(lost) or (held.arrived and lost >= CONTRADICTED)
        best = maximise(knobs, best.theta, moving, best.likelihood, say=say) if refused else held


def _given(problem: Problem, knobs: Turned) -> Array:
    """theta (F,) of the weights that the problem gives, NaN of those that it leaves out."""
    stds = {f"W of {name}": std for name, std in problem.weights.W.items()}
    stds |= {f"drift of {name}": free.drift for name, free in problem.varying.items() if free.drift is not None}
    stds |= {f"V of {name}": std for name, std in problem.weights.V.items()}
    for r in problem.recordings:
        if r.role == "fit":
            stds |= {f"V of {name}": std for name in r.outputs if (std := problem.weights.noise(name, r)) is not None}
    kept = {f"V of {name}" for name in own_noises(problem)}
    stds |= {w.label: w.std for w in knobs.weights if w.label in kept}
    # of an output whose recordings differ by what the data say, one number is not what was given
    given = [w.label in stds and (not w.own or w.label in kept) for w in knobs.weights]
    return np.array([np.log(stds[w.label] / w.std) if there else np.nan for w, there in zip(knobs.weights, given, strict=True)])
