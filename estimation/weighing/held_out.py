"""What was held out as the judge of the weights: smoothed with the parameters of the best ones.

A judge whose own noise is another one would speak for weights that are as large as it needs. So samples that lie far off are left out, and
where what is left over is more than TIMES what V says, or less than a part of that, V is there what its own samples tell: a setting then
turns that, and is judged by how it leaves the fitted recordings' best behind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..problem import Problem
from ..smoothing.smoother import smooth
from .estimated import Estimated
from .likelihood import Likelihood
from .setting import values_of
from .turned import Turned, turned

TIMES = 2.0  # of an output's noise


@dataclass(frozen=True, kw_only=True)
class Judge:
    """The knobs of what was held out, None where nothing was or it could not be smoothed, and sentences."""

    knobs: Turned | None = None
    notes: tuple[str, ...] = ()


def judging(told: Estimated, best: Problem, say: Callable[[str], None] | None) -> Judge:
    """best: the opened problem with the weights of greatest likelihood. A std of the knobs is that of the fitted recordings."""
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
    notes, apart = list[str](), _apart(knobs)
    if apart:
        V = {name: std for name, std in best.weights.V.items() if name.split(" [")[0] not in apart}
        untold = [replace(r, output_std={**r.output_std, **dict.fromkeys(apart)}) for r in held_out]
        result = smooth(replace(fixed, recordings=untold, weights=replace(fixed.weights, V=V)), progress=say)
        if not result.solver.converged:
            return Judge()
        knobs = turned(fixed, result)
        for name, times in apart.items():
            noise = f"What was held out has {times:.2g} times the noise of {name} that V says"
            notes.append(f"{noise}: it judges V of {name} by what its own samples tell.")
    if knobs.outliers:
        notes.append(f"{knobs.outliers} samples of what was held out lie far off, and judge nothing.")
    stds = told.knobs.stds(told.best.theta)
    own = tuple(replace(w, std=stds.get(w.label, w.std)) for w in knobs.weights)
    return Judge(knobs=replace(knobs, weights=own), notes=tuple(notes))


def _apart(knobs: Turned) -> dict[str, float]:
    """Output -> how many times the noise that V says it has, where that is far from one."""
    theta = np.zeros(len(knobs.weights))
    likelihood = Likelihood(knobs.solved(theta), [knobs.rows(f, theta) for f in range(len(theta))])
    return {
        w.name: float(times)
        for w, times in zip(knobs.weights, likelihood.ratio, strict=True)
        if w.is_noise and not 1.0 / TIMES < times < TIMES and np.isfinite(times)
    }
