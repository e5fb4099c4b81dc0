"""Where a smoothing starts, from the samples or from a solution: trajectories, parameters, and what residual forces may be.

floor    so small that no machine's balance is as good
ceiling  on a body that no output shows: with a larger force the model says nothing about it, or a hypothesis is that of any force
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from backsight.ocp.follow import Followed

from ..problem import Problem
from .along import RIGID, exact_forces, white_forces
from .approach import NEAR, TIGHTEST, Approach, approach
from .begun import Begun
from .initial_guess import balance
from .meshing import follow_closely
from .program import Settings
from .rest import FrictionLaw
from .robust import Losses
from .unseen import moving_unseen, unseen_states

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Stds = list[dict[str, float]]

SUPPOSED = 0.5  # of the forces at a body that only a hypothesis has and no output shows: a larger residual force there explains for it
WILD = 3.0  # of the forces at any body that no output shows: with a larger residual force the model says nothing about it
TIGHT = 0.03  # of the residual forces that an approach ends with: as loose as these are trajectories go to gross outliers, and stay


@dataclass(frozen=True, kw_only=True)
class Start:
    """Trajectories and parameters (np_all,) that a smoothing starts with; place -> std of its residual force, the least and the most of it.

    strengths: place -> of the laws that residual forces have room for near rest, where it starts from a solution.
    """

    followed: Followed
    parameters: Array
    force_std: dict[int, float]
    floor: dict[int, float] = field(default_factory=dict)
    ceiling: dict[int, float] = field(default_factory=dict)
    strengths: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _Gone:
    """A way from the samples to the model, of a problem and a mesh step."""

    plain: weakref.ref[Problem]
    step: float | None
    way: Approach


_gone = list[_Gone]()  # the last one: a problem that is smoothed again with weights chosen in another way begins where it ended


def _followed(plain: Problem, stds: Stds, settings: Settings, say: Callable[[str], None]) -> Followed:
    say("following the samples")
    return follow_closely(plain, stds, settings.step)


def from_samples(plain: Problem, stds: Stds, laws: tuple[FrictionLaw, ...], settings: Settings, say: Callable[[str], None]) -> Start:
    """Trajectories that follow the samples, and then the model."""
    tight = TIGHT if settings.weigh and Losses.of(plain) is not None else 1.0
    if not (plain.free or unseen_states(plain)):
        followed = _followed(plain, stds, settings, say)
        held = balance(plain, followed, plain.values).force_std
        return Start(followed=followed, parameters=plain.values, force_std={k: tight * std for k, std in held.items()})
    given = {k: plain.weights.W[p.name] for k, p in enumerate(plain.dae.places) if p.name in plain.weights.W}
    last = next((gone for gone in _gone if gone.plain() is plain and gone.step == settings.step), None)
    if last is None:
        way = approach(plain, _followed(plain, stds, settings, say), laws, plain.values, given, say)
        _gone[:] = [last := _Gone(plain=weakref.ref(plain), step=settings.step, way=way)]
    begun = last.way
    exact = exact_forces(plain, begun.followed, begun.parameters)
    # where a way stopped short its forces say nothing
    hidden = moving_unseen(plain) & begun.force_std.keys() - given.keys() if begun.share <= NEAR else set[int]()
    return Start(
        followed=begun.followed,
        parameters=begun.parameters.copy(),
        force_std={k: tight * std for k, std in begun.force_std.items()},
        floor={k: min(RIGID * begun.whole[k], exact[k]) for k in begun.force_std},
        ceiling={k: WILD * begun.whole[k] for k in hidden},
    )


def from_solution(problem: Problem, plain: Problem, begin: Begun, supposed: Collection[str]) -> Start:
    """What a solution of the same recordings is for this problem. supposed: names of places that only a hypothesis has."""
    names = [p.name for p in problem.dae.places]
    parameters = begin.start(problem)
    exact, whole = (of(problem, begin.followed, parameters) for of in (exact_forces, white_forces))
    # a place that only this model has gets the share of its forces that an approach ends with
    force_std = {k: begin.force_std.get(names[k], TIGHTEST * size) for k, size in whole.items()}
    hidden = {k for k in moving_unseen(plain) if names[k] not in problem.weights.W}
    new = {k for k in hidden if names[k] in supposed or names[k] not in begin.force_std}
    return Start(
        followed=begin.followed,
        parameters=parameters,
        force_std=force_std,
        floor={k: min(std, exact[k]) for k, std in force_std.items()},
        ceiling={k: (SUPPOSED if k in new else WILD) * whole[k] for k in hidden},
        strengths={k: begin.at_rest[name] for k, name in enumerate(names) if name in begin.at_rest},
    )
