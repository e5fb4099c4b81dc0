"""Whether recordings hold anything from which a parameter could be learned."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import casadi as ca
import numpy as np

from backsight.models import Dae, ModelError, SolveError
from backsight.models.analysis import equilibrium, operating_point
from backsight.models.errors import InputError

from ..wording import number
from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def check_excitation(recordings: Sequence[Recording], *, label: str, told: Callable[[], Collection[str]] = tuple) -> None:
    """Raise InputError when no input ever changes and no output moves beyond its noise, in any of the recordings, and that tells nothing.

    A constant input alone will do where the plant still moves: a motor that starts, a pendulum let go. told: the free parameters that a
    plant at rest tells (`told_at_rest`).
    """
    if any(np.ptp(u) > 0.0 for recording in recordings for u in recording.inputs.values()):
        return
    if any(_moves(y) for recording in recordings for y in recording.outputs.values()):
        return
    if told():
        return
    seen = ", ".join(f"{name} = {number(u[0])} throughout {r.name}" for r in recordings for name, u in r.inputs.items())
    raise InputError(
        f"{label}: every input is constant ({seen or 'there is no input'}) and no output moves, so no parameter can be identified; "
        "use a recording with excitation, or fix the parameters"
    )


def told_at_rest(dae: Dae, free: Sequence[str], values: Mapping[str, float], recordings: Sequence[Recording]) -> list[str]:
    """The free parameters that matter to a plant at rest: d F/dp or d h/dp differs from zero there, with x' = 0.

    A weight hangs in a spring, a constant force leans on it; an inertia or a damper is not felt. values: of all parameters that are given.
    """
    inputs = {q.name: float(np.mean(recordings[0].inputs[q.name])) for q in dae.inputs if q.name in recordings[0].inputs}
    try:
        held = {dae.states[j].name: 0.0 for _, j, _ in dae.kinematics}
        point = equilibrium(dae, inputs=inputs, parameters=values, held=held)
    except (ModelError, SolveError):
        try:  # free to rest anywhere, or nowhere with the guesses
            point = operating_point(dae, u=inputs, parameters=values)
        except (ModelError, SolveError):
            return list(free)
    rows = dae.undisturbed(ca.vertcat(dae.residual, dae.output))
    slopes = ca.Function("slopes", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], [ca.densify(ca.jacobian(rows, dae.p))])
    _, *rest = point.columns()
    felt = np.abs(np.asarray(slopes(np.zeros(len(dae.states)), *rest))).max(axis=0, initial=0.0)
    return [p.name for p, slope in zip(dae.parameters, felt, strict=True) if p.name in free and slope > 0]


def _moves(y: Array) -> bool:
    """Whether a signal varies by more than white noise would: y_k = n_k has std(y) = std(second differences)/sqrt(6)."""
    y = y[np.isfinite(y)]
    if y.size < 4:
        return bool(np.ptp(y) > 0.0)
    noise = float(np.std(np.diff(y, 2))) / np.sqrt(6.0)
    return bool(np.std(y) > 3.0 * noise + 1e-12 * np.max(np.abs(y)))
