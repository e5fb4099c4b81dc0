"""A generic experiment on a model, and the exact sensitivities of its outputs to initial states and parameters.

Radau IIA steps of s stages (order 2 s - 1) with random lengths between the model's fast and slow time constants, random inputs held over
each step. With K_j = x'_j the rates at the stages, a step solves

    0 = F(K_i, X_i, Z_i, u, p, t_i),      X_i = x + h sum_j a_ij K_j          i = 1 .. s

and the implicit-function theorem gives the derivatives of this discrete map without truncation: what two changes have in common in the
model they have in common here, so ranks can be read off to rounding.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..dae import Dae
from ..errors import SolveError
from ..simulation.radau import STAGES, tableau

Array = NDArray[np.float64]
STEPS = 60
ROOM = 3.0  # sizes of a state (nominal or start value) that the experiment may move it
# of the start from the start values, and of the parameters from theirs: smaller where the larger fails, as a stiff spring's does
SPREAD = (0.3, 0.1, 0.03, 3e-3, 3e-4)
RESOLUTION = 0.3  # shortest and longest steps over the fastest and slowest time constants
CANCELLED = 1e-12  # of the sum of magnitudes: what is left of terms that cancel
SCALES = 1e4  # most decades between them
_NEWTON = 12
_HALVINGS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """Sensitivities of ny outputs at M times to theta = [x(0) (nx), chosen parameters (np)].

    slopes      (ny, M, nx + np); zero where its terms cancel but for rounding
    constraint  (n, nx + np): changes of x(0) and p that keep the constraints between states fulfil constraint @ change = 0
    x           (nx,) the initial states, values (all parameters) the parameter values of this experiment
    """

    slopes: Array
    constraint: Array
    x: Array
    values: Array


def _drawn(dae: Dae, chosen: Sequence[int], values: Array, spread: float, sharpness: float, rng: np.random.Generator) -> Array:
    p = values.copy()
    for i in chosen:
        q = dae.parameters[i]
        p[i] = np.clip(p[i] * np.exp(spread * rng.uniform(-1.0, 1.0)), q.minimum, q.maximum)
    for i, q in enumerate(dae.parameters):
        if q.smoothing:
            size = max((s.nominal for s in dae.states if s.unit == q.unit), default=1.0)
            p[i] = max(values[i], (spread * size * rng.uniform(0.5, 1.5)) ** (1.0 - sharpness) * values[i] ** sharpness)
    return p


@dataclass(frozen=True, eq=False)
class _Step:
    """One solved step: x before it, rates (s, nx) and algebraics (s, nz) at its stages, held input, start, length."""

    x: Array
    rates: Array
    z: Array
    u: Array
    t: float
    h: float


class Laboratory:
    """Makes generic experiments on one model: F and h with their Jacobians, evaluated at all stages of a step at once.

    chosen  parameters (indices) whose sensitivities are wanted and which are perturbed; values of all parameters (np_all,)
    """

    def __init__(self, dae: Dae, chosen: Sequence[int], values: Array) -> None:
        self.dae, self.chosen, self.values = dae, list(chosen), values
        self.nx, self.nz, self.nu, self.ny = dae.x.shape[0], dae.z.shape[0], dae.u.shape[0], dae.output.shape[0]
        self.nominal = np.array([q.nominal for q in dae.states])
        self.size = np.maximum(self.nominal, np.abs([q.start for q in dae.states]))
        self.c, self.a, _ = tableau(STAGES)
        known = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
        p = ca.vertcat(*(dae.p[i] for i in self.chosen)) if self.chosen else ca.SX(0, 1)
        self._p = p
        residual, output, invariants = (dae.undisturbed(e) for e in (dae.residual, dae.output, dae.invariants))

        def function(rows: Any, *by: Any) -> Any:
            parts = [rows, *(ca.jacobian(rows, column) for column in by)]
            return ca.Function("f", known, [ca.densify(e) for e in parts])

        self._newton = function(residual, dae.dx, dae.x, dae.z)
        self._full = function(residual, dae.dx, dae.x, dae.z, p, dae.u)
        self._output = function(output, dae.dx, dae.x, dae.z, p)
        self._invariants = function(invariants, dae.x, p)
        self._mapped = {f: f.map(STAGES) for f in (self._newton, self._full, self._output)}

    def experiment(self, rng: np.random.Generator, sharpness: float = 0.0, vigour: float = 1.0) -> Experiment:
        """A random experiment around the start values of the states and the given values of the parameters.

        sharpness  smoothing widths between the size of the motion (0) and their values (1), geometrically: where the motion hardly leaves
                   the rounded part of a law, or hardly meets it, its parameters are hard to tell apart numerically
        vigour     factor of the inputs, and of the room for the motion: friction that holds a body hides it

        Raises SolveError where no experiment near the start values can be integrated.
        """
        for spread in SPREAD:
            for _ in range(2):
                p = _drawn(self.dae, self.chosen, self.values, spread, sharpness, rng)
                found = self._try(p, spread, vigour, rng)
                if found is not None:
                    return found
        raise SolveError(
            f"no experiment with '{self.dae.name}' near its start values could be integrated; give start values that the plant can be in"
        )

    def _try(self, p: Array, spread: float, vigour: float, rng: np.random.Generator) -> Experiment | None:
        start = np.array([q.start for q in self.dae.states])
        x = self._consistent(start + spread * self.nominal * rng.uniform(0.3, 1.0, self.nx) * self._signs(rng), p)
        z = np.array([q.start for q in self.dae.algebraics])
        rest = self._rates(x, z, np.zeros(self.nu), p) if x is not None else None
        if x is None or rest is None:
            return None
        rates, z, A, B = rest
        modes = np.abs(np.linalg.eigvals(A)) if self.nx else np.ones(1)
        fast = max(float(modes.max(initial=0.0)), 1e-6) if modes.max(initial=0.0) > 1e-9 else 1.0
        slow = float(min(modes[modes > fast / SCALES], default=fast))
        strength = vigour * self._strength(A, B, spread, slow)
        for scale, signs in itertools.product((1.0, 0.5, 0.25, 0.1, 0.03, 0.01, 0.003), ((-1.0, 1.0), (1.0, 1.0))):
            lengths = RESOLUTION * np.exp(rng.uniform(np.log(1.0 / fast), np.log(1.0 / slow), STEPS)) * scale
            inputs = strength * rng.uniform(0.3, 1.0, (STEPS, self.nu)) * rng.choice(signs, (STEPS, self.nu))
            steps = self._run(x, rates, z, lengths, inputs, p, vigour)
            if steps is not None:
                return self._differentiated(steps, p)
        return None

    def _signs(self, rng: np.random.Generator) -> Array:
        """Mostly upwards: a thrust, a level, a concentration is positive."""
        return np.where(rng.uniform(size=self.nx) < 0.8, 1.0, -1.0)

    def _strength(self, A: Array, B: Array, spread: float, slow: float) -> Array:
        """Inputs that move the states as far as they start from their start values, within their own time constants."""
        speed = np.maximum(np.abs(np.diag(A)), slow) * self.nominal * spread
        with np.errstate(divide="ignore"):
            each = np.where(np.abs(B) > 1e-12 * np.abs(B).max(initial=0.0), speed[:, None] / np.abs(B), np.inf)
        needed = each.min(axis=0, initial=np.inf)
        own = spread * np.array([q.nominal for q in self.dae.inputs])
        return np.where(np.isfinite(needed), needed, own)

    def _consistent(self, x: Array, p: Array) -> Array | None:
        """The nearest states that fulfil the constraints between states."""
        for _ in range(40):
            value, by_x, _ = self._constraints(x, p)
            if not value.size or np.max(np.abs(value)) < 1e-13 * max(1.0, float(np.abs(x).max())):
                return x
            if not np.all(np.isfinite(by_x)):
                return None
            x = x - np.linalg.lstsq(by_x, value, rcond=1e-10)[0]
        return x if np.max(np.abs(value)) < 1e-10 * max(1.0, float(np.abs(x).max())) else None

    def _constraints(self, x: Array, p: Array) -> tuple[Array, Array, Array]:
        nothing = (np.zeros(self.nx), x, np.zeros(self.nz), np.zeros(self.nu), p, 0.0)
        value, by_x, by_p = (m.full() for m in self._invariants(*nothing))
        return value[:, 0], by_x, by_p

    def _rates(self, x: Array, z: Array, u: Array, p: Array) -> tuple[Array, Array, Array, Array] | None:
        """x', z, and the slopes of x' by x and u at a point; None where Newton's method does not converge."""
        y = np.concatenate([np.zeros(self.nx), z])
        for _ in range(40):
            value, by_dx, by_x, by_z, _, by_u = (m.full() for m in self._full(y[: self.nx], x, y[self.nx :], u, p, 0.0))
            step = _solved(np.hstack([by_dx, by_z]), np.hstack([value, by_x, by_u]))
            if step is None:
                return None
            y = y - step[:, 0]
            if np.max(np.abs(step[:, 0]) / (1.0 + np.abs(y)), initial=0.0) < 1e-13:
                return y[: self.nx], y[self.nx :], -step[: self.nx, 1 : 1 + self.nx], -step[: self.nx, 1 + self.nx :]
        return None

    def _run(self, x: Array, rates: Array, z: Array, lengths: Array, inputs: Array, p: Array, vigour: float) -> list[_Step] | None:
        """The solved steps, or None where one has no solution or the states run away."""
        steps: list[_Step] = []
        low, high = x - vigour * ROOM * self.size, x + vigour * ROOM * self.size
        guess, t = rates, 0.0
        for h, u in zip(lengths.tolist(), inputs, strict=True):
            parts = self._across(x, guess, z, u, t, h, p, _HALVINGS)
            if parts is None:
                return None
            steps += parts
            last, t = parts[-1], t + h
            x, guess, z = last.x + last.h * self.a[-1] @ last.rates, last.rates[-1], last.z[-1]
            if not np.all((low <= x) & (x <= high)):
                return None
        return steps

    def _across(self, x: Array, guess: Array, z: Array, u: Array, t: float, h: float, p: Array, halvings: int) -> list[_Step] | None:
        step = self._step(x, guess, z, u, t, h, p)
        if step is not None:
            return [step]
        if not halvings:
            return None
        first = self._across(x, guess, z, u, t, h / 2, p, halvings - 1)
        if first is None:
            return None
        last = first[-1]
        middle = last.x + last.h * self.a[-1] @ last.rates
        second = self._across(middle, last.rates[-1], last.z[-1], u, t + h / 2, h / 2, p, halvings - 1)
        return None if second is None else [*first, *second]

    def _step(self, x: Array, guess: Array, z: Array, u: Array, t: float, h: float, p: Array) -> _Step | None:
        rates, algebraics = np.tile(guess, (STAGES, 1)), np.tile(z, (STAGES, 1))
        before = np.inf
        for _ in range(_NEWTON):
            step = _Step(x, rates, algebraics, u, t, h)
            value, by_dx, by_x, by_z = self._at(self._newton, step, p)
            change = _solved(self._matrix(by_dx, by_x, by_z, h), value.reshape(-1, 1))
            if change is None:
                return None
            rates = rates - change[: STAGES * self.nx, 0].reshape(STAGES, self.nx)
            algebraics = algebraics - change[STAGES * self.nx :, 0].reshape(STAGES, self.nz)
            size = float(np.max(np.abs(change[:, 0]) / (1.0 + np.abs(np.concatenate([rates.ravel(), algebraics.ravel()]))), initial=0.0))
            if size < 1e-13 or (size < 1e-9 and size > 0.1 * before):
                return _Step(x, rates, algebraics, u, t, h)
            before = size
        return None

    def _at(self, function: Any, step: _Step, p: Array) -> Iterator[Array]:
        """The values of a function at the stages, each (s, rows, columns) or (s, rows)."""
        states = step.x + step.h * self.a @ step.rates
        held = [np.tile(column[:, None], STAGES) for column in (step.u, p)]
        known = (step.rates.T, states.T, step.z.T, *held, step.t + step.h * self.c[None, :])
        for i, value in enumerate(self._mapped[function](*known)):
            flat = np.asarray(value.full(), dtype=np.float64)
            rows = flat.shape[0]
            yield flat.T if i == 0 else flat.reshape(rows, STAGES, function.size2_out(i)).transpose(1, 0, 2)

    def _matrix(self, by_dx: Array, by_x: Array, by_z: Array, h: float) -> Array:
        """Derivatives of all stage equations by all stage rates and algebraics."""
        s, n = STAGES, self.nx + self.nz
        rates, algebraics = np.zeros((s, n, s, self.nx)), np.zeros((s, n, s, self.nz))
        for i in range(s):
            rates[i] = h * by_x[i][:, None, :] * self.a[i][None, :, None]
            rates[i, :, i] += by_dx[i]
            algebraics[i, :, i] = by_z[i]
        return np.hstack([rates.reshape(s * n, s * self.nx), algebraics.reshape(s * n, s * self.nz)])

    def _differentiated(self, steps: list[_Step], p: Array) -> Experiment | None:
        """Sensitivities along solved steps."""
        nx, count = self.nx, self.nx + len(self.chosen)
        S, rows, sizes = np.eye(nx, count), [], []
        own = np.eye(count)[nx:]  # of the parameters by themselves
        for step in steps:
            _, by_dx, by_x, by_z, by_p, _ = self._at(self._full, step, p)
            slopes = _solved(self._matrix(by_dx, by_x, by_z, step.h), (by_x @ S + by_p @ own).reshape(-1, count))
            if slopes is None:
                return None
            dK, dZ = -slopes[: STAGES * nx].reshape(STAGES, nx, count), -slopes[STAGES * nx :].reshape(STAGES, self.nz, count)
            dX = S + step.h * np.tensordot(self.a, dK, axes=1)
            _, h_dx, h_x, h_z, h_p = self._at(self._output, step, p)
            rows.append(h_dx @ dK + h_x @ dX + h_z @ dZ + h_p @ own)
            sizes.append(abs(h_dx) @ abs(dK) + abs(h_x) @ abs(dX) + abs(h_z) @ abs(dZ) + abs(h_p) @ abs(own))
            S = dX[-1]
        slopes, size = (np.concatenate(blocks).transpose(1, 0, 2) for blocks in (rows, sizes))
        rounding = np.linalg.norm(slopes, axis=1) <= CANCELLED * np.linalg.norm(size, axis=1)
        slopes = np.where(rounding[:, None, :], 0.0, slopes)
        _, by_x, by_p = self._constraints(steps[0].x, p)
        constraint = np.hstack([by_x, by_p])
        return Experiment(slopes=slopes, constraint=constraint, x=steps[0].x, values=p) if np.all(np.isfinite(slopes)) else None


def _solved(matrix: Array, right: Array) -> Array | None:
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
        return None
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
