"""Simulation: the model under given inputs, with the samples and holds of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .dae import Dae
from .errors import ModelError, SolveError, suggestion
from .radau import Stepper

Array = NDArray[np.float64]
SHARPNESS = 1e-5  # smoothing widths are shrunk by this in a simulation: they are rounded corners, not physics


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A simulated run at the given times; every mapping is name -> (n,) in SI units.

    derivatives  x' by state name, with the input of the sample already acting
    """

    t: Array
    states: Mapping[str, Array]
    outputs: Mapping[str, Array]
    algebraics: Mapping[str, Array] = field(default_factory=dict)
    derivatives: Mapping[str, Array] = field(default_factory=dict)


def simulate(
    dae: Dae,
    t: ArrayLike,
    inputs: Mapping[str, ArrayLike] | None = None,
    parameters: Mapping[str, float] | None = None,
    initial: Mapping[str, float] | None = None,
    *,
    hold: Literal["zero", "linear"] = "zero",
    rtol: float = 1e-10,
) -> Trajectory:
    """Integrate F(x', x, z, u, p, 0, t) = 0 over the samples t [s] (n,), strictly increasing.

    inputs      name -> (n,) or a constant: the input of sample k is held from t_k to t_k+1 ("zero"), or joined by straight lines ("linear")
    parameters  values that replace the defaults; smoothing widths are 1e-5 of their defaults unless given here
    initial     values of states (and algebraics, as a guess) at t_0; the others start at their start value, zero unless declared
    rtol        local error per step relative to the largest value of each state so far

    Outputs and algebraics of sample k see the input of sample k. Where the model has constraints between states (a closed loop), the states
    that `initial` does not give are moved to fulfil them. Raises ModelError for unknown names, shapes and inconsistent initial values,
    SolveError where the integration stops.
    """
    times = _times(t)
    u = _inputs(dae, inputs or {}, len(times))
    values = _parameters(dae, parameters or {})
    if hold not in ("zero", "linear"):
        raise ModelError(f"hold = {hold!r}: an input is held 'zero' or 'linear' between samples; choose one of them")
    x, z = _initial(dae, initial or {}, values, u[:, 0], times[0])
    stepper = Stepper(dae, values, rtol)
    stepper.seen = np.abs(x)
    states = np.empty((len(x), len(times)))
    states[:, 0] = x
    h = np.inf
    for k in range(len(times) - 1):
        interval = times[k + 1] - times[k]
        slope = (u[:, k + 1] - u[:, k]) / interval if hold == "linear" else np.zeros(u.shape[0])
        x, z, h = stepper.across(x, z, float(times[k]), float(times[k + 1]), u[:, k], slope, h)
        states[:, k + 1] = x
    return _trajectory(dae, times, states, u, values)


def _trajectory(dae: Dae, times: Array, states: Array, u: Array, values: Array) -> Trajectory:
    rates, algebraics = _highest(dae, states, u, values, times)
    output = ca.Function("output", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], [ca.substitute(dae.output, dae.w, 0 * dae.w)])
    outputs = (
        output.map(len(times))(rates, states, algebraics, u, ca.repmat(ca.DM(values), 1, len(times)), times[None, :]).full()
        if dae.outputs
        else np.empty((0, len(times)))
    )
    return Trajectory(
        t=times,
        states={q.name: states[i] for i, q in enumerate(dae.states)},
        outputs={q.name: outputs[i] for i, q in enumerate(dae.outputs)},
        algebraics={q.name: algebraics[i] for i, q in enumerate(dae.algebraics)},
        derivatives={q.name: rates[i] for i, q in enumerate(dae.states)},
    )


def _highest(dae: Dae, states: Array, u: Array, values: Array, times: Array, guess: Array | None = None) -> tuple[Array, Array]:
    """x' and z at given states: Newton's method on F (one step where F is linear in them), for all samples at once."""
    count, nx = states.shape[1], dae.x.shape[0]
    unknown = ca.vertcat(dae.dx, dae.z)
    known = ca.vertcat(dae.x, dae.u, dae.t)
    residual = ca.substitute(ca.substitute(dae.residual, dae.w, 0 * dae.w), dae.p, ca.DM(values))
    both = ca.Function("both", [unknown, known], [residual, ca.jacobian(residual, unknown)])
    y, k = ca.MX.sym("y", unknown.shape[0]), ca.MX.sym("k", known.shape[0])
    value, jacobian = both(y, k)
    step = ca.Function("step", [y, k], [ca.solve(jacobian, value, "qr")]).map(count)
    given = np.vstack([states, u, times[None, :]])
    found = np.zeros((unknown.shape[0], count)) if guess is None else guess
    for _ in range(30):
        try:
            change = step(found, given).full()
        except RuntimeError:  # CasADi: a singular matrix
            break
        found = found - change
        if not np.all(np.isfinite(found)):
            break
        if np.max(np.abs(change) / (1.0 + np.abs(found)), initial=0.0) < 1e-12:
            return found[:nx], found[nx:]
    when = f"{times[0]:.9g} s" if count == 1 else f"{times[0]:.9g} .. {times[-1]:.9g} s"
    raise SolveError(
        f"no accelerations and algebraic values fulfil the equations of '{dae.name}' at t = {when}: the model is singular for these "
        "parameter values (a mass of zero?), or the initial values are far from consistent"
    )


def _initial(dae: Dae, initial: Mapping[str, float], values: Array, u: Array, t: float) -> tuple[Array, Array]:
    names = [q.name for q in (*dae.states, *dae.algebraics)]
    for name, value in initial.items():
        if name not in names:
            raise ModelError(f"initial['{name}']: model '{dae.name}' has no such state; {suggestion(name, names)}")
        _finite(f"initial['{name}']", value)
    x = np.array([float(initial.get(q.name, q.start)) for q in dae.states])
    z = np.array([float(initial.get(q.name, q.start)) for q in dae.algebraics])
    if dae.invariants.shape[0]:
        x = _project(dae, initial, values, u, x, t)
    _, found = _highest(dae, x[:, None], u[:, None], values, np.array([t]), np.concatenate([np.zeros(len(x)), z])[:, None])
    return x, found[:, 0]


def _project(dae: Dae, initial: Mapping[str, float], values: Array, u: Array, x: Array, t: float) -> Array:
    """The nearest states (those given in `initial` kept) that fulfil the invariants: Gauss-Newton with least-norm steps."""
    free = np.array([q.name not in initial for q in dae.states])
    constraints = ca.Function("I", [dae.x, dae.u, dae.p, dae.t], [dae.invariants, ca.jacobian(dae.invariants, dae.x)])
    for _ in range(50):
        defect, jacobian = (m.full() for m in constraints(x, u, values, t))
        if np.max(np.abs(defect)) < 1e-13 * max(1.0, float(np.max(np.abs(x)))):
            return x
        change = np.linalg.lstsq(jacobian[:, free], defect[:, 0], rcond=1e-10)[0] if free.any() else np.zeros(0)
        if not np.all(np.isfinite(change)) or np.max(np.abs(change), initial=0.0) < 1e-15:
            break
        x = x.copy()
        x[free] -= change
    if np.max(np.abs(defect)) < 1e-9 * max(1.0, float(np.max(np.abs(x)))):
        return x
    given = ", ".join(f"{name} = {value:g}" for name, value in initial.items()) or "all states at their start values"
    raise ModelError(
        f"initial: {given} violates the constraints of '{dae.name}' by {np.max(np.abs(defect)):.3g}; "
        "give consistent values, or fewer, so that the rest can follow"
    )


def _times(t: ArrayLike) -> Array:
    times = np.asarray(t, dtype=float)
    if times.ndim != 1 or len(times) < 1:
        raise ModelError(f"t has shape {times.shape}; give the sample times as one column with at least one value")
    wrong = np.flatnonzero(~np.isfinite(times))
    if len(wrong):
        raise ModelError(f"t[{wrong[0]}] = {times[wrong[0]]} is not finite; give every sample its time")
    wrong = np.flatnonzero(np.diff(times) <= 0)
    if len(wrong):
        k = int(wrong[0]) + 1
        raise ModelError(
            f"t[{k}] = {times[k]:.9g} s does not follow t[{k - 1}] = {times[k - 1]:.9g} s; sort the samples and drop repeated ones"
        )
    return times


def _inputs(dae: Dae, inputs: Mapping[str, ArrayLike], count: int) -> Array:
    names = [q.name for q in dae.inputs]
    for name in inputs:
        if name not in names:
            raise ModelError(f"inputs['{name}']: model '{dae.name}' has no such input; {suggestion(name, names)}")
    u = np.empty((len(names), count))
    for i, name in enumerate(names):
        if name not in inputs:
            raise ModelError(
                f"inputs: '{name}' [{dae.inputs[i].unit}] of model '{dae.name}' is missing; give its {count} values or a constant"
            )
        column = np.asarray(inputs[name], dtype=float)
        if column.shape not in ((), (count,)):
            raise ModelError(f"inputs['{name}'] has shape {column.shape}; {count} sample times need ({count},) values or a constant")
        u[i] = column
        wrong = np.flatnonzero(~np.isfinite(u[i]))
        if len(wrong):
            raise ModelError(f"inputs['{name}'][{wrong[0]}] = {u[i, wrong[0]]} is not finite; an input needs a value at every sample")
    return u


def _parameters(dae: Dae, parameters: Mapping[str, float]) -> Array:
    names = [q.name for q in dae.parameters]
    for name, value in parameters.items():
        if name not in names:
            raise ModelError(f"parameters['{name}']: model '{dae.name}' has no such parameter; {suggestion(name, names)}")
        _finite(f"parameters['{name}']", value)
        info = dae.parameters[names.index(name)]
        if not info.minimum <= value <= info.maximum:
            raise ModelError(
                f"parameters['{name}'] = {value:g}: the value must lie between {info.minimum:g} and {info.maximum:g} {info.unit}"
            )
    sharp = {q.name: max(q.value * SHARPNESS, q.minimum) for q in dae.parameters if q.smoothing}
    return np.array(dae.parameter_values({**sharp, **parameters}))


def _finite(where: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(float(value)):
        raise ModelError(f"{where} = {value!r}: a finite number is needed")
