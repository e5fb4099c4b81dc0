"""Consistent values: states that fulfil the constraints between them, and the rates and algebraic variables that belong to them.

    I(x, u, t) = 0                   least-norm Gauss-Newton steps in the states that are free
    F(x', x, z, u, t) = 0            Newton's method for x' and z, rows scaled, steps halved while they do not help

The positions that a closed loop leaves algebraic are found from their start values: of several ways to assemble a mechanism, the one
nearest to them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..dae import Dae
from ..errors import ModelError, SolveError, suggestion

SX = Any
Array = NDArray[np.float64]
_ITERATIONS = 100
_HALVINGS = 25


def initial_states(dae: Dae, initial: Mapping[str, float], values: Array, u: Array, t: float) -> tuple[Array, Array]:
    """States x (nx,) that fulfil the constraints, those given kept exactly, and a first guess of the algebraics z (nz,).

    initial  name -> value of states and of algebraics; start values otherwise

    Raises ModelError for unknown names, and for values that violate the constraints.
    """
    names = [q.name for q in (*dae.states, *dae.algebraics)]
    for name, value in initial.items():
        if name not in names:
            raise ModelError(f"initial['{name}']: model '{dae.name}' has no such state; {suggestion(name, names)}")
        finite(f"initial['{name}']", value)
    x = np.array([float(initial.get(q.name, q.start)) for q in dae.states])
    z = np.array([float(initial.get(q.name, q.start)) for q in dae.algebraics])
    return _projected(dae, initial, values, u, x, t) if dae.invariants.shape[0] else x, z


def _projected(dae: Dae, initial: Mapping[str, float], values: Array, u: Array, x: Array, t: float) -> Array:
    """The nearest states (those given in `initial` kept) that fulfil the invariants: least-norm Gauss-Newton steps, halved if need be."""
    free = np.array([q.name not in initial for q in dae.states])
    constraints = ca.Function(
        "I", [dae.x, dae.u, dae.p, dae.t], [ca.densify(e) for e in (dae.invariants, ca.jacobian(dae.invariants, dae.x))]
    )

    def at(point: Array) -> tuple[Array, Array]:
        defect, jacobian = (m.full() for m in constraints(point, u, values, t))
        return defect[:, 0], jacobian

    defect, jacobian = at(x)
    for _ in range(_ITERATIONS):
        if np.abs(defect).max() < 1e-15 * max(1.0, float(np.abs(x).max())) or not free.any():
            break
        step = np.zeros(len(x))
        step[free] = np.linalg.lstsq(jacobian[:, free], defect, rcond=1e-10)[0] if np.all(np.isfinite(jacobian)) else 0.0
        length = 1.0
        for _ in range(_HALVINGS):
            trial, slopes = at(x - length * step)
            if np.abs(trial).max() < np.abs(defect).max():  # false for nan
                break
            length /= 2
        else:
            break
        x, defect, jacobian = x - length * step, trial, slopes
    if np.abs(defect).max() < 1e-9 * max(1.0, float(np.abs(x).max())):
        return x
    given = ", ".join(f"{name} = {value:g}" for name, value in initial.items()) or "all states at their start values"
    raise ModelError(
        f"initial: {given} violates the constraints of '{dae.name}' by {np.abs(defect).max():.3g}; "
        "give consistent values, or fewer, so that the rest can follow"
    )


def highest(dae: Dae, both: Any, z: Array, given: Array, t: float) -> tuple[Array, Array]:
    """x' and z from a guess of z, by damped Newton steps on both(unknown, given) -> (F, dF/d(x', z)).

    Raises SolveError naming the equations that cannot be fulfilled: closed loops that cannot be assembled, or the singular ones.
    """
    nx = dae.x.shape[0]
    y = np.concatenate([np.zeros(nx), z])

    def at(point: Array) -> tuple[Array, Array]:
        value, jacobian = both(point, given)
        return value.full()[:, 0], jacobian.full()

    value, jacobian = at(y)
    for _ in range(_ITERATIONS):
        if not (np.all(np.isfinite(value)) and np.all(np.isfinite(jacobian))):
            break
        largest = np.abs(jacobian).max(axis=1, initial=0.0)
        weight = 1.0 / np.where(largest > 0.0, largest, 1.0)
        step, _, rank, _ = np.linalg.lstsq(weight[:, None] * jacobian, weight * value, rcond=1e-13)
        if np.abs(step).max(initial=0.0) <= 1e-12 * (1.0 + np.abs(y).max(initial=0.0)) and rank == len(y):
            return y[:nx] - step[:nx], y[nx:] - step[nx:]
        length = 1.0
        for _ in range(_HALVINGS):
            trial, slopes = at(y - length * step)
            if np.abs(weight * trial).max() < np.abs(weight * value).max():  # false for nan
                break
            length /= 2
        else:
            if rank == len(y) and np.abs(step).max(initial=0.0) <= 1e-9 * (1.0 + np.abs(y).max(initial=0.0)):
                return y[:nx] - step[:nx], y[nx:] - step[nx:]
            break
        y, value, jacobian = y - length * step, trial, slopes
    raise _inconsistent(dae, value, jacobian, t)


def _inconsistent(dae: Dae, value: Array, jacobian: Array, t: float) -> SolveError:
    """Why there is no answer: a loop that stays open, or equations that do not determine x' and z."""
    rows = len(dae.equations)
    by_rate = ca.which_depends(dae.residual, dae.dx, 1, True) if dae.x.shape[0] else [False] * rows
    scaled = np.abs(value) / np.maximum(np.abs(jacobian).max(axis=1, initial=0.0), 1e-300)
    open_ = (
        [i for i in range(rows) if not by_rate[i] and not scaled[i] <= 1e-9 and ca.depends_on(dae.residual[i], dae.z)]
        if dae.z.shape[0]
        else []
    )
    if open_ and np.all(np.isfinite(jacobian)):
        held = {s.name() for i in open_ for s in ca.symvar(dae.residual[i])}
        moved = [q.name for i, q in enumerate(dae.algebraics) if dae.z[i].name() in held]
        return SolveError(
            f"no consistent configuration of '{dae.name}' was found at t = {t:.9g} s: "
            f"{', '.join(dict.fromkeys(repr(dae.equations[i].origin) for i in open_))} cannot be fulfilled from the start values; "
            f"give {' or '.join(moved)} a start value nearer to the assembled mechanism, or other initial values of the states"
        )
    return SolveError(
        f"no accelerations and algebraic values fulfil the equations of '{dae.name}' at t = {t:.9g} s: the model is singular for these "
        f"parameter values (a mass of zero?), or the initial values are far from consistent{_weak(dae, jacobian)}"
    )


def _weak(dae: Dae, jacobian: Array) -> str:
    """The equations that do not determine what they should."""
    if not np.all(np.isfinite(jacobian)):
        return ""
    left, spread, _ = np.linalg.svd(jacobian / np.maximum(np.abs(jacobian).max(axis=1, keepdims=True), 1e-300))
    if not len(spread) or spread[-1] > 1e-12 * spread[0]:
        return ""
    weak = [e.origin for e, share in zip(dae.equations, left[: len(dae.equations), -1], strict=True) if abs(share) > 1e-6]
    return f"; look at {', '.join(repr(origin) for origin in weak)}" if weak else ""


def finite(where: str, value: object) -> None:
    """Raise ModelError for what is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(float(value)):
        raise ModelError(f"{where} = {value!r}: a finite number is needed")


class ZeroOf:
    """A switching function a(x, t) and its gradient."""

    def __init__(self, dae: Dae, function: SX) -> None:
        both = ca.Function("a", [dae.x, dae.t], [function, ca.densify(ca.jacobian(function, dae.x))])
        self._both, self._gradient = both, None
        if ca.is_linear(function, dae.x) and not ca.depends_on(function, dae.t):
            offset, gradient = both(np.zeros(dae.x.shape[0]), 0.0)
            self._offset, self._gradient = float(offset), gradient.full()[0]

    def __call__(self, x: Array, t: float) -> tuple[float, Array]:
        if self._gradient is not None:
            return float(self._gradient @ x) + self._offset, self._gradient
        value, gradient = self._both(x, t)
        return float(value), gradient.full()[0]


class Projection:
    """x back on the constraints I(x, u, t) = 0 by one least-norm Gauss-Newton step."""

    def __init__(self, dae: Dae, values: Array) -> None:
        invariants = ca.substitute(dae.invariants, dae.p, ca.DM(values))
        self._both = ca.Function("I", [dae.x, dae.u, dae.t], [ca.densify(e) for e in (invariants, ca.jacobian(invariants, dae.x))])

    def __call__(self, x: Array, u: Array, t: float) -> Array:
        defect, jacobian = self._both(x, u, t)
        return np.asarray(x - np.linalg.lstsq(jacobian.full(), defect.full()[:, 0], rcond=1e-10)[0])
