"""A moving window of stages: the trajectory in force, what is known of its first knot, and Gauss-Newton steps through it.

Unknowns are the states at the knots, what is inside the intervals, and constant parameters. A step is a sweep of orthogonal eliminations
forwards (`stage.py`), a triangular system of size nx + np at the newest knot, and a substitution backwards. Its work is linear in the
window.

The arrival cost is the same elimination: what stage 0 leaves is all that it and everything before it tell of [x_1; p]. Linearised at the
trajectory in force when it leaves, that is the smoothing update; at the trajectory when knot 1 was the newest, the filtering update (M. J.
Tenny & J. B. Rawlings, American Control Conference 2002; C. V. Rao, J. B. Rawlings & D. Q. Mayne, IEEE Trans. Autom. Control 48, 2003).
On a linear model both are exact: the window is a Kalman filter, however short it is.

Huber's loss is met by iteratively reweighted squares, one reweighting a step: the quadratic above it, which touches it at the trajectory in
force, falls by the step and the loss with it.
"""

from __future__ import annotations

from collections import deque
from typing import Literal

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import lsq_linear

from ..polynomials import Array
from .called import Called
from .stage import Stage
from .trajectory import Known, Solve, Trajectory

Update = Literal["smoothing", "filtering"]

SQUARES = 1e300  # corner of a loss that has none
SINGULAR = 1e-10  # of the largest singular value of R, its columns scaled: less tells nothing
SUFFICIENT = 1e-4  # share of a step's promised descent that it must keep
SHORTEST = 2.0**-8  # step length at which no descent is left
PREDICTIONS = 10  # Newton steps of a prediction
PRECISE = 1e-9  # relative size of its last step


class Window:
    """At most `length` stages in a row, the newest last.

    here: the trajectory in force. d (nd, k): numbers of the stages; newest: those of the sample at the last knot; in both the samples'
    scales are what they are without loss. known: of every knot what the stages before it tell, None where it was not asked yet.
    corner (ny,): where Huber's loss of an output begins [deviations]; SQUARES where it does not. bounds: of p, each (np,).
    Rd (n, n + 1): what all samples tell of the newest state and p, about the trajectory before the last step.
    """

    def __init__(
        self, stage: Stage, length: int, known: Known, typical: Array, bounds: tuple[Array, Array], corner: Array, update: Update
    ) -> None:
        ip = stage.interpolation
        nx = ip.states
        self.stage, self.length, self.bounds, self.corner, self.update = stage, length, bounds, corner, update
        self.here = Trajectory(known.reference[:nx, None].copy(), np.empty((ip.interior, 0)), known.reference[nx:].copy())
        self.d, self.newest = np.empty((stage.numbers, 0)), np.zeros(stage.last.size1_in(2))
        self.known: deque[Known | None] = deque([known])
        self.Rd = known.Rd.copy()
        y = np.concatenate([known.reference[:nx], np.zeros(ip.interior), known.reference])
        forward, backward = stage.links((y, self.here.p, typical))
        self._forward, self._forwards = Called(forward), Called(forward.mapaccum("forwards", length))
        self._backward, self._backwards = Called(backward), Called(backward.mapaccum("backwards", length))
        self._residual, self._residuals = Called(stage.residuals), Called(stage.residuals.map(length))
        self._last, self._balances = Called(stage.last), Called(stage.balances)

    @property
    def count(self) -> int:
        """Number of stages."""
        return int(self.d.shape[1])

    # ---- moving

    def push(self, d: Array) -> None:
        """A stage more, predicted without residual force; the first one leaves when the window is full. d (nd,): its numbers."""
        if self.count == self.length:
            self._leave()
        x, inner = self.predicted(d)
        here = self.here
        self.here = Trajectory(np.column_stack([here.x, x]), np.column_stack([here.inner, inner]), here.p)
        self.d = np.column_stack([self.d, d])
        self.known.append(None)
        self.newest = np.zeros_like(self.newest)

    def _leave(self) -> None:
        here = self.here
        if self.update == "smoothing" or self.known[1] is None:
            d = self._weighed(self.d, self._lessened(self._errors(here, here.p)[0]))[:, 0]
            Rd = self._forward(self._arrival(here), here.stages[:, 0], here.p, d)[0]
            self.known[1] = Known(Rd=Rd.copy(), reference=np.concatenate([here.x[:, 1], here.p]))
        self.known.popleft()
        self.here, self.d = Trajectory(here.x[:, 1:], here.inner[:, 1:], here.p), self.d[:, 1:]

    def _arrival(self, at: Trajectory) -> Array:
        first = self.known[0]
        if first is None:
            raise RuntimeError("the first knot of a window is always known")
        return first.about(np.concatenate([at.x[:, 0], at.p]))

    def predicted(self, d: Array) -> tuple[Array, Array]:
        """State (nx,) at the end of a stage after the newest, and unknowns inside it, when no residual force acts in it."""
        ip, start, p = self.stage.interpolation, self.here.x[:, -1], self.here.p
        own = slice(ip.states, ip.local)
        y = np.concatenate([start, np.zeros(ip.interior), start, p])
        for _ in range(PREDICTIONS):
            e, J = self._balances(y, p, d)
            try:
                step = np.linalg.solve(J[:, own], -e[:, 0])
            except np.linalg.LinAlgError:
                break
            if not np.all(np.isfinite(step)):
                break
            y[own] += step
            if np.all(np.abs(step) <= PRECISE * (1.0 + np.abs(y[own]))):
                break
        return y[ip.states + ip.interior : ip.local], y[ip.states : ip.states + ip.interior]

    # ---- solving

    def solve(self, limit: int, tolerance: float) -> Solve:
        """Gauss-Newton steps until one moves the estimates, or misses the cost, by less than `tolerance` deviations; at most `limit`."""
        done = Solve(iterations=0, converged=False, size=np.inf, missed=np.inf)
        for iteration in range(1, limit + 1):
            e, last, broken = self._errors(self.here, self.here.p)
            w, w_last = self._lessened(e), self._lessened(last)
            cost = self._cost(self.here, e, last, w, w_last)
            step, promise = self._step(w, w_last)
            length, size = 1.0, float(np.sqrt(max(promise, 0.0)))
            while True:
                there = self.here.moved(step, length)
                e, last, open_ = self._errors(there, self.here.p)
                now = self._cost(there, e, last, w, w_last)
                if now <= cost - SUFFICIENT * length * promise or open_ < broken / 4 or size <= tolerance:
                    break
                length /= 2
                if length < SHORTEST or not np.isfinite(promise):
                    return Solve(iterations=iteration, converged=False, size=size, missed=np.inf)
            missed = float(np.sqrt(abs(now - cost + promise * length * (2 - length))))
            self.here = there
            done = Solve(iterations=iteration, converged=min(missed, size) <= tolerance, size=size, missed=missed)
            if done.converged:
                break
        return done

    def _errors(self, at: Trajectory, p_ref: Array) -> tuple[Array, Array, float]:
        """e_s (m, k) of all stages and e (ny,) of the newest sample, without loss, and the squares of what is to be zero.

        p_ref (np,): the parameters that inertias are referred to (`pieces.py`), the same throughout a step.
        """
        last = self._last(at.x[:, -1], at.p, self.newest)[0][:, 0].copy()
        if self.count == self.length:
            e, zeros = self._residuals(at.stages, np.broadcast_to(p_ref[:, None], at.parameters.shape), self.d)
            return e.copy(), last, float(zeros.sum())
        parts, exact, y = [np.empty((self.stage.residuals.size1_out(0), 0))], 0.0, at.stages
        for k in range(self.count):
            e, zeros = self._residual(y[:, k], p_ref, self.d[:, k])
            parts.append(e.copy())
            exact += float(zeros[0, 0])
        return np.hstack(parts), last, exact

    def _lessened(self, e: Array) -> Array:
        """Roots of the weights that Huber's loss gives the samples, (ny, ..), from residuals of which theirs are the last rows."""
        ny = len(self.corner)
        corner = self.corner.reshape(-1, *(1,) * (e.ndim - 1))
        return np.asarray(np.sqrt(corner / np.maximum(np.abs(e[len(e) - ny :]), corner)))

    @staticmethod
    def _weighed(d: Array, w: Array) -> Array:
        """Numbers whose last rows, the samples' scales, are multiplied."""
        return np.concatenate([d[: len(d) - len(w)], d[len(d) - len(w) :] * w])

    def _cost(self, at: Trajectory, e: Array, last: Array, w: Array, w_last: Array) -> float:
        """Sum of squares of everything noisy, the samples' lessened."""
        ny, known = len(w), self._arrival(at)[:, -1]
        return float(known @ known + np.sum(e[:-ny] ** 2) + np.sum((e[-ny:] * w) ** 2) + np.sum((last * w_last) ** 2))

    def _step(self, w: Array, w_last: Array) -> tuple[Trajectory, float]:
        """The Gauss-Newton step, and how far the sum of squares falls by it when the model is linear."""
        at, n, nx, k = self.here, self.stage.size, self.stage.interpolation.states, self.count
        roots, E, promise = self._swept(self._weighed(self.d, w))
        for j in range(k):
            if self.known[j + 1] is None:
                self.known[j + 1] = Known(
                    Rd=roots[:, j * (n + 1) : (j + 1) * (n + 1)].copy(), reference=np.concatenate([at.x[:, j + 1], at.p])
                )
        end = roots[:, (k - 1) * (n + 1) :] if k else self._arrival(at)
        e, J = self._last(at.x[:, -1], at.p, self._weighed(self.newest, w_last))
        self.Rd = np.asarray(np.linalg.qr(np.vstack([end, np.hstack([J, e])]), mode="r"), dtype=np.float64)[:n]
        right = self._bounded(self.Rd, at.p)
        left = self.Rd[:, :n] @ right + self.Rd[:, n]
        promise += float(self.Rd[:, n] @ self.Rd[:, n] - left @ left)
        dx, inner = np.empty_like(at.x), np.empty_like(at.inner)
        dx[:, -1] = right[:nx]
        if k == self.length:
            lefts, inside = self._backwards(right, E.reshape(len(E), k, n + 1)[:, ::-1].reshape(E.shape))
            dx[:, :-1], inner[:] = lefts[:nx, ::-1], inside[:, ::-1]
        else:
            now = right
            for j in range(k - 1, -1, -1):
                now, inside = (a[:, 0].copy() for a in self._backward(now, E[:, j * (n + 1) : (j + 1) * (n + 1)]))
                dx[:, j], inner[:, j] = now[:nx], inside
        return Trajectory(dx, inner, right[nx:].copy()), promise

    def _swept(self, d: Array) -> tuple[Array, Array, float]:
        """Rd of every next knot and E of every stage, side by side, and the squares that go."""
        at, Rd = self.here, self._arrival(self.here)
        if self.count == self.length:
            roots, E, squares = self._forwards(Rd, at.stages, at.parameters, d)
            return roots, E, float(squares.sum())
        y, total = at.stages, 0.0
        all_roots, all_E = [np.empty((len(Rd), 0))], [np.empty((len(at.x) + len(at.inner), 0))]
        for k in range(self.count):
            found = self._forward(Rd, y[:, k], at.p, d[:, k])
            Rd = found[0].copy()
            all_roots.append(Rd)
            all_E.append(found[1].copy())
            total += float(found[2][0, 0])
        return np.hstack(all_roots), np.hstack(all_E), total

    def _bounded(self, Rd: Array, p: Array) -> Array:
        """The step of the newest state and p that makes |R s + d| least, p within its bounds; what R does not tell stays."""
        n, R, d = len(Rd), Rd[:, :-1], Rd[:, -1]
        size = _lengths(R)
        if np.abs(np.diag(R) / size).min() > SINGULAR:
            s = np.asarray(lapack.dtrtrs(R, -d)[0])
        else:
            s = np.linalg.lstsq(R / size, -d, rcond=SINGULAR)[0] / size
        lower, upper = self.bounds[0] - p, self.bounds[1] - p
        first = n - len(p)
        if np.all(s[first:] >= lower) and np.all(s[first:] <= upper):
            return s
        free = np.full(first, np.inf)
        found = lsq_linear(
            R / size, -d, bounds=(np.concatenate([-free, lower]) * size, np.concatenate([free, upper]) * size), method="bvls"
        )
        return np.asarray(found.x / size)

    # ---- reading

    def covariance(self) -> Array:
        """Of the newest state and p, (n, n); inf on the diagonal where nothing is known."""
        R = self.Rd[:, :-1]
        size = _lengths(R)
        _, s, Vt = np.linalg.svd(R / size)
        told = s > SINGULAR * s.max(initial=1e-300)
        half = Vt[told] / s[told, None] / size
        C = half.T @ half
        unknown = np.any(np.abs(Vt[~told]) > np.sqrt(SINGULAR), axis=0)
        C[unknown, :] = C[:, unknown] = 0.0
        C[unknown, unknown] = np.inf
        return np.asarray(C)


def _lengths(R: Array) -> Array:
    """Of the columns, one for those that are zero."""
    size = np.sqrt(np.sum(R**2, axis=0))
    size[size == 0] = 1.0
    return np.asarray(size)
