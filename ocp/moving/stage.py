"""One sampling interval of a moving horizon: its rows with their derivatives, and its link in a chain of orthogonal eliminations.

The unknowns of stage k are those of a mesh interval (`interpolation.py`) and the parameters, y = [x_k | interior_k | x_(k+1) | p]. With the
moments of `spline.py` its rows, linearised at the trajectory in force, are

    0 = J_h dy + e_h        equations without residual force
    e = J_s dy + e_s        residual forces over their deviations; outputs less samples at t_k over theirs;      e ~ N(0, I)

and what is known beforehand is R [dx_k; dp] + d ~ N(0, I). The exact rows give as many unknowns of [x_k | interior_k] in terms of the
others; Householder reflections of the rest eliminate those left over, v, and leave what is known of the next knot:

    | R   0 | d   |                      | S  ..  s  |      v given x_(k+1), p
    | J_s   | e_s |                 ->   | 0  R'  d' |      what is known of [x_(k+1) | p]

(G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chs. V and VI). No covariance is inverted and nothing need
be known at the start; R' is the square root of the information on x_(k+1) and p that the KKT system of all stages before leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae

from .. import spline
from ..interpolation import Interpolation
from ..pieces import Pieces
from ..polynomials import Array, gauss, legendre
from .elimination import back_substituted, best_determined, triangular


@dataclass(frozen=True)
class Stage:
    """The rows of a stage, and functions of them.

    free: the parameters p among the model's, of which `fixed` (np_all,) has the others' values. soft: places that have a residual force.
    Numbers of a stage, d (nd,): [h; t; u at the start; u at the end (nu); samples (ny); one over the deviations (n_soft + ny)], those of
    the newest sample, (1 + nu + 2 ny,): [t; u; samples; one over the deviations].
    """

    dae: Dae
    free: tuple[int, ...]
    fixed: Array
    soft: tuple[int, ...]
    degree: int

    @cached_property
    def interpolation(self) -> Interpolation:
        """Of the states and algebraic variables in the interval."""
        return spline.interpolation(self.dae, self.degree, len(self.soft))

    @cached_property
    def at_rest(self) -> Array:
        """Unknowns inside (interior,) where algebraic variables have their start values all the time and all else is zero."""
        ip, inner = self.interpolation, np.zeros(self.interpolation.interior)
        for e in ip.entries:
            if e.row >= 2 * ip.states and e.polynomial.degree() == 0:
                inner[e.column - ip.states] = self.dae.algebraics[e.row - 2 * ip.states].start
        return inner

    @cached_property
    def numbers(self) -> int:
        """nd."""
        return int(2 + 2 * self.dae.u.shape[0] + 2 * self.dae.output.shape[0] + len(self.soft))

    @cached_property
    def size(self) -> int:
        """nx + np."""
        return self.interpolation.states + len(self.free)

    @cached_property
    def prompt(self) -> tuple[int, ...]:
        """Outputs that the state tells at once; the others also see x', z or a residual force, and count when the stage is complete."""
        dae = self.dae
        slow = ca.jacobian_sparsity(dae.output, ca.vertcat(dae.dx, dae.z, dae.w))
        return tuple(i for i in range(dae.output.shape[0]) if i not in slow.row())

    @cached_property
    def direct(self) -> Any:
        """What residual forces do to the outputs at once, (ny, n_soft)."""
        return self._pieces.direct[1]

    # ---- functions

    @cached_property
    def balances(self) -> Any:
        """(y, p_ref, d) -> all moments (own,), their derivative in y (own, local + np); those without residual force first."""
        e = ca.vertcat(self._exact, self._noisy[: self.degree * len(self.soft)])
        return self._function("balances", [], [e, ca.jacobian(e, self._y)])

    @cached_property
    def residuals(self) -> Any:
        """(y, p_ref, d) -> e_s (m,), the samples last; sum of squares of e_h."""
        return self._function("residuals", [], [self._noisy, ca.sumsqr(self._exact)])

    @cached_property
    def rows(self) -> Any:
        """(y, p_ref, d) -> e_s (m,), J_s (m, local + np), e_h, J_h."""
        e, h = self._noisy, self._exact
        return self._function("rows", [], [e, ca.jacobian(e, self._y), h, ca.jacobian(h, self._y)])

    @cached_property
    def last(self) -> Any:
        """(x, p, numbers of the newest sample) -> e (ny,), J (ny, nx + np) of the outputs that it tells at once."""
        dae, nx, ny = self.dae, self.interpolation.states, self.dae.output.shape[0]
        x, p, d = ca.SX.sym("x", nx), ca.SX.sym("p", len(self.free)), ca.SX.sym("d", 1 + dae.u.shape[0] + 2 * ny)
        t, u, target, scale = ca.vertsplit(d, [0, 1, 1 + dae.u.shape[0], 1 + dae.u.shape[0] + ny, d.shape[0]])
        model = ca.Function("model", [dae.x, dae.u, dae.p, dae.t], [dae.output[list(self.prompt)]])
        e = ca.SX(ny, 1)
        e[list(self.prompt)] = ((model(x, u, self._parameters(p), t)) - target[list(self.prompt)]) * scale[list(self.prompt)]
        return ca.Function("last", [x, p, d], [ca.densify(e), ca.densify(ca.jacobian(e, ca.vertcat(x, p)))], {"cse": True})

    def links(self, typical: tuple[Array, Array, Array]) -> tuple[Any, Any, Any]:
        """Functions of the elimination; typical: (y, p_ref, d) that tell which unknowns the exact equations give best.

        forward  (Rd (n, n + 1), y, p_ref, d) -> Rd of the next knot, E (nx + interior, n + 1), the squares that the elimination takes away
        backward ([dx; dp] (n,) of the next knot, E) -> [dx; dp] of this one, d interior
        spread   (as forward) -> Rd of the next knot, E, G (nx + interior, m): [dx; d interior] = -E [dx'; dp'; 1] + G e with e ~ N(0, I)
        """
        ip, total, n = self.interpolation, self._y.shape[0], self.size
        nx, inner, own = ip.states, range(ip.states, ip.states + ip.interior), ip.states + ip.interior
        J_h = self._function("J", [], [ca.jacobian(self._exact, self._y)])(*typical)
        given = best_determined(np.array(J_h).reshape(-1, total), [inner, range(nx)])
        others = [i for i in [*inner, *range(nx)] if i not in given]
        columns, m, g = [*given, *others, *range(own, total), total], len(others), len(given)
        Rd = ca.SX.sym("Rd", n, n + 1)
        known = ca.SX(n, total + 1)
        known[:, [*range(nx), *range(ip.local, total), total]] = Rd
        exact = ca.horzcat(ca.jacobian(self._exact, self._y), ca.densify(self._exact))[:, columns]
        noisy = ca.vertcat(known, ca.horzcat(ca.jacobian(self._noisy, self._y), ca.densify(self._noisy)))[:, columns]
        of_given = back_substituted(triangular(exact, g), g)
        rest = triangular(ca.sparsify(noisy[:, g:] - noisy[:, :g] @ of_given), m + n)
        rest = ca.vertcat(rest, ca.SX(max(m + n - rest.shape[0], 0), rest.shape[1]))
        of_others = back_substituted(rest, m)
        E = ca.SX(own, n + 1)
        E[others, :] = of_others
        E[list(given), :] = of_given[:, m:] - of_given[:, :m] @ of_others
        forward = self._function("forward", [Rd], [rest[m : m + n, m:], E, ca.sumsqr(rest[:m, -1])])
        G = ca.SX(own, m)
        G[others, :] = back_substituted(ca.horzcat(rest[:m, :m], ca.SX.eye(m)), m)
        G[list(given), :] = -of_given[:, :m] @ G[others, :]
        spread = self._function("spread", [Rd], [rest[m : m + n, m:], E, G])
        right, E = ca.SX.sym("right", n), ca.SX.sym("E", own, n + 1)
        left = -(E[:, :n] @ right + E[:, n])
        backward = ca.Function("backward", [right, E], [ca.vertcat(left[:nx], right[nx:]), left[nx:]])
        return forward, backward, spread

    def sampled(self, name: str, expression: Any, places: Sequence[float]) -> Any:
        """(y, p_ref, d) -> a column of the model, undisturbed, at places of the interval, (rows, len(places))."""
        function = self._pieces.function(name, self.dae.undisturbed(expression))
        return self._function(name, [], [ca.horzcat(*(self._at(function, tau) for tau in places))])

    def _function(self, name: str, first: list[Any], results: list[Any]) -> Any:
        return ca.Function(name, [*first, self._y, self._p_ref, self._d], [ca.densify(r) for r in results], {"cse": True})

    # ---- rows

    @cached_property
    def _y(self) -> Any:
        return ca.SX.sym("y", self.interpolation.local + len(self.free))

    @cached_property
    def _p_ref(self) -> Any:
        return ca.SX.sym("p_ref", len(self.free))

    @cached_property
    def _d(self) -> Any:
        return ca.SX.sym("d", self.numbers)

    @cached_property
    def _split(self) -> list[Any]:
        """h, t, u at the start, u at the end, samples, scales of the forces, scales of the samples."""
        nu, ny, ns = self.dae.u.shape[0], self.dae.output.shape[0], len(self.soft)
        return list(ca.vertsplit(self._d, np.cumsum([0, 1, 1, nu, nu, ny, ns, ny]).tolist()))

    def _parameters(self, free: Any) -> Any:
        p = ca.SX(ca.DM(self.fixed))
        for k, i in enumerate(self.free):
            p[i] = free[k]
        return p

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.dae, self.interpolation, (), (), self.soft)

    def _at(self, function: Any, tau: float, more: Any = None) -> Any:
        """A function of the model at a place of the interval."""
        ip = self.interpolation
        h, t, u0, u1, *_ = self._split
        v = ca.SX(ip.rows, 1)
        for e in ip.entries:
            v[e.row] += float(e.differentiated(np.array(tau))) * h**e.power * self._y[e.column]
        p, p_ref = self._parameters(self._y[ip.local :]), self._parameters(self._p_ref)
        d = ca.vertcat(u0 + tau * (u1 - u0), t + tau * h)
        return function(v, p, p_ref, d if more is None else ca.vertcat(d, more))

    def _moments(self, name: str, expression: Any) -> Any:
        """Moments of rows of the model on the interval, (rows, degree)."""
        places, weights = gauss(self.degree + 1)
        function = self._pieces.function(name, expression)
        values = ca.horzcat(*(self._at(function, float(tau)) for tau in places))
        return values @ ca.DM((weights * legendre(self.degree, places)).T)

    @cached_property
    def _exact(self) -> Any:
        taken = {row for _, _, row in spline.pairs(self.dae)} | set(self._pieces.rows_of(self.soft))
        rows = [row for row in range(self.dae.residual.shape[0]) if row not in taken]
        moments = self._moments("equations", self.dae.residual[rows]) if rows else ca.SX(0, 1)
        return ca.sqrt(self._split[0]) * ca.vec(moments)

    @cached_property
    def _noisy(self) -> Any:
        h, *_, target, force_scale, sample_scale = self._split
        parts = [(self._outputs - target) * sample_scale]
        if self.soft:
            # a white force of density one has moments of variance 1/h
            moments = ca.sqrt(h) * self._moments("balances", self._pieces.balances())
            parts.insert(0, ca.vec(moments * ca.repmat(force_scale, 1, self.degree)))
        return ca.vertcat(*parts)

    @cached_property
    def _outputs(self) -> Any:
        """The outputs at the start of the stage; those that a force enters at once read its mean over the stage."""
        seen = self._pieces.outputs_at_samples(self.degree)
        more = [ca.SX.zeros(seen.rest.shape[0])]  # of a held input the interval misses nothing
        if seen.moments.shape[0]:
            more += [ca.SX(ca.DM([1.0] + [0.0] * (self.degree - 1))), ca.vec(self._moments("forces", seen.force))]
        symbols = ca.vertcat(seen.rest, seen.coefficients, seen.moments)
        return self._at(self._pieces.function("outputs", seen.output, symbols), 0.0, ca.vertcat(*more))
