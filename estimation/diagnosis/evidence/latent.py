"""A force without a name at one place, where the model as it is does not come to rest without it.

An offset of a motor's voltage is seen in its current at once; where residual forces have the same share of the forces everywhere the
string and the bit, which nobody sees, have to make up for it, and go astray. With a force that remembers at the place that strains
(Ornstein-Uhlenbeck, as large as what is left over there) all else is found as if nothing were missing. It is no part of the model but the
rival of all that may be missing: that is scored where it led, and fitted from there, without it, and has to be better than it; where
nothing is, it is the force that nobody explains.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...problem import Problem, Weights
from ...results import Smoothing
from ...smoothing.begun import force_stds
from ...smoothing.horizons import sampling_interval
from ...smoothing.unseen import moving_unseen

LASTING = 50.0  # sampling intervals that it remembers: noise of single samples is none of it
STRAINS = 0.02  # of the forces at a place: with less left over than twice what all have room for it is not that place that strains
MISREAD = 0.5  # of the forces: where more is left over columns may be others than the study says
MOST = 2  # places that are tried


@dataclass(frozen=True, kw_only=True)
class Latent(Weights):
    """Weights with such a force. place: where; held: std of a white one there, where it is taken out; given: the weights without it."""

    place: str
    held: float
    given: Weights = field(default_factory=Weights)


def with_force(problem: Problem, place: str, rms: float, held: float) -> Problem:
    """The problem with such a force at a place. rms: how large [unit of the place]; held: as `Latent` has it."""
    given = problem.weights
    tau = LASTING * min(sampling_interval(r) for r in problem.fitted)
    W, times = {**given.W, place: rms}, {**given.tau, place: tau}
    return replace(problem, weights=Latent(W=W, V=given.V, tau=times, kind=given.kind, place=place, held=held, given=given))


def without_force(problem: Problem) -> Problem:
    """The problem as it is without one; the same where it has none."""
    return replace(problem, weights=problem.weights.given) if isinstance(problem.weights, Latent) else problem


def held_there(before: Problem, now: Problem) -> dict[str, float]:
    """Place -> std of a white force where a model had one that remembers, and has it no more."""
    latent = before.weights
    return {latent.place: latent.held} if isinstance(latent, Latent) and not isinstance(now.weights, Latent) else {}


def as_tight(problem: Problem, near: Smoothing, found: Smoothing) -> Problem:
    """The problem with the white force, where this one is taken out, held as tightly as others are in what was found, not as in `near`."""
    latent = problem.weights
    if not isinstance(latent, Latent) or near.solution is None or found.solution is None:
        return problem
    then, now = force_stds(near.solution), force_stds(found.solution)
    tighter = float(np.median([now[p] / then[p] for p in then.keys() & now.keys() - {latent.place}] or [1.0]))
    return replace(problem, weights=replace(latent, held=latent.held * tighter))


def straining(problem: Problem, near: Smoothing, left: dict[str, float]) -> list[tuple[str, Problem]]:
    """The places that strain most, each with the problem that has a force there. left: place -> share of its forces that is left over.

    None is a body that no output shows: a force there may be any.
    """
    if near.solution is None:
        return []
    plain = problem.plain
    unseen = {plain.dae.places[k].name for k in moving_unseen(plain)}
    held, given = force_stds(near.solution), {*problem.weights.W, *problem.weights.tau, *unseen}
    worst = sorted((p for p, share in left.items() if p in held and p not in given and STRAINS < share < MISREAD), key=lambda p: -left[p])
    return [(p, with_force(problem, p, near.residual_places[p].rms, held[p])) for p in worst[:MOST]]
