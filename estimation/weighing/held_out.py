"""What was held out as the judge of the weights: smoothed with the parameters of the best ones.

A judge whose own noise is another one would speak for weights that are as large as it needs. So samples that lie far off are left out, and
where what is left over is more than TIMES what every V says that comes from the data or the user, or less than a part of that, V of that
output is not judged: it is what the judge's own samples tell, with every setting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from backsight.models.augmentation.parameters import without_case

from ..problem import Problem
from ..smoothing.smoother import smooth
from .estimated import Estimated
from .likelihood import likelihood
from .setting import values_of
from .turned import Turned, turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

TIMES = 2.0  # of an output's noise


@dataclass(frozen=True, kw_only=True)
class Judge:
    """The knobs of what was held out, those alone that it judges; None where nothing was or it could not be smoothed. And sentences."""

    knobs: Turned | None = None
    notes: tuple[str, ...] = ()


def judging(told: Estimated, best: Problem, others: Iterable[Array], say: Callable[[str], None] | None) -> Judge:
    """best: the opened problem with the weights of greatest likelihood; others: theta (F,) of what else may be right.

    A std of the knobs is that of the fitted recordings.
    """
    held_out = [
        replace(r, role="fit", output_loss={name: r.output_loss.get(name, "auto") for name in r.outputs})
        for r in best.recordings
        if r.role == "held_out"
    ]
    if not held_out:
        return Judge()
    found = values_of(told.best.solution)
    values = {p.name: found.get(p.name, p.value) for p in told.posed.dae.parameters}
    fixed = replace(best, recordings=held_out, parameters={**values, **best.varying})
    result = smooth(fixed, progress=say)
    if not result.solver.converged:
        return Judge()
    knobs = turned(fixed, result)
    notes, apart = list[str](), _apart(knobs, told, others)
    if apart:
        V = {name: std for name, std in best.weights.V.items() if without_case(name) not in apart}
        untold = [replace(r, output_std={**r.output_std, **dict.fromkeys(apart)}) for r in held_out]
        result = smooth(replace(fixed, recordings=untold, weights=replace(fixed.weights, V=V)), progress=say)
        if not result.solver.converged:
            return Judge()
        knobs = turned(fixed, result)
        for name, times in apart.items():
            notes.append(f"What was held out has {times:.2g} times the noise of {name} that V says: it does not judge V of {name}.")
    if knobs.outliers:
        notes.append(f"{knobs.outliers} samples of what was held out lie far off, and judge nothing.")
    stds = told.knobs.stds(told.best.theta)
    own = tuple(replace(w, std=stds.get(w.label, w.std)) for w in knobs.weights if not (w.is_noise and w.name in apart))
    return Judge(knobs=replace(knobs, weights=own), notes=tuple(notes))


def _apart(knobs: Turned, told: Estimated, others: Iterable[Array]) -> dict[str, float]:
    """Output -> how many times the noise that V says it has, where that is far from one, and from what all others say."""
    theta, labels = np.zeros(len(knobs.weights)), [w.label for w in told.knobs.weights]
    ratio = likelihood(knobs, theta, knobs.solved(theta)).ratio
    found = dict[str, float]()
    for w, times in zip(knobs.weights, ratio.tolist(), strict=True):
        if w.is_noise and np.isfinite(times):
            f = labels.index(w.label) if w.label in labels else None
            said = [1.0, *(float(np.exp(other[f] - told.best.theta[f])) for other in others if f is not None)]
            if not any(1.0 / TIMES < times / V < TIMES for V in said):
                found[w.name] = times
    return found
