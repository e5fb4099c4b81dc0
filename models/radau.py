"""Adaptive Radau IIA integration of implicit equations F(x', x, z, u, p, t) = 0 (E. Hairer, G. Wanner, Solving ODEs II, IV.5 and IV.8).

Unknowns of a step of length h with s = 5 stages c_i (order 9, L-stable, stiffly accurate: the last stage is the end of the step):

    Y = [h x'_1 .. h x'_s | z_1 .. z_s]          s (nx + nz)
    0 = F(x'_i, x + h sum_j a_ij x'_j, z_i, u(t + c_i h), p, t + c_i h)         i = 1 .. s

The error of a step is the difference to the quadrature over the start and the stages 1 .. s-1, of order 5 and hence cautious. The start
is among its nodes so that a jump before c_1 is seen; the difference is filtered by (F_x' + g h F_x)^-1 F_x', g the weight of the start,
so that stiff transients which the method damps anyway do not shorten the step (Hairer and Wanner, eq. IV.8.19).

A one-step method loses nothing where an input jumps; a multistep one starts again at every sample, and then CVODES reaches 1e-8 at most
over 3000 samples of a linear axis, at a tolerance of 1e-11, and gives up at 1e-12. Here the same run is right to 1e-14.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .dae import Dae
from .errors import SolveError

Array = NDArray[np.float64]
STAGES = 5
_NEWTON = 8
_SMALLEST = 1e-15  # of the interval


def tableau(stages: int) -> tuple[Array, Array, Array]:
    """Nodes c (s,), coefficients a_ij (s, s), and the weights (1 + s,) of start and stages in the error quadrature."""
    c = np.array(ca.collocation_points(stages, "radau"))
    powers = np.arange(1, stages + 1)
    a = (c[:, None] ** powers / powers) @ np.linalg.inv(c[:, None] ** (powers - 1))
    nodes = np.concatenate([[0.0], c[:-1]])
    low = np.linalg.solve((nodes[:, None] ** (powers - 1)).T, 1.0 / powers)
    return c, a, np.concatenate([[0.0], a[-1]]) - np.concatenate([low, [0.0]])


class Stepper:
    """One model's step function. Inputs are linear within a sample: u(t) = base + slope (t - t_k)."""

    def __init__(self, dae: Dae, values: Array, rtol: float) -> None:
        self.nx, self.nz, self.rtol = dae.x.shape[0], dae.z.shape[0], rtol
        self.nominal = np.array([q.nominal for q in dae.states])
        self.seen = np.zeros(self.nx)  # largest size of each state so far
        c, a, self.error_weights = tableau(STAGES)
        self.weights = a[-1]
        residual = ca.substitute(ca.substitute(dae.residual, dae.w, 0 * dae.w), dae.p, ca.DM(values))
        x0, h, t0, since = ca.SX.sym("x0", self.nx), ca.SX.sym("h"), ca.SX.sym("t0"), ca.SX.sym("since")
        base, slope = ca.SX.sym("base", dae.u.shape[0]), ca.SX.sym("slope", dae.u.shape[0])

        increments, z = ca.SX.sym("Y", self.nx, STAGES), ca.SX.sym("Z", self.nz, STAGES)
        stage = ca.Function("stage", [dae.dx, dae.x, dae.z, dae.u, dae.t], [residual])
        rows = [
            stage(increments[:, i] / h, x0 + increments @ ca.DM(a[i]), z[:, i], base + slope * (since + c[i] * h), t0 + c[i] * h)
            for i in range(STAGES)
        ]
        self._step = _Call(
            newton_function(ca.vertcat(ca.vec(increments), ca.vec(z)), ca.vertcat(x0, h, t0, since, base, slope), ca.vertcat(*rows))
        )
        self._rate = _Call(newton_function(ca.vertcat(dae.dx, dae.z), ca.vertcat(dae.x, dae.u, dae.t), residual))
        raw, g = ca.SX.sym("raw", self.nx), abs(float(self.error_weights[0]))
        filtered, share = ca.SX.sym("filtered", self.nx), ca.SX.sym("share", self.nz)
        by_rate = ca.jacobian(residual, dae.dx)
        rows = by_rate @ (filtered - raw) + g * h * ca.jacobian(residual, dae.x) @ filtered + ca.jacobian(residual, dae.z) @ share
        self._filter = _Call(newton_function(ca.vertcat(filtered, share), ca.vertcat(raw, h, dae.dx, dae.z, dae.x, dae.u, dae.t), rows))

    def across(self, x: Array, z: Array, t: float, until: float, base: Array, slope: Array, try_first: float) -> tuple[Array, Array, float]:
        """From t to `until`, one sample: the states and algebraics there, and the step length to try next.

        Raises SolveError naming the time at which no step, however short, meets the tolerance.
        """
        interval = until - t
        since, h = 0.0, min(try_first, interval)  # time since t: what is added up must not drown in a large t
        rate, z = self.rate(x, z, base, t)
        while since < interval:
            last = interval - since <= h * (1 + 1e-9)
            h = interval - since if last else h
            result = self._attempt(x, z, rate, t + since, h, since, base, slope)
            if result is None:
                h *= 0.2
            else:
                new_x, new_z, new_rate, error = result
                if error <= 1.0:
                    x, z, rate, since = new_x, new_z, new_rate, interval if last else since + h
                    self.seen = np.maximum(self.seen, np.abs(x))
                h *= min(10.0, max(0.1, 0.9 * max(error, 1e-12) ** (-1 / (STAGES + 1))))
            if h < _SMALLEST * interval and since < interval:
                raise SolveError(
                    f"the integration stopped at t = {t + since:.9g} s: no step, however short, meets the tolerance {self.rtol:g}; "
                    "look for values that run away, or a law that is discontinuous there"
                )
        return x, z, h

    def rate(self, x: Array, z: Array, u: Array, t: float) -> tuple[Array, Array]:
        """x' and z at a point, from nearby z."""
        call = self._rate
        call.unknown[: self.nx] = 0.0
        call.unknown[self.nx :] = z
        call.given[:] = np.concatenate([x, u, [t]])
        for _ in range(_NEWTON):
            call()
            call.unknown -= call.result
            if np.all(np.abs(call.result) <= 1e-9 * (1.0 + np.abs(call.unknown))):
                break
        return call.unknown[: self.nx].copy(), call.unknown[self.nx :].copy()

    def _attempt(
        self, x: Array, z: Array, rate: Array, t: float, h: float, since: float, base: Array, slope: Array
    ) -> tuple[Array, Array, Array, float] | None:
        """One step: values and rates at its end, and the error in units of the tolerance; None where Newton's method does not converge."""
        nx, nz = self.nx, self.nz
        tolerance = self.rtol * np.maximum(np.maximum(np.abs(x), self.seen), 1e-3 * self.nominal)
        call, count = self._step, STAGES * nx
        y, change = call.unknown, call.result
        increments, ends = y[:count].reshape(STAGES, nx), y[count:].reshape(STAGES, nz)  # views
        increments[:] = h * rate
        ends[:] = z
        given = call.given
        given[:nx] = x
        given[nx : nx + 3] = h, t, since
        given[nx + 3 :] = np.concatenate([base, slope])
        before = np.inf
        for _ in range(_NEWTON):
            call()
            y -= change
            size = float((np.abs(change[:count].reshape(STAGES, nx)) / tolerance).max(initial=0.0))
            if nz:
                size = max(size, float((np.abs(change[count:]) / (self.rtol * (1.0 + np.abs(y[count:])))).max()))
            if not math.isfinite(size):
                return None
            if size < 1e-2 or (size < 1.0 and size > 0.3 * before):  # converged, or as far as rounding lets it
                break
            before = size
        else:
            return None
        check = self._filter
        check.unknown[:] = 0.0
        raw = self.error_weights[0] * h * rate + self.error_weights[1:] @ increments
        check.given[:] = np.concatenate([raw, [h], rate, z, x, base + slope * since, [t]])
        check()
        error = float((np.abs(check.result[:nx]) / tolerance).max(initial=0.0))
        if not math.isfinite(error):
            return None
        return x + self.weights @ increments, ends[-1].copy(), increments[-1] / h, error


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
        self._evaluate()
        if self._buffer.ret():  # a singular matrix
            self.result[:] = np.nan


def newton_function(unknown: Any, given: Any, equations: Any) -> Any:
    """(unknown, given) -> the Newton correction J^-1 F."""
    both = ca.Function("both", [unknown, given], [equations, ca.jacobian(equations, unknown)])
    y, r = ca.MX.sym("y", unknown.shape[0]), ca.MX.sym("r", given.shape[0])
    value, jacobian = both(y, r)
    return ca.Function("newton", [y, r], [ca.densify(ca.solve(jacobian, value, "qr"))])
