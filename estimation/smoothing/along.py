"""The model along trajectories: any of its expressions, and how large the forces are at every place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.ocp import Horizon
from backsight.ocp.columnwise import Columnwise
from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import Array

from ..problem import Problem

RIGID = 1e-4  # of the forces at a place, from interval to interval: a balance as good as this is exact
GEOMETRY = {"m", "rad", "1"}  # units of what says where a force acts, how it is turned, or which part of it; others say how strong it is
STIFFNESS = "N/m"
POSITIONS, TINY = ("m", "rad"), 1e-300
LOOKED_AT = 500  # places of a recording where the forces are looked at


def along(dae: Dae, expression: Any, followed: Followed, number: int, times: Array, parameters: Array) -> Array:
    """An expression of the model along a followed trajectory, (rows, M)."""
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t]
    function = Columnwise(ca.Function("along", arguments, [ca.densify(expression)]), (4, 5))
    dx, x, z = followed.at(number, times)
    u = followed.horizons[number].input_at(times)
    (values,) = function(dx, x, z, u, parameters, np.zeros(dae.w.shape[0]), followed.horizons[number].clock + times[None, :])
    return values


def forces(
    problem: Problem,
    followed: Followed,
    parameters: Array,
    *,
    varying: bool = False,
    borne: bool = False,
    taut: bool = False,
    net: bool = False,
) -> dict[int, float]:
    """Rms of the largest term of every balance along the trajectories: place -> [unit of the place].

    The terms are the balance's derivatives times what it is differentiated by: x', z, u or p; or x where there are none of these. A spring
    between two bodies that turn bears its stiffness times its twist, and not times either angle. varying: without their means, so that a
    weight that hangs in the air is nothing. borne: no more than is surely borne; a length or a ratio does not count where its term hangs on
    positions: the radius of a wheel, beside its angle, stands in the force of a belt that is hardly stretched. taut: nor does one that a
    spring's stiffness multiplies, wherever else it stands. net: of no length, angle or number at all, unknown or known: where joints stand
    says how what they bear is turned, and the thrusts of four rotors, times how these are, leave next to nothing that turns the body.
    """
    dae = problem.dae
    places = [int(e.place) for e in dae.equations if e.place is not None]
    if not places:
        return {}
    rows = dae.balances_of(places)
    F = dae.undisturbed(dae.residual[rows])
    z = [symbol for symbol, q in zip(ca.vertsplit(dae.z), dae.algebraics, strict=True) if not (net and q.unit in GEOMETRY)]
    acting = ca.vertcat(dae.dx, *z, dae.u, _of_size(dae, F, borne, taut, net))
    told = sorted(set(ca.jacobian_sparsity(F, acting).row()))
    parts = ca.jacobian(F, ca.vertcat(acting, dae.x)) * ca.repmat(ca.vertcat(acting, dae.x).T, len(rows), 1)
    parts[told, acting.shape[0] :] = 0
    terms = ca.vec(ca.densify(parts))
    found = []
    for number, times in enumerate(times_within(followed.horizons, LOOKED_AT)):
        found.append(along(dae, terms, followed, number, times, parameters))
    values = np.hstack(found)
    mean = np.nanmean(values, axis=1, keepdims=True) if varying else 0.0
    size = np.sqrt(np.nanmean((values - mean) ** 2, axis=1)).reshape(-1, len(rows)).max(axis=0, initial=0.0)
    return {k: float(f) if np.isfinite(f) and f > 0 else 1.0 for k, f in zip(places, size, strict=True)}


def _of_size(dae: Dae, F: Any, borne: bool, taut: bool, net: bool) -> Any:
    """The parameters; borne: without the lengths and ratios that enter F times positions; taut: times stiffnesses; net: without any."""
    positions = ca.vertcat(*(dae.x[i] for i, _, _ in dae.kinematics))
    springs = ca.vertcat(*(dae.p[i] for i, q in enumerate(dae.parameters) if q.unit == STIFFNESS))

    def geometric(i: int, unit: str) -> bool:
        if unit not in GEOMETRY:
            return False
        by = springs if taut else positions
        return net or ((borne or taut) and bool(ca.depends_on(ca.jacobian(F, dae.p[i]), by)))

    return ca.vertcat(*(dae.p[i] for i, q in enumerate(dae.parameters) if not geometric(i, q.unit)))


def times_within(horizons: Sequence[Horizon], most: int) -> list[Array]:
    """Times inside of every horizon, in proportion to how long it is; `most` of the longest."""
    spans = [float(h.time[-1] - h.time[0]) for h in horizons]
    counts = [max(round(most * span / max(spans)), 1) if max(spans) > 0 else 1 for span in spans]
    return [np.linspace(h.time[0], h.time[-1], count + 2)[1:-1] for h, count in zip(horizons, counts, strict=True)]


def rms(r: Array) -> Array:
    """Of every row."""
    return np.asarray(np.sqrt(np.mean(r**2, axis=1)), dtype=np.float64)


def exact_forces(problem: Problem, followed: Followed, parameters: Array) -> dict[int, float]:
    """Place -> std of a residual force so small that no machine's balance is as good, white from interval to interval of the mesh."""
    return {k: RIGID * f for k, f in white_forces(problem, followed, parameters, borne=True).items()}


def white_forces(problem: Problem, followed: Followed, parameters: Array, *, borne: bool = False) -> dict[int, float]:
    """Place -> std of a residual force as large as `forces`, white from interval to interval of the mesh."""
    step = float(np.median(np.concatenate([h.mesh.steps for h in followed.transcription.horizons])))
    return {k: f * step**0.5 for k, f in forces(problem, followed, parameters, borne=borne).items()}


def shown_of_ways(dae: Dae, velocity: str, followed: Followed, parameters: Array) -> float:
    """How far measured positions go, in their deviations, over a way of a body, at most [1/m or 1/rad]; 0 where none is measured.

    velocity: name of the body's. By the regression of their velocities on its.
    """
    rows = [k for k, q in enumerate(dae.outputs) if q.unit in POSITIONS]
    if not rows:
        return 0.0
    of_body, together = np.zeros(len(rows)), np.zeros(len(rows))
    for number, horizon in enumerate(followed.horizons):
        times, y = horizon.changes, horizon.target[:, rows]
        v = along(dae, dae.variables[velocity], followed, number, times, parameters)[0]
        moved = np.gradient(along(dae, dae.output[rows], followed, number, times, parameters), times, axis=1)
        precision = np.max(np.where(np.isfinite(y), 1.0 / horizon.target_std[:, rows], 0.0), axis=0)
        of_body += np.where(precision > 0, float(v @ v), 0.0)
        together += precision * (moved @ v)
    return float(np.max(np.abs(together) / np.maximum(of_body, TINY)))
