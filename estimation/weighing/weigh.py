"""A study of the weighting matrices: what the data say of W and V, and what hangs on them.

problem with W and V left out -> smoothed -> likelihood of the weights -> what moves with them -> settings side by side -> recommended

The study is made on one mesh, with weights that the data told at first: given ones may be so far off that nothing can be seen with them.
What is recommended is smoothed once more as a user would.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import numpy as np

from ..problem import Problem
from ..recordings.split import with_held_out
from ..results import Smoothing
from ..smoothing.smoother import smooth
from ..workers import at_hand, workers
from .chosen import chains as chosen_chains
from .chosen import check_labels, checked, labels_of
from .components import Component, Found
from .estimated import components, doubts, estimated, opened, with_weights
from .held_out import judging
from .identity import identity
from .kkt import sensitivity
from .magnitude import magnitudes, sizes
from .plan import ALONE, settings
from .recommendation import FIRST, GIVEN, LIKELIHOOD, RULE, alike, likeliest, recommended
from .setting import Outcome, Setting, Stand
from .side_by_side import side_by_side
from .tightening import tightened
from .turned import Turned
from .words import of_each, unreliable, words

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Weighing:
    """What a study of the weights found.

    recommended: the problem smoothed with the weights that it recommends, which are `recommended.weights`; chosen: the setting that they
    come from; why: a sentence.
    components: weight -> what the data tell of it. moves: weight -> parameter -> by how many of its stds it lies elsewhere with a tenth and
    with ten times the weight's std, as solved; NaN where that did not converge, or to parameters of another kind. slopes: the same to first
    order, for an e-fold std, of the parameters most probable together with a trajectory; state_slopes: of every state, the rms over time.
    outcomes: of all settings. forces: place -> rms of the largest force there. arrived: whether the search for the greatest likelihood did.
    notes: what the study says in words. varied: label of a weight -> the factors that the user wanted to see, in ascending order.
    """

    recommended: Smoothing
    chosen: str
    why: str
    components: Mapping[str, Component]
    correlation: Mapping[tuple[str, str], float]
    moves: Mapping[str, Mapping[str, tuple[float, float]]]
    slopes: Mapping[str, Mapping[str, float]]
    state_slopes: Mapping[str, Mapping[str, float]]
    outcomes: tuple[Outcome, ...]
    forces: Mapping[str, float]
    arrived: bool
    notes: tuple[str, ...]
    problem: Problem
    varied: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def best(self) -> Outcome:
        """Of the chosen setting."""
        return next(o for o in self.outcomes if o.setting.name == self.chosen)


def weigh(
    problem: Problem,
    *,
    vary: Mapping[str, Iterable[float]] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Weighing:
    """Study the weights of a problem.

    vary: label of a weight, "W of <place>", "V of <output>", "drift of <parameter>" or "prior of the parameters" -> factors on its std of
    greatest likelihood, to be solved beside the rest: one weight along a path, several in all combinations (`chosen.py`).
    jobs: processes of this machine; scheduler: address of a Dask cluster instead. keep: a folder where finished settings stay, so that an
    interrupted study goes on. Raises InputError where the problem cannot be smoothed at all, or with none of the candidates, and where
    `vary` names no weight of it.
    """
    say = progress or (lambda _: None)
    wanted = _wanted(problem, vary)
    ahead = at_hand(jobs, scheduler)
    with workers(jobs, scheduler) as pool:
        recordings, split = with_held_out(problem.recordings)
        told = estimated(replace(problem, recordings=recordings), say)
        posed, knobs, best, theta, given = told.posed, told.knobs, told.best, told.best.theta, told.given
        say("smoothing what was held out")
        untold = knobs.noise & ~best.moving  # the same for all
        candidates = {FIRST: np.where(untold, theta, 0.0)}
        if np.isfinite(given).any():
            candidates[GIVEN] = np.where(np.isnan(given), theta, given)
        others = list(candidates.values())  # the rule of magnitudes knows nothing of noise
        judged = pool.submit(judging, told, with_weights(told.whole, knobs, theta), others, say if ahead == 1 else None)
        force = sizes(posed, best.solution)
        candidates = {LIKELIHOOD: theta, RULE: magnitudes(knobs, posed, force), **candidates}
        # what is varied comes last: whatever it is, all else stays as it was
        chains = [*settings(knobs.weights, candidates, theta), *chosen_chains(wanted, knobs.weights, theta)]

        def at(setting: Setting) -> Problem:
            return with_weights(told.whole, knobs, np.array(setting.theta))

        def stand() -> Stand:
            return Stand(fitted=knobs, held_out=judged.result().knobs, start=best.solution.solved.decisions)

        # most often those are recommended: with several workers this goes beside the settings
        leading = next(s for s in chain.from_iterable(chains) if s.name == LIKELIHOOD)
        begun = None if ahead == 1 else pool.submit(smooth, at(leading))
        doubted = identity(knobs, None, best.solution.solved.decisions)
        answers, outcomes = side_by_side(doubts(told), doubted, stand, chains, pool, ahead, keep, say)
        chosen, why = recommended(outcomes, held_out=any(r.role == "held_out" for r in recordings))
        say("smoothing with the recommended weights")
        ready = begun if chosen.setting == leading else None
        result = smooth(at(chosen.setting), progress=say) if ready is None else ready.result()
    slopes, state_slopes = _slopes(knobs, best)
    found = Weighing(
        recommended=result,
        chosen=chosen.setting.name,
        why=unreliable(best.arrived, result.notes) + why,
        components=components(told, answers),
        correlation=_correlation(knobs, best),
        moves=_moves(outcomes),
        slopes=slopes,
        state_slopes=state_slopes,
        outcomes=tuple(outcomes),
        forces=force,
        arrived=best.arrived,
        notes=(),
        problem=problem,
        varied=wanted,
    )
    beside = [f"{knobs.outliers} samples that lie far off are left out of the study, the same ones at all weights."][: knobs.outliers]
    said = *words(found), *of_each(found), *judged.result().notes, *tightened(found), *beside, *_of_the_fit(found)
    return replace(found, notes=(*([split] if split else []), *said))


def _wanted(problem: Problem, vary: Mapping[str, Iterable[float]] | None) -> dict[str, tuple[float, ...]]:
    """The factors, checked before anything is solved."""
    wanted = checked(vary)
    if wanted:
        check_labels(wanted, labels_of(opened(problem).posed))
    return wanted


def _of_the_fit(found: Weighing) -> list[str]:
    """What smoothing with the recommended weights says, but for these, and for forces that the data do not tell from none.

    Of both the study itself speaks.
    """
    none = [label.removeprefix("W of ") for label, c in found.components.items() if label.startswith("W of ") and c.may_be_none]
    none = none if found.chosen == LIKELIHOOD else []
    told = tuple(f"residual.{place} " for place in none)
    told += tuple(f"{label.removeprefix('drift of ')} drifts by " for label in found.components if label.startswith("drift of "))
    return [note for note in found.recommended.notes if not note.startswith(told) and not re.match("[WV] of [^:]*: std", note)]


def _moves(outcomes: Sequence[Outcome]) -> dict[str, dict[str, tuple[float, float]]]:
    """Of every weight that is turned by itself, against the setting of greatest likelihood."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    best = likeliest(outcomes)
    alone = {(o.setting.varied, o.setting.factor): o for o in outcomes if o.setting.group == "weight"}
    if best is None:
        return found
    for label in dict.fromkeys(varied for varied, _ in alone):
        ends = [alone[label, factor] for factor in (min(ALONE), max(ALONE))]
        found[label] = {}
        for name, (value, std) in best.parameters.items():
            there = np.array([o.parameters.get(name, (np.nan, np.nan))[0] if alike(o, best) else np.nan for o in ends])
            tenth, tenfold = ((there - value) / std if 0 < std < np.inf else np.full(2, np.nan)).tolist()
            found[label][name] = float(tenth), float(tenfold)
    return found


def _slopes(knobs: Turned, best: Found) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Of the parameters, and the rms over all knots of those of the states."""
    solution, t = best.solution, best.solution.transcription
    slope, curvature, nx, n = sensitivity(solution, best.likelihood.pulls), solution.curvature, len(t.dae.states), t.nlp.trajectory_size
    if curvature is None:
        return {}, {}
    std = np.sqrt(curvature.parameter_variance)
    ends = np.sqrt(np.einsum("kii->ki", curvature.interval_covariance[:, :nx, :nx]))  # at the left end of every interval
    # what is on a bound, or known, does not move at all
    parameters = slope[n:] / np.where(std > 0, std, np.nan)[:, None]
    states = slope[t.nlp.index[:nx].T] / np.where(ends > 0, ends, np.inf)[:, :, None]
    names = [t.dae.parameters[i].name for i in t.nlp.free]
    moved = np.sqrt(np.mean(states**2, axis=0))
    return (
        {w.label: dict(zip(names, parameters[:, f].tolist(), strict=True)) for f, w in enumerate(knobs.weights)},
        {w.label: {q.name: float(moved[i, f]) for i, q in enumerate(t.dae.states)} for f, w in enumerate(knobs.weights)},
    )


def _correlation(knobs: Turned, best: Found) -> dict[tuple[str, str], float]:
    """Of the estimated logarithms of two weights."""
    covariance = best.covariance
    std = np.sqrt(np.diag(covariance))
    found = {}
    for f, a in enumerate(knobs.weights):
        for g, b in enumerate(knobs.weights[:f]):
            value = float(covariance[f, g] / (std[f] * std[g]))
            if np.isfinite(value):
                found[b.label, a.label] = value
    return found
