"""How far the mesh itself is to blame, and finer meshes until it is not.

A mesh with N intervals leaves out of every balance its moments from K on. What they would cost on a finer mesh, with white forces of
the density in force, is 1/2 sum eps_K^2, and the distance of the two solutions in the metric of their posterior, half its square, is no
more than that. While these moments are small beside one, outputs move by a small share of their deviations. Where they are not,
every interval is halved and the program solved again: the difference is the error of the coarser mesh, and a third of it that of
the finer one, whose order is two at least. The finer one is solved to the end only where the difference is worth it. Where a sensor reads
a white force at once the knots stay at its samples (`ocp/pieces.py`), and the degree grows instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from backsight.ocp import Horizon, Solution
from backsight.ocp.columnwise import Columnwise
from backsight.ocp.polynomials import gauss, legendre

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

UNRESOLVED = 0.1  # rms of the first moments left out, beside one, that needs no second look
ALLOWED = 0.1  # of an output's noise: what the mesh may move it
ALLOWED_PARAMETER = 0.3  # of a parameter's deviation: many samples make it sharper than their noise
HALVINGS = 3
HIGHEST = 5  # degree
MOST_INTERVALS = 40_000  # of a refined mesh
LEFT = 1.0 / 3.0  # share of the error that a halving leaves at most, of order two


def unresolved_moment(solution: Solution) -> float:
    """Rms over all intervals and soft places of eps_K = sqrt(h)/std int L_K F dtau, the first moment that a spline leaves out.

    inf where balances must hold exactly.
    """
    t = solution.transcription
    if not t.soft or t.method != "spline":
        return np.inf
    ip, dae, K, steps = t.nlp.interpolation, t.dae, t.degree, t.nlp.steps
    F = dae.undisturbed(dae.residual[dae.rows_of(t.soft)])
    balance = Columnwise(ca.Function("balance", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], [ca.densify(F)]), (4,))
    nodes, weights = gauss(K + 2)
    interval = np.repeat(np.arange(len(steps)), len(nodes))
    local = t.nlp.local(solution.solved.decisions[: t.nlp.trajectory_size])[:, interval]
    v = ip.apply(ip.values(np.tile(nodes, len(steps)), steps[interval]), local)
    dx, x, z = v[: ip.states], v[ip.states : 2 * ip.states], v[2 * ip.states : 2 * ip.states + ip.algebraics]
    data = np.hstack([h.point_data(K, nodes) for h in t.horizons])
    (values,) = balance(dx, x, z, data[:-1], solution.parameters, data[-1:])
    weight = weights * legendre(K + 1, nodes)[K]
    moments = values.reshape(len(t.soft), len(steps), len(nodes)) @ weight
    return float(np.sqrt(np.mean((moments * np.sqrt(steps) / t.force_std_at(solution.values)) ** 2)))


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A solution whose mesh was looked at.

    error: what its mesh moves every output, in units of its noise, and every free parameter, in units of its deviation. mattered: whether
    the first mesh moved one of them by more than is allowed. unchecked: why nobody has looked, where a second look was called for.
    """

    solution: Solution
    error: dict[str, float] = field(default_factory=dict)
    mattered: bool = False
    unchecked: str = ""


def refine(
    solution: Solution,
    again: Callable[[Solution, list[Horizon], int], tuple[Solution, Callable[[], Solution]]],
    *,
    keep: bool,
    say: Callable[[str], None],
) -> Checked:
    """Halve the intervals until the mesh moves outputs and parameters no more than is allowed, or HALVINGS times.

    again(solution, horizons, degree): the same problem on other meshes, started from a solution; and what ends losses that are no squares.
    keep: whether the mesh is to stay as it is, so that only its error is measured.
    """
    checked = Checked(solution=solution)
    if not solution.solved.status.converged or unresolved_moment(solution) <= UNRESOLVED:
        return checked
    why = ""
    for _ in range(HALVINGS):
        t = checked.solution.transcription
        horizons, degree = list(t.horizons), t.degree
        if t.nlp.terms[checked.solution.term("samples")].within is not None:
            if t.nlp.constraint_count:
                why = "with constraints it would cost a hundred times the solve itself"
                break
            degree += 1
        else:
            horizons = [replace(h, mesh=h.mesh.refined()) for h in horizons]
        if sum(h.mesh.count for h in horizons) > MOST_INTERVALS or degree > HIGHEST:
            why = f"it would take more than {MOST_INTERVALS} intervals" if degree <= HIGHEST else f"its degree would be above {HIGHEST}"
            break
        say(f"looking again with {sum(h.mesh.count for h in horizons)} intervals of degree {degree}")
        finer, ended = again(checked.solution, horizons, degree)
        if not finer.solved.status.converged:
            why = "the finer program was not solved"
            break
        moved = _moved(checked.solution, finer)
        if keep or not exceeds(checked.solution, moved, LEFT):
            return replace(checked, error=moved, mattered=checked.mattered or exceeds(checked.solution, moved))
        finer = ended()
        if not finer.solved.status.converged:
            why = "the finer program was not solved"
            break
        error = {name: LEFT * size for name, size in moved.items()}
        checked = Checked(solution=finer, error=error, mattered=checked.mattered or exceeds(solution, moved))
        if not exceeds(solution, error):
            break
    return checked if checked.error else replace(checked, unchecked=why)


def allowed(solution: Solution, name: str) -> float:
    """How far the mesh may move an output or a parameter."""
    return ALLOWED if name in {q.name for q in solution.transcription.dae.outputs} else ALLOWED_PARAMETER


def exceeds(solution: Solution, error: Mapping[str, float], share: float = 1.0) -> bool:
    """Whether any of them is beyond a share of that."""
    return any(size > share * allowed(solution, name) for name, size in error.items())


def _moved(one: Solution, other: Solution) -> dict[str, float]:
    """Largest rms difference of every output over a recording's samples, in its noise, and of every free parameter in its deviation."""
    t, scale = one.transcription, one.values.scale[one.term("samples")]
    size, first = np.zeros(len(t.dae.outputs)), 0
    for k, horizon in enumerate(t.horizons):
        part = slice(first, first + len(horizon.time))
        first = part.stop
        moved = (one.outputs(k) - other.outputs(k)) * scale[:, part]
        count = np.maximum(np.count_nonzero(scale[:, part], axis=1), 1)
        size = np.maximum(size, np.sqrt(np.sum(moved**2, axis=1) / count))
    found = {q.name: float(s) for q, s in zip(t.dae.outputs, size, strict=True)}
    if one.curvature is not None:
        for k, i in enumerate(t.nlp.free):
            std = float(np.sqrt(one.curvature.parameter_variance[k]))
            if np.isfinite(std) and std > 0:
                found[t.dae.parameters[i].name] = abs(float(one.parameters[i] - other.parameters[i])) / std
    return found
