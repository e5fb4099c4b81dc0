"""The states of a plant, and their derivatives, straight from filtered samples: what equation-error methods regress on.

    h(x) = y                  solved for the states that the outputs show, sample by sample
    x_j = d/dt x_i            where the plant says that state j is the velocity of the shown position i
    x', z                     by differentiating once more; by the exact equations in which z appears

Differentiation is the filter's: it gives a signal and its first two derivatives. Outputs into which forces, inputs or x' enter
(accelerometers) are not used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.models.errors import InputError
from backsight.ocp.algebraic import algebraics_along
from backsight.ocp.columnwise import Columnwise, matrices

from ..problem import Problem
from ..recordings.drive import Hold
from ..recordings.recording import Recording
from ..wording import listed
from .sampling import complete_output, row_inputs, uniform_step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
NEWTON_STEPS = 20
SHOWN = 1e-9  # what may be missing of a state's unit vector in the row space of the outputs


@dataclass(frozen=True, kw_only=True)
class Filtered:
    """Signals (m, n), their first and second derivatives, all at the same n instants, and inputs (nu, n) that went through the same filter.

    rows: those of the recording that are away from the filter's transients.
    """

    signals: Array
    first: Array
    second: Array
    inputs: Array
    rows: slice


Filter = Callable[[Array, Array, Hold, float], Filtered]  # signals (m, n), inputs (nu, n) and how they are held, step [s]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """x', x (nx, M), z (nz, M) and u (nu, M) at the times t (M,); rows: which of the recording's. Unknown states are zero."""

    dx: Array
    x: Array
    z: Array
    u: Array
    t: Array
    rows: slice


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What the outputs show of the states: chosen are the states that they determine, x (nx, n) all of them, the others as they started.

    slopes (n, m, nx): of the outputs that were used, in units of their deviations.
    """

    chosen: tuple[int, ...]
    x: Array
    slopes: Array


def instantaneous(problem: Problem, recording: Recording) -> list[int]:
    """Indices of the recorded outputs that are functions of the states alone."""
    dae = problem.dae
    return [i for i, q in enumerate(dae.outputs) if q.name in recording.outputs and _of_states_only(dae, dae.output[i])]


def invert_outputs(problem: Problem, used: Sequence[int], y: Array, std: Array, times: Array) -> Shown:
    """h(x) = y (m, n) for the outputs `used`, by Gauss-Newton with least-norm steps at every instant from the model's start values."""
    dae = problem.dae
    h = dae.output[list(used)] / ca.DM(std)
    answers = [ca.densify(h), ca.densify(ca.vec(ca.jacobian(h, dae.x)))]
    function = Columnwise(ca.Function("shown", [dae.x, dae.p, dae.t], answers), (1,))
    n = y.shape[1]
    x = np.repeat(np.array([[q.start] for q in dae.states], dtype=np.float64), n, axis=1)
    for _ in range(NEWTON_STEPS):
        value, slope = function(x, problem.values, times[None, :])
        H = matrices(slope, len(used))
        inverse = np.linalg.pinv(H, rcond=1e-10)
        step = np.einsum("kij,jk->ik", inverse, y / std[:, None] - value)
        x = x + step
        if np.max(np.abs(step)) <= 1e-12 * (1.0 + np.max(np.abs(x))):
            break
    in_view = np.einsum("kij,kji->ki", inverse, H).min(axis=0) > 1.0 - SHOWN
    return Shown(chosen=tuple(int(i) for i in np.flatnonzero(in_view)), x=x, slopes=H)


def _shown(problem: Problem, recording: Recording, method: str) -> Shown:
    """The same for a whole recording, or an InputError that says why not."""
    dae, used = problem.dae, instantaneous(problem, recording)
    free = dae.p[list(problem.free)]
    twisted = [dae.outputs[i].name for i in used if any(ca.which_depends(dae.output[i], free, 1, False))]
    if twisted:
        raise InputError(
            f"parameters: output {listed(twisted)} itself depends on a free parameter, and {method} needs the states before it knows the "
            "parameters; fix it, or use prediction_error or smooth."
        )
    if not used:
        raise InputError(
            f"{recording.name}: no recorded output is a function of the states alone, as {method} needs; use prediction_error."
        )
    names = [dae.outputs[i].name for i in used]
    y = np.array([complete_output(recording, name, method) for name in names])
    given = [problem.weights.noise(name, recording) for name in names]
    std = np.array([s or float(np.ptp(row)) or 1.0 for s, row in zip(given, y, strict=True)])
    return invert_outputs(problem, used, y, std, recording.time)


def visible_states(problem: Problem, method: str) -> set[int]:
    """States that every fitted recording shows, directly or as the velocity of a shown position, judged at three instants of each."""
    dae, seen = problem.dae, set(range(problem.dae.x.shape[0]))
    for recording in problem.fitted:
        n = len(recording.time)
        rows = [0, n // 2, n - 1]
        few = replace(
            recording,
            time=recording.time[rows],
            inputs={name: u[rows] for name, u in recording.inputs.items()},
            outputs={name: complete_output(recording, name, method)[rows] for name in recording.outputs},
        )
        chosen = _shown(problem, few, method).chosen
        seen &= {*chosen, *(j for i, j, _ in dae.kinematics if i in chosen)}
    return seen


def motion(problem: Problem, recording: Recording, filtered: Filter, method: str, times: Array | None = None) -> Motion:
    """x', x, z, u of a recording at the filter's `times` (None: its rows); what `visible_states` leaves out is zero."""
    dae, step = problem.dae, uniform_step(recording, method)
    shown = _shown(problem, recording, method)
    chosen = list(shown.chosen)
    f = filtered(shown.x[chosen], *row_inputs(recording, [q.name for q in dae.inputs]), step)
    M = f.signals.shape[1]
    x, dx = np.zeros((dae.x.shape[0], M)), np.zeros((dae.x.shape[0], M))
    x[chosen], dx[chosen] = f.signals, f.first
    velocity_of = {j: i for i, j, _ in dae.kinematics if i in chosen and j not in chosen}
    for j, i in velocity_of.items():
        k = chosen.index(i)
        x[j], dx[j] = f.first[k], f.second[k]
    t = recording.time[f.rows] if times is None else times
    z = algebraics_along(dae, dx, x, f.inputs, problem.values, t)
    return Motion(dx=dx, x=x, z=z, u=f.inputs, t=t, rows=f.rows)


def _of_states_only(dae: Dae, expression: Any) -> bool:
    others = ca.vertcat(dae.dx, dae.z, dae.u, dae.w)
    return bool(any(ca.which_depends(expression, dae.x, 1, False))) and not any(ca.which_depends(expression, others, 1, False))
