"""How far outputs are off: what residual forces do not take, since they have no room for it, or since two sensors read one rigid motion."""

from __future__ import annotations

import casadi as ca

from ...problem import Problem
from ...results import Smoothing
from ...smoothing.horizons import shown_noise

OFF = 3.0  # times its noise, rms: an output that is further off contradicts another one
NEARER = 0.5  # times as far off: then what was contradicted is explained


def off(problem: Problem, result: Smoothing, *, contradicting: bool = False) -> float:
    """Rms of what an output is off over its noise, as the study has it or its samples show it beyond doubt; the largest one.

    contradicting: of outputs that are recorded with more than the states tell apart, by the structure of their equations; 0 where there
    are none.
    """
    dae, shown, found = problem.dae, shown_noise(problem)[0], [0.0]
    for row, piece in zip(shown, problem.fitted, strict=True):
        read = [i for i, q in enumerate(dae.outputs) if q.name in piece.outputs]
        if contradicting and ca.sprank(ca.jacobian(dae.output[read], ca.vertcat(dae.x, dae.z, dae.w))) == len(read):
            continue
        for i in read:
            q = dae.outputs[i]
            if (fit := result.fit.get(piece.name, {}).get(q.name)) is not None:
                size = problem.weights.noise(q.name, piece) or max(q.noise_std or 0.0, row[i])
                found.append(fit.ordinary.rms / size if size > 0 else 0.0)
    return max(found)
