"""Which settings a study solves: candidates for the recommendation, the trade-off of W against V, and every weight by itself.

What holds the parameters, drift and priors, goes from weak to tight in stages, and each begins where the one before arrived.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .setting import Group, Setting
from .turned import Weight

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ALONE = (0.1, 1 / 3, 3.0, 10.0)  # factors on one std
TOGETHER = tuple(10.0 ** (k / 2) for k in range(-4, 5) if k)  # on the stds of all residual forces
STAGES = (100.0, 10.0, 0.1, 0.01)  # on all that holds the parameters: weak first
DIGITS = 6  # of a theta: what tells settings apart


def settings(weights: Sequence[Weight], candidates: Mapping[str, Array], about: Array) -> list[list[Setting]]:
    """All settings, in chains of which each one's solution is where the next one starts; candidates: name -> theta (F,).

    Paths lead away from the candidate `about`, to smaller and to larger ones; the stages are one path past it.
    """
    found = [[Setting(name=name, group="candidate", theta=rounded(theta))] for name, theta in candidates.items()]
    forces = np.array([w.kind == "W" for w in weights])
    holding = np.array([w.kind in ("drift", "prior") for w in weights])
    paths: tuple[tuple[Group, str, Array, Iterable[Sequence[float]]], ...] = (
        ("trade-off", "W", forces, _ways(TOGETHER)),
        ("stage", "what holds the parameters", holding, (STAGES,)),
    )
    for group, what, which, ways in paths:
        for way in ways if which.any() else ():
            at = [rounded(np.where(which, about + np.log(factor), about)) for factor in way]
            found.append([Setting(name=f"{what} x {s:.3g}", group=group, theta=t, factor=s) for s, t in zip(way, at, strict=True)])
    for f, weight in enumerate(weights):
        alone = np.arange(len(weights)) == f
        for way in _ways(ALONE) if weight.is_component else ():
            at = [rounded(np.where(alone, about + np.log(factor), about)) for factor in way]
            label = weight.label
            chain = zip(way, at, strict=True)
            found.append([Setting(name=f"{label} x {s:.3g}", group="weight", theta=t, varied=label, factor=s) for s, t in chain])
    return found


def once(chains: Iterable[Sequence[Setting]]) -> list[list[Setting]]:
    """The chains without what they have already had: settings of one theta are one, whatever their names."""
    had, found = set[tuple[float, ...]](), list[list[Setting]]()
    for chain in chains:
        found.append([])
        for setting in chain:
            if setting.theta not in had:
                had.add(setting.theta)
                found[-1].append(setting)
    return [chain for chain in found if chain]


def _ways(factors: tuple[float, ...]) -> tuple[list[float], list[float]]:
    """Down from one, and up."""
    return sorted((s for s in factors if s < 1), reverse=True), sorted(s for s in factors if s > 1)


def rounded(theta: Array) -> tuple[float, ...]:
    """What tells one theta from another."""
    return tuple(np.round(theta, DIGITS).tolist())
