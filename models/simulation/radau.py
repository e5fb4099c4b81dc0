"""Adaptive Radau IIA integration of implicit equations F(x', x, z, u, t) = 0 (E. Hairer, G. Wanner, Solving ODEs II, IV.5 and IV.8).

Unknowns of a step of length h with s = 5 stages c_i (order 9, L-stable, stiffly accurate: the last stage is the end of the step):

    Y = [h x'_1 .. h x'_s | z_1 .. z_s]          s (nx + nz)
    0 = F(x'_i, x + h sum_j a_ij x'_j, z_i, u(t + c_i h), t + c_i h)         i = 1 .. s

The error of a step is the difference to the quadrature over the start and the stages 1 .. s-1, of order 5 and hence cautious. The start
is among its nodes so that a jump before c_1 is seen; the difference is filtered by (F_x' + g h F_x)^-1 F_x', g the weight of the start,
so that stiff transients which the method damps anyway do not shorten the step (Hairer and Wanner, eq. IV.8.19).

Where F is affine in x', x and z, as a machine between two switches often is, one Newton step is the solution, and a step is one call.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

SX = Any
Array = NDArray[np.float64]
STAGES = 5
_NEWTON = 8
_RATE_NEWTON = 12
_SMALL = 40  # unknowns up to which a call costs more than an iteration
_CLEAR = 0.3  # of its range within a step: how far a function stays from zero that is not looked at more closely


def tableau(stages: int) -> tuple[Array, Array, Array]:
    """Nodes c (s,), coefficients a_ij (s, s), and the weights (1 + s,) of start and stages in the error quadrature."""
    c = np.array(ca.collocation_points(stages, "radau"))
    powers = np.arange(1, stages + 1)
    a = (c[:, None] ** powers / powers) @ np.linalg.inv(c[:, None] ** (powers - 1))
    nodes = np.concatenate([[0.0], c[:-1]])
    low = np.linalg.solve((nodes[:, None] ** (powers - 1)).T, 1.0 / powers)
    return c, a, np.concatenate([[0.0], a[-1]]) - np.concatenate([low, [0.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class System:
    """Smooth equations F(x', x, z, u, t; m) = 0, nx + nz rows, and functions of the same arguments that stay positive (ng,); m numbers."""

    residual: SX
    dx: SX
    x: SX
    z: SX
    u: SX
    t: SX
    m: SX
    positive: SX


class Step:
    """A solved step.

    x, rate, z  states (nx,), their rates, and algebraics (nz,) at its end
    seen        largest size of each state so far, to which the tolerance is relative
    error       in units of the tolerance
    clear       > 0: no function that stays positive comes near zero
    positive    (ng, 1 + s) those functions at the start and the stages
    """

    __slots__ = ("clear", "error", "positive", "rate", "seen", "x", "z")

    def __init__(self, result: Array, nx: int, nz: int, ng: int) -> None:
        self.error, self.clear = float(result[-2]), float(result[-1])
        self.x, self.rate, self.seen, self.z = result[:nx], result[nx : 2 * nx], result[2 * nx : 3 * nx], result[3 * nx : 3 * nx + nz]
        self.positive = result[3 * nx + nz : 3 * nx + nz + ng * (1 + STAGES)].reshape(1 + STAGES, ng).T


class Stepper:
    """The step function of one system. Inputs are linear within a sample: u = base + slope (t - t_k)."""

    def __init__(self, system: System, nominal: Array, rtol: float) -> None:
        self.nx, self.nz, self.nu, self.nm = (v.shape[0] for v in (system.x, system.z, system.u, system.m))
        self.ng, self.rtol, self.floor = system.positive.shape[0], rtol, 1e-3 * nominal
        self.c, self.a, self.error_weights = tableau(STAGES)
        self.affine = bool(ca.is_linear(system.residual, ca.vertcat(system.dx, system.x, system.z)))
        self._inner = 1 if self.affine or STAGES * (self.nx + self.nz) > _SMALL else 2  # iterations in one call
        self._newton, self._end = (_Call(function) for function in self._step_functions(system))
        known = ca.vertcat(system.x, system.u, system.t, system.m)
        unknown = ca.vertcat(system.dx, system.z)
        self.equations = _both(unknown, known, system.residual)
        self._rate = _Call(self._rate_function(unknown, known, system.positive))

    def _rate_function(self, unknown: SX, known: SX, positive: SX) -> Any:
        """(x' and z, x u t m) -> x' and z after a Newton step, the positive functions there, the largest change."""
        watch = ca.Function("watch", [unknown, known], [ca.densify(positive)])
        y, r = ca.MX.sym("y", unknown.shape[0]), ca.MX.sym("r", known.shape[0])
        value, jacobian = self.equations(y, r)
        change = ca.solve(jacobian, value, "qr")
        found = y - change
        largest = ca.mmax(ca.fabs(change)) / (1.0 + ca.mmax(ca.fabs(found))) if unknown.shape[0] else ca.MX(0)
        return ca.Function("rate", [y, r], [ca.densify(ca.vertcat(found, watch(found, r), largest))])

    def _step_functions(self, system: System) -> tuple[Any, Any]:
        """(Y, x h t since base slope m x'_0 z_0 seen) -> Y after Newton steps and the last change, and -> the fields of `Step`.

        Where F is affine the second one takes the Newton step itself, from any Y.
        """
        nx, c, a = self.nx, self.c, self.a
        x0, rate, z0, seen = (ca.SX.sym(name, size) for name, size in (("x0", nx), ("rate", nx), ("z0", self.nz), ("seen", nx)))
        h, t0, since = ca.SX.sym("h"), ca.SX.sym("t0"), ca.SX.sym("since")
        base, slope = ca.SX.sym("base", self.nu), ca.SX.sym("slope", self.nu)
        given = ca.vertcat(x0, h, t0, since, base, slope, system.m, rate, z0, seen)
        increments, z = ca.SX.sym("Y", nx, STAGES), ca.SX.sym("Z", self.nz, STAGES)
        arguments = [(rate, x0, z0, base + slope * since, t0)] + [
            (increments[:, i] / h, x0 + increments @ ca.DM(a[i]), z[:, i], base + slope * (since + c[i] * h), t0 + c[i] * h)
            for i in range(STAGES)
        ]
        point = [system.dx, system.x, system.z, system.u, system.t, system.m]
        stage = ca.Function("stage", point, [system.residual])
        unknown = ca.vertcat(ca.vec(increments), ca.vec(z))
        both = _both(unknown, given, ca.vertcat(*(stage(*values, system.m) for values in arguments[1:])))

        watch = ca.Function("watch", point, [ca.densify(system.positive)])
        table = ca.horzcat(*(watch(*values, system.m) for values in arguments))
        clear = [ca.mmin(row) - _CLEAR * (ca.mmax(row) - ca.mmin(row)) for row in ca.vertsplit(table)] if self.ng else []
        end = x0 + increments @ ca.DM(a[-1])
        tolerance = self.rtol * ca.fmax(ca.fmax(ca.fabs(x0), seen), ca.DM(self.floor))
        fields = [end, increments[:, -1] / h, ca.fmax(seen, ca.fabs(end)), z[:, -1], ca.vec(table)]
        clear_of_all = ca.mmin(ca.vertcat(*clear)) if clear else ca.SX(1)
        finish = ca.Function("finish", [unknown, given], [ca.densify(ca.vertcat(*fields)), clear_of_all, tolerance])
        scale = ca.vertcat(ca.repmat(tolerance, STAGES, 1), self.rtol * (1 + ca.fabs(ca.vec(z))))
        newton = ca.Function("scale", [unknown, given], [ca.densify(scale)])

        raw, g = self.error_weights[0] * h * rate + increments @ ca.DM(self.error_weights[1:]), abs(float(self.error_weights[0]))
        slopes = ca.Function("slopes", point, [ca.jacobian(system.residual, v) for v in (system.dx, system.x, system.z)])
        at_rate, at_x, at_z = slopes(*arguments[0], system.m)
        filtering = ca.Function("filter", [unknown, given], [ca.horzcat(at_rate + g * h * at_x, at_z), at_rate @ raw])

        y, r = ca.MX.sym("y", unknown.shape[0]), ca.MX.sym("r", given.shape[0])
        parts, clearance, tolerated = finish(y, r)
        matrix, right = filtering(y, r)
        filtered = ca.solve(matrix, right, "qr")[:nx]
        error = ca.mmax(ca.fabs(filtered) / tolerated) if nx else ca.MX(0)
        end = ca.Function("end", [y, r], [ca.densify(ca.vertcat(parts, error, clearance))])
        found, change = y, ca.MX.zeros(unknown.shape[0])
        for _ in range(self._inner):
            value, jacobian = both(found, r)
            change = ca.solve(jacobian, value, "qr")
            found = found - change
        if self.affine:
            end = ca.Function("end", [y, r], [end(found, r)])
        moved = ca.mmax(ca.fabs(change) / newton(found, r)) if unknown.shape[0] else ca.MX(0)
        return ca.Function("newton", [y, r], [ca.densify(ca.vertcat(found, moved))]), end

    def rate(self, x: Array, z: Array, u: Array, t: float, m: Array) -> tuple[Array, Array, Array] | None:
        """x', z and the positive functions at a point, from nearby z; None where Newton's method does not get there."""
        call, nx, size = self._rate, self.nx, self.nx + self.nz
        call.unknown[:nx] = 0.0
        call.unknown[nx:] = z
        call.given[:] = np.concatenate((x, u, (t,), m))
        for _ in range(_RATE_NEWTON):
            call()
            change = call.result[-1]
            if self.affine or not change > 1e-12:
                break
            call.unknown[:] = call.result[:size]
        if not change <= (np.inf if self.affine else 1e-12):
            return None
        found = call.result.copy()
        return found[:nx], found[nx:size], found[size:-1]

    def attempt(
        self, x: Array, z: Array, rate: Array, t: float, h: float, since: float, base: Array, slope: Array, m: Array, seen: Array
    ) -> Step | None:
        """One step from t, `since` after the sample that holds `base`; None where Newton's method does not converge.

        seen  largest size of each state so far, to which the tolerance is relative
        """
        end = self._end
        end.given[:] = np.concatenate((x, (h, t, since), base, slope, m, rate, z, seen))
        if not self.affine and not self._solved(h * rate, z):
            return None
        end()
        if not math.isfinite(end.result[-2]):
            return None
        return Step(end.result.copy(), self.nx, self.nz, self.ng)

    def _solved(self, increment: Array, z: Array) -> bool:
        """Newton's method for the stages, from constant rates; whether it converges."""
        call, count = self._newton, STAGES * self.nx
        y, result = call.unknown, call.result
        y[:count].reshape(STAGES, self.nx)[:] = increment
        y[count:].reshape(STAGES, self.nz)[:] = z
        call.given[:] = self._end.given
        before = np.inf
        for _ in range(_NEWTON // self._inner):
            call()
            largest = float(result[-1])
            if not largest <= before * 10.0:  # true for nan
                return False
            y[:] = result[:-1]
            if largest < 1e-2 or (largest < 1.0 and largest > 0.3 * before):  # converged, or as far as rounding lets it
                self._end.unknown[:] = y
                return True
            before = largest
        return False


class _Call:
    """A two-argument CasADi function evaluated in place: twenty times faster than through DM."""

    def __init__(self, function: Any) -> None:
        self.unknown, self.given = np.zeros(function.size1_in(0)), np.zeros(function.size1_in(1))
        self.result = np.zeros(function.size1_out(0))
        self._function = function  # the buffer does not keep it alive
        self._buffer, self._evaluate = function.buffer()
        self._buffer.set_arg(0, self.unknown.data)
        self._buffer.set_arg(1, self.given.data)
        self._buffer.set_res(0, self.result.data)

    def __call__(self) -> None:
        self.result[-3:] = math.nan  # stays so where a matrix is singular
        self._evaluate()


def _both(unknown: SX, given: SX, equations: SX) -> Any:
    """(unknown, given) -> the equations and their Jacobian."""
    return ca.Function("both", [unknown, given], [ca.densify(equations), ca.jacobian(equations, unknown)])
