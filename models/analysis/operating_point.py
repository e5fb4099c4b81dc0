"""Working points: where a model is linearised, and where it rests.

Smoothing widths are as sharp as in a simulation unless they are given, so a point with zero velocity sticks and one with a velocity slips.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..dae import Dae, Quantity
from ..errors import ModelError, SolveError, suggestion
from ..simulation.simulate import sharp_values

Array = NDArray[np.float64]
ITERATIONS = 50
HALVINGS = 30
TOLERANCE = 1e-9  # what an equation may keep, relative to its largest term
SHARPENING = 0.3  # factor of the smoothing widths from one solve to the next


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoint:
    """One point that fulfils F(x', x, z, u, p, 0, t) = 0; every mapping is name -> value in SI units."""

    x: Mapping[str, float]
    dx: Mapping[str, float]
    z: Mapping[str, float]
    u: Mapping[str, float]
    parameters: Mapping[str, float]
    t: float

    def columns(self) -> tuple[list[float], ...]:
        """x', x, z, u, p and t, in the order of the model, as its functions take them."""
        return (*(list(m.values()) for m in (self.dx, self.x, self.z, self.u, self.parameters)), [self.t])


def operating_point(
    dae: Dae,
    x: Mapping[str, float] | None = None,
    u: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    t: float = 0.0,
    z: Mapping[str, float] | None = None,
) -> OperatingPoint:
    """The point of given states and inputs: x' and z follow from the equations by Newton's method.

    x           states; those left out are at their start values
    u           inputs; those left out are zero
    parameters  values that replace the defaults; smoothing widths are 1e-5 of theirs unless given
    z           guesses of algebraic variables; their start values otherwise

    Raises ModelError for an unknown name, SolveError where the equations do not determine x' and z.
    """
    values = sharp_values(dae, parameters or {})
    start = _Start(dae, {**(x or {}), **(z or {})}, u or {})
    unknown = ca.vertcat(dae.dx, dae.z)
    given = np.hstack([start.x, start.u, values, np.array([t])])
    rows = dae.undisturbed(dae.residual)
    newton = _Newton(unknown, ca.vertcat(dae.x, dae.u, dae.p, dae.t), rows)
    found = newton.solve(np.concatenate([np.zeros(len(start.x)), start.z]), given)
    remainder = newton.remainder(found, given)
    if np.max(remainder, initial=0.0) > TOLERANCE:
        raise SolveError(
            f"no x' and z of '{dae.name}' fulfil {_worst(dae, remainder)} at this point; give a point that the plant can be in, "
            "or guesses of its algebraic variables"
        )
    return _point(dae, found[: len(start.x)], start.x, found[len(start.x) :], start.u, values, t)


def equilibrium(
    dae: Dae,
    inputs: Mapping[str, float] | None = None,
    guess: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
    t: float = 0.0,
) -> OperatingPoint:
    """A point where nothing changes: F(0, x, z, u, p, 0, t) = 0, the one nearest to the guess where there are many.

    States that enter the equations only through their derivative (the angle of a shaft that turns, the position of a body that slides
    freely) may move steadily.

    inputs      values of inputs; those left out are found too: the force that holds a body, the voltage of a speed
    guess       of states, algebraic variables and inputs; start values, and zero for inputs, otherwise
    parameters  values that replace the defaults; smoothing widths are 1e-5 of theirs unless given, reached by gradual sharpening
    held        states or algebraic variables that must have these values, {"carriage.v": 0.1}

    Gauss-Newton with least-norm steps and halving. Raises ModelError for an unknown name, SolveError where there is no equilibrium,
    naming the equations that cannot be fulfilled.
    """
    inputs, guess, held = dict(inputs or {}), dict(guess or {}), dict(held or {})
    values = sharp_values(dae, parameters or {})
    names = [q.name for q in dae.inputs]
    own = {k: v for k, v in guess.items() if k not in names}
    start = _Start(dae, {**own, **held}, {**{k: v for k, v in guess.items() if k in names}, **inputs})
    steady = ca.which_depends(dae.residual, dae.x, 1, False) if dae.x.shape[0] else []
    cyclic = [i for i, enters in enumerate(steady) if not enters]
    free_x = [i for i, q in enumerate(dae.states) if q.name not in held]
    free_z = [i for i, q in enumerate(dae.algebraics) if q.name not in held]
    free_u = [i for i, q in enumerate(dae.inputs) if q.name not in inputs]
    symbols = [dae.dx, dae.x, dae.z, dae.u]
    chosen = [(0, i) for i in cyclic] + [(1, i) for i in free_x] + [(2, i) for i in free_z] + [(3, i) for i in free_u]
    unknown = ca.vertcat(*(symbols[k][i] for k, i in chosen)) if chosen else ca.SX(0, 1)
    rows = dae.undisturbed(ca.vertcat(dae.residual, dae.invariants))
    newton = _Newton(unknown, ca.vertcat(*symbols, dae.p, dae.t), rows)
    full = [np.zeros(len(start.x)), start.x.copy(), start.z.copy(), start.u.copy()]
    for sharper in _widths(dae, values, parameters or {}):
        given = np.hstack([*full, sharper, t])
        found = newton.solve(np.array([full[k][i] for k, i in chosen]), given)
        for (k, i), value in zip(chosen, found.tolist(), strict=True):
            full[k][i] = value
    remainder = newton.remainder(found, given)
    if np.max(remainder, initial=0.0) > TOLERANCE:
        fixed = ", ".join(f"{name} = {value:g}" for name, value in {**inputs, **held}.items()) or "nothing held"
        raise SolveError(
            f"'{dae.name}' has no equilibrium near the guess with {fixed}: {_worst(dae, remainder)} cannot be fulfilled at rest; "
            "leave out an input so that its value is found, or give a guess nearer to the equilibrium"
        )
    dx, x, z, u = full
    return _point(dae, dx, x, z, u, values, t)


class _Start:
    """Numbers to start from: states and algebraics given by name or else at their start values, inputs or else zero."""

    def __init__(self, dae: Dae, given: Mapping[str, float], inputs: Mapping[str, float]) -> None:
        quantities = (*dae.states, *dae.algebraics)
        _known(dae, "x", given, quantities)
        _known(dae, "u", inputs, dae.inputs)
        self.x = np.array([float(given.get(q.name, q.start)) for q in dae.states])
        self.z = np.array([float(given.get(q.name, q.start)) for q in dae.algebraics])
        self.u = np.array([float(inputs.get(q.name, 0.0)) for q in dae.inputs])


class _Newton:
    """Gauss-Newton with least-norm steps for rows(y, given) = 0, rows and columns scaled to comparable size."""

    def __init__(self, unknown: Any, given: Any, rows: Any) -> None:
        symbol = ca.SX.sym("y", unknown.shape[0])
        rows = ca.substitute(rows, unknown, symbol) if unknown.shape[0] else rows
        self._both = ca.Function("both", [symbol, given], [rows, ca.densify(ca.jacobian(rows, symbol))])
        self._each = ca.Function("each", [symbol, given], [ca.densify(ca.jacobian(rows, ca.vertcat(symbol, given)))])

    def solve(self, y: Array, given: Array) -> Array:
        for _ in range(ITERATIONS):
            value, jacobian = self._at(y, given)
            size = np.maximum(np.abs(y), 1.0)
            weight = 1.0 / np.maximum(np.abs(jacobian * size).max(axis=1, initial=0.0), 1e-12 + np.abs(value))
            if not (np.all(np.isfinite(jacobian)) and np.all(np.isfinite(value))):
                return y
            step = size * np.linalg.lstsq(weight[:, None] * jacobian * size, weight * value, rcond=1e-13)[0]
            before = np.linalg.norm(weight * value)
            length = 1.0
            for _ in range(HALVINGS):
                trial = np.linalg.norm(weight * self._at(y - length * step, given)[0])
                if trial < before:  # false for nan
                    break
                length /= 2
            else:
                return y
            y = y - length * step
            if np.max(np.abs(step) / size, initial=0.0) < 1e-14:
                return y
        return y

    def remainder(self, y: Array, given: Array) -> Array:
        """|rows| relative to the largest term of each row; inf where it is not finite."""
        value, _ = self._at(y, given)
        terms = np.abs(self._each(y, given).full() * np.concatenate([y, given])).max(axis=1, initial=0.0)
        return np.asarray(np.where(np.isfinite(value), np.abs(value) / np.maximum(terms, 1e-12), np.inf), dtype=np.float64)

    def _at(self, y: Array, given: Array) -> tuple[Array, Array]:
        value, jacobian = self._both(y, given)
        return value.full()[:, 0], jacobian.full()


def _widths(dae: Dae, values: Array, given: Mapping[str, float]) -> list[Array]:
    """Parameter columns with the smoothing widths going from their defaults to those in force."""
    rounded = [i for i, q in enumerate(dae.parameters) if q.smoothing and q.name not in given]
    columns, factor = [values], 1.0
    while rounded and factor < 1e6:
        wider = values.copy()
        wider[rounded] = np.minimum(values[rounded] / SHARPENING * factor, [dae.parameters[i].value for i in rounded])
        if np.allclose(wider, columns[0], rtol=1e-12, atol=0.0):
            break
        columns.insert(0, wider)
        factor /= SHARPENING
    return columns


def _known(dae: Dae, argument: str, given: Mapping[str, float], quantities: tuple[Quantity, ...]) -> None:
    names = [q.name for q in quantities]
    kind = "input" if argument == "u" else "state or algebraic variable"
    for name, value in given.items():
        if name not in names:
            raise ModelError(f"'{name}': model '{dae.name}' has no such {kind}; {suggestion(name, names)}")
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(float(value)):
            raise ModelError(f"'{name}' = {value!r}: a finite number is needed")


def _worst(dae: Dae, remainder: Array) -> str:
    origins = [*(e.origin for e in dae.equations), *("a constraint between states" for _ in range(dae.invariants.shape[0]))]
    return ", ".join(dict.fromkeys(f"'{origins[i]}'" for i in np.flatnonzero(remainder > TOLERANCE)))


def _point(dae: Dae, dx: Array, x: Array, z: Array, u: Array, p: Array, t: float) -> OperatingPoint:
    def named(quantities: tuple[Any, ...], column: Array) -> dict[str, float]:
        return {q.name: float(value) for q, value in zip(quantities, column.tolist(), strict=True)}

    return OperatingPoint(
        x=named(dae.states, x),
        dx=named(dae.states, dx),
        z=named(dae.algebraics, z),
        u=named(dae.inputs, u),
        parameters=named(dae.parameters, p),
        t=float(t),
    )
