"""Which settings a study solves: candidates for the recommendation, the trade-off of W against V, and every weight by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .setting import Group, Setting
from .turned import Weight

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ALONE = (0.1, 1 / 3, 3.0, 10.0)  # factors on one std
TOGETHER = tuple(10.0 ** (k / 2) for k in range(-4, 5) if k)  # on the stds of all residual forces
STAGES = tuple(10.0**k for k in (2, 1, -1, -2))  # on all that holds the parameters: weak first
DIGITS = 6  # of a theta: what tells settings apart


def settings(weights: Sequence[Weight], candidates: Mapping[str, Array], about: Array) -> list[Setting]:
    """All settings; candidates: name -> theta (F,). Paths lead through the candidate `about`."""
    found = [Setting(name=name, group="candidate", theta=_rounded(theta)) for name, theta in candidates.items()]
    forces = np.array([w.kind == "W" for w in weights])
    holding = np.array([w.kind in ("drift", "prior") for w in weights])
    paths: tuple[tuple[Group, str, Array, tuple[float, ...]], ...] = (
        ("trade-off", "W", forces, TOGETHER),
        ("stage", "what holds the parameters", holding, STAGES),
    )
    for group, what, which, factors in paths:
        for factor in factors if which.any() else ():
            at = _rounded(np.where(which, about + np.log(factor), about))
            found.append(Setting(name=f"{what} x {factor:.3g}", group=group, theta=at, factor=factor))
    for f, weight in enumerate(weights):
        for factor in ALONE if weight.is_component else ():
            theta = about.copy()
            theta[f] += np.log(factor)
            found.append(
                Setting(name=f"{weight.label} x {factor:.3g}", group="weight", theta=_rounded(theta), varied=weight.label, factor=factor)
            )
    return found


def _rounded(theta: Array) -> tuple[float, ...]:
    return tuple(np.round(theta, DIGITS).tolist())
