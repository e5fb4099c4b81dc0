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

The same window as a nonlinear program has the same solution (`tests/benchmarks/tracking_solvers.py`: within 1e-8 deviations in the median,
3e-4 at most). Warm-started Ipopt takes 4.0 times as long for it on an axis, fatrop 1.6 times, all in CasADi's virtual machine, and neither
leaves the square roots that the arrival cost and the covariances are read from. So these steps are the only solver of a window.
"""

from __future__ import annotations

from collections import deque
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas
from scipy.optimize import lsq_linear

from ..called import Called
from ..polynomials import Array
from .native import native
from .prediction import Prediction
from .roots import SINGULAR, joined, lengths, root
from .stage import Stage
from .trajectory import Known, Solve, Trajectory

Update = Literal["smoothing", "filtering"]

SQUARES = 1e300  # corner of a loss that has none
TRUSTED, ORDINARY, DOUBTED = 1, 0, -1
ALIKE = 3.0  # times the median of a run of doubted samples: what is further off than that is an error of its own
SETTLED = 0.02  # of a deviation: what reweighing may still move
SUFFICIENT = 1e-4  # share of a step's promised descent that it must keep
ROUNDING = 1e-14  # of a sum of squares: what it is wrong by
ENOUGH = 0.5  # share of what a linear model says the cost falls by: below that a shorter step is tried
SHORTEST = 2.0**-8  # step length at which no descent is left


class Window:
    """At most `length` stages in a row, the newest last.

    here: the trajectory in force. d (nd, k): numbers of the stages; newest: those of the sample at the last knot; in both the samples'
    scales are what they are without loss. known: of every knot what the stages before it tell, None where it was not asked yet.
    corner (ny,): where Huber's loss of an output begins [deviations]; SQUARES where it does not. faith (ny, k) and (ny,): of every
    sample TRUSTED, as a square all the same, DOUBTED, not at all for now, or ORDINARY. bounds: of the newest x and of p, each (n,).
    reach (n,): how far a step may go that nothing tells, inf for any length.
    jit: what is evaluated in every stage is compiled to C code (`native.py`); slow: why it is not, if it was to be.
    told: what all samples tell of the newest state and p; ahead: what they told of it before its own
    sample, or of the knot `passed` stages before; before: what they tell of the knot before the newest without its own.
    """

    def __init__(
        self,
        stage: Stage,
        length: int,
        known: Known,
        typical: Array,
        bounds: tuple[Array, Array],
        corner: Array,
        update: Update,
        reach: Array | None = None,
        *,
        jit: bool = False,
    ) -> None:
        ip = stage.interpolation
        nx = ip.states
        self.stage, self.length, self.bounds, self.corner, self.update = stage, length, bounds, corner, update
        self._reach = np.full(stage.size, np.inf) if reach is None else reach
        self.here = Trajectory(known.reference[:nx, None].copy(), np.empty((ip.interior, 0)), known.reference[nx:].copy())
        self.d, self.newest = np.empty((stage.numbers, 0)), np.zeros(stage.last.size1_in(2))
        self.faith, self.faith_newest = np.empty((len(corner), 0), dtype=np.int8), np.zeros(len(corner), dtype=np.int8)
        self.known: deque[Known | None] = deque([known])
        self.told = self.ahead = self.before = known
        self.passed = 0
        self._seen: tuple[Trajectory, Array, Array] | None = None  # a trajectory and its residuals, samples last
        self._root: tuple[Known, tuple[Array, NDArray[np.bool_]]] | None = None  # of what is told, once it was asked for
        y = np.concatenate([known.reference[:nx], stage.at_rest, known.reference])
        forward, backward, spread = stage.links((y, self.here.p, typical))
        often, self.slow = [forward, backward, stage.residuals, stage.balances], ""
        if jit:
            often, self.slow = native(often)
        forward, backward, residuals, balances = often
        self._forward, self._forwards = Called(forward), Called(forward.mapaccum("forwards", length))
        self._backward, self._backwards = Called(backward), Called(backward.mapaccum("backwards", length))
        self._residual, self._residuals = Called(residuals), Called(residuals.map(length))
        self._last, self._rows, self._spread = Called(stage.last), Called(stage.rows), Called(spread)
        self._predicted, self._exact = Prediction(stage, balances), stage.rows.size1_out(2)

    @property
    def count(self) -> int:
        """Number of stages."""
        return int(self.d.shape[1])

    # ---- moving

    def push(self, d: Array) -> None:
        """A stage more, predicted without residual force; the first one leaves when the window is full. d (nd,): its numbers."""
        if self.count == self.length:
            self._leave()
        here = self.here
        x, inner = self._predicted(here.x[:, -1], here.p, d, here.inner[:, -1] if here.inner.shape[1] else self.stage.at_rest)
        self.here = Trajectory(np.column_stack([here.x, x]), np.column_stack([here.inner, inner]), here.p)
        self.d = np.column_stack([self.d, d])
        self.known.append(None)
        self.passed += 1
        self.faith = np.column_stack([self.faith, self.faith_newest])
        self.newest, self.faith_newest = np.zeros_like(self.newest), np.zeros_like(self.faith_newest)

    def _leave(self) -> None:
        here = self.here
        if self.update == "smoothing" or self.known[1] is None:
            y, d = here.stages[:, 0], self.d[:, 0]
            d = self._weighed(d, self._lessened(self._residual(y, here.p, d)[0][:, 0], self.faith[:, 0]))
            Rd = self._forward(self._arrival(here), y, here.p, d)[0]
            self.known[1] = Known(Rd=Rd.copy(), reference=np.concatenate([here.x[:, 1], here.p]))
        self.known.popleft()
        self.here, self.d = Trajectory(here.x[:, 1:], here.inner[:, 1:], here.p), self.d[:, 1:]
        self.faith = self.faith[:, 1:]

    def restart(self, Rd: Array, x: Array) -> None:
        """No stage and a new state x (nx,), of which Rd (nx, nx + 1) is known; what is known of the parameters stays."""
        nx, n, p = len(x), self.stage.size, self.here.p
        told = self.told.about(np.concatenate([self.here.x[:, -1], p]))
        told = np.asarray(np.linalg.qr(told, mode="r"), dtype=np.float64)
        both = np.zeros((n, n + 1))
        both[:nx, :nx], both[:nx, n] = Rd[:, :nx], Rd[:, nx]
        both[nx:, nx:] = told[nx:n, nx:]
        known = Known(Rd=both, reference=np.concatenate([x, p]))
        self.here = Trajectory(x[:, None].copy(), np.empty((len(self.here.inner), 0)), p)
        self.d, self.faith = self.d[:, :0], self.faith[:, :0]
        self.newest, self.faith_newest = np.zeros_like(self.newest), np.zeros_like(self.faith_newest)
        self.known, self.told, self.ahead, self.before = deque([known]), known, known, known
        self.passed = 0

    def look_ahead(self) -> None:
        """What the samples before the newest one tell of the newest state, along the trajectory in force."""
        at, y = self.here, self.here.stages
        first = max(self.count - self.passed, 0)
        known = self.known[0] if self.passed > self.count else self.ahead
        for j in range(first, self.count):
            if known is None:
                raise RuntimeError("the first knot of a window is always known")
            d = self.d[:, j]
            w = self._lessened(self._residual(y[:, j], at.p, d)[0][:, 0], self.faith[:, j])
            Rd = self._forward(known.about(np.concatenate([at.x[:, j], at.p])), y[:, j], at.p, self._weighed(d, w))[0]
            known = Known(Rd=Rd.copy(), reference=np.concatenate([at.x[:, j + 1], at.p]))
        if known is not None:
            self.ahead, self.passed = known, 0

    def give_up(self, here: Trajectory) -> None:
        """Back to a trajectory, which the newest sample has told nothing of."""
        self.here, self.told = here, self.ahead
        for j in range(1, len(self.known)):
            known = self.known[j]
            if known is not None and not np.all(np.isfinite(known.Rd)):
                self.known[j] = None

    def reopen(self, stage: int) -> None:
        """What was known of the knots after a stage is not true any more: it has another sample, or another faith in one."""
        for j in range(stage + 1, len(self.known)):
            self.known[j] = None

    def _arrival(self, at: Trajectory) -> Array:
        first = self.known[0]
        if first is None:
            raise RuntimeError("the first knot of a window is always known")
        return first.about(np.concatenate([at.x[:, 0], at.p]))

    # ---- solving

    def solve(self, limit: int, tolerance: float) -> Solve:
        """Gauss-Newton steps until one moves the estimates, or misses the cost, by less than `tolerance` deviations; at most `limit`."""
        done, self._seen = Solve(iterations=0, converged=False, size=np.inf, missed=np.inf), None
        for iteration in range(1, limit + 1):
            e, last, broken = self._errors(self.here, self.here.p)
            w, w_last = self._lessened(e, self.faith), self._lessened(last, self.faith_newest)
            cost = self._cost(self.here, e, last, w, w_last)
            step, promise = self._step(w, w_last)
            size = float(np.sqrt(max(promise, 0.0)))
            small = promise <= max(tolerance**2, ROUNDING * cost)
            found = self._searched(step, promise, cost, broken, (w, w_last), small)
            if found is None:
                return Solve(iterations=iteration, converged=False, size=size, missed=np.inf)
            length, now, there, e, last = found
            missed = float(np.sqrt(abs(now - cost + promise * length * (2 - length))))
            self.here = there
            self._seen = there, e, last
            reweighed = self._reweighed(e, w, self.faith) + self._reweighed(last, w_last, self.faith_newest)
            settled = small or (missed <= tolerance and reweighed <= SETTLED**2)
            done = Solve(iterations=iteration, converged=settled, size=size, missed=missed)
            if done.converged:
                break
        return done

    def _rolled(self, step: Trajectory, length: float) -> Trajectory:
        """Some way along a step in the first state, p and the residual forces, the other states as the balances then have them.

        Where balances are tight the cost rises steeply along the straight line of a good step, by what that leaves of their curves. Along
        this curve they stay as the linear model has them (a second-order correction).
        """
        at, balances, straight = self.here, self._predicted.balances, self.here.moved(step, length)
        now, there, dy, nx, own = at.stages, straight.stages, step.stages, len(at.x), self.stage.interpolation.local
        x, inner = straight.x.copy(), straight.inner.copy()
        for k in range(self.count):
            e, J = balances(now[:, k], at.p, self.d[:, k])
            wanted = e[:, 0] + length * (J @ dy[:, k])
            wanted[: self._exact] = 0.0
            y = there[:, k].copy()
            y[:nx] = x[:, k]
            y = self._predicted.solved(y, at.p, self.d[:, k], wanted)
            inner[:, k], x[:, k + 1] = y[nx : own - nx], y[own - nx : own]
        return Trajectory(x, inner, straight.p)

    def _searched(
        self, step: Trajectory, promise: float, cost: float, broken: float, weights: tuple[Array, Array], small: bool
    ) -> tuple[float, float, Trajectory, Array, Array] | None:
        """How far along a step, the cost there, the trajectory and its residuals; None where nothing falls.

        The cost begins with the slope -2 promise, so the parabola through its values at 0 and t is least at promise t^2 / (cost(t) - cost
        + 2 promise t). That is tried where the cost falls by less than ENOUGH of what a linear model says: whole steps over a bend in the
        model land as high on its other side, and would go to and fro.
        """
        best, t = None, 1.0
        while t >= SHORTEST and np.isfinite(promise):
            tried = []
            for way in (self.here.moved, self._rolled):
                there = way(step, t)
                e, last, open_ = self._errors(there, self.here.p)
                now, closer = self._cost(there, e, last, *weights), open_ < broken / 4 or small
                tried.append((t, now, there, e, last))
                if falls := now <= cost - SUFFICIENT * t * promise or closer:
                    break
            reached = tried[-1 if falls else 0]  # where neither falls the straight way tells the parabola
            now = reached[1]
            if best is not None and now >= best[1]:
                break
            if falls:
                best = reached
                if closer or now <= cost - ENOUGH * promise * t * (2 - t):
                    break
            rise = max(now - cost, -promise * t)
            t = float(np.clip(promise * t**2 / (rise + 2 * promise * t), t / 10, 2 * t / 3)) if np.isfinite(rise) else t / 2
        return best

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

    def _lessened(self, e: Array, faith: NDArray[np.int8]) -> Array:
        """Roots of the weights of the samples, (ny, ..), from residuals of which theirs are the last rows."""
        ny = len(self.corner)
        size = np.abs(e[len(e) - ny :])
        if not faith.any() and not (size > self.corner.reshape(-1, *(1,) * (e.ndim - 1))).any():
            return np.ones(size.shape)
        corner = np.where(faith == TRUSTED, SQUARES, self.corner.reshape(-1, *(1,) * (e.ndim - 1)))
        w = np.sqrt(corner / np.maximum(size, corner))
        return np.asarray(np.where(faith == DOUBTED, 0.0, w))

    def _reweighed(self, e: Array, w: Array, faith: NDArray[np.int8]) -> float:
        """Square of what other weights than w change in the samples' residuals [deviations]."""
        now = self._lessened(e, faith)
        return float((((now**2 - w**2) * e[len(e) - len(self.corner) :]) ** 2).sum())

    @staticmethod
    def _weighed(d: Array, w: Array) -> Array:
        """Numbers whose last rows, the samples' scales, are multiplied."""
        return np.concatenate([d[: len(d) - len(w)], d[len(d) - len(w) :] * w])

    def _cost(self, at: Trajectory, e: Array, last: Array, w: Array, w_last: Array) -> float:
        """Sum of squares of everything noisy, the samples' lessened."""
        ny, known = len(w), self._arrival(at)[:, -1]
        return float(known @ known + (e[:-ny] ** 2).sum() + ((e[-ny:] * w) ** 2).sum() + ((last * w_last) ** 2).sum())

    def _step(self, w: Array, w_last: Array) -> tuple[Trajectory, float]:
        """The Gauss-Newton step, and how far the sum of squares falls by it when the model is linear."""
        at, n, nx, k = self.here, self.stage.size, self.stage.interpolation.states, self.count
        d, arrival = self._weighed(self.d, w), self._arrival(at)
        roots, E, promise = self._swept(arrival, d)
        for j in range(k):
            if self.known[j + 1] is None:
                self.known[j + 1] = Known(
                    Rd=roots[:, j * (n + 1) : (j + 1) * (n + 1)].copy(), reference=np.concatenate([at.x[:, j + 1], at.p])
                )
        end = roots[:, (k - 1) * (n + 1) :] if k else arrival
        last = np.hstack(self._last(at.x[:, -1], at.p, self._weighed(self.newest, w_last))[::-1])
        Rd = joined(end, last)
        newest = np.concatenate([at.x[:, -1], at.p])
        self.ahead, self.told, self.passed = Known(Rd=end.copy(), reference=newest), Known(Rd=Rd, reference=newest), 0
        if k > 1:
            before = np.concatenate([at.x[:, -2], at.p])
            self.before = Known(Rd=roots[:, (k - 2) * (n + 1) : (k - 1) * (n + 1)].copy(), reference=before)
        elif k == 1:
            self.before = Known(Rd=arrival, reference=np.concatenate([at.x[:, 0], at.p]))
        if self._adrift(Rd):
            near = joined(arrival, np.column_stack([np.diag(1 / self._reach), np.zeros(n)]))
            roots, E, promise = self._swept(near, d)
            Rd = joined(roots[:, (k - 1) * (n + 1) :] if k else near, last)
        right = self._bounded(Rd, newest)
        left = Rd[:, :n] @ right + Rd[:, n]
        promise += float(Rd[:, n] @ Rd[:, n] - left @ left)
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

    def _adrift(self, Rd: Array) -> bool:
        """Whether a state is told less well than to its reach.

        Then the first knot moves no further than to the reach in a step, by a proximal point (R. T. Rockafellar, SIAM J. Control Optim.
        14, 1976): away from here the linear model says nothing. The solution stays where it is, and what is told of it too.
        """
        if not np.isfinite(self._reach).any():
            return False
        half, unknown = root(Rd[:, :-1])
        return bool(np.any((unknown | (np.sum(half**2, axis=1) > self._reach**2)) & np.isfinite(self._reach)))

    def _swept(self, Rd: Array, d: Array) -> tuple[Array, Array, float]:
        """Rd of every next knot and E of every stage, side by side, and the squares that go; Rd: of the first knot."""
        at = self.here
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

    def _bounded(self, Rd: Array, here: Array) -> Array:
        """The step of the newest state and p that makes |R s + d| least, within their bounds; what R does not tell stays."""
        R, d = Rd[:, :-1], Rd[:, -1]
        size = lengths(R)
        if np.abs(np.diag(R) / size).min() > SINGULAR:
            s = np.asarray(blas.dtrsv(R, -d))
        else:
            s = np.linalg.lstsq(R / size, -d, rcond=SINGULAR)[0] / size
        lower, upper = self.bounds[0] - here, self.bounds[1] - here
        if (s >= lower).all() and (s <= upper).all():
            return s
        found = lsq_linear(R / size, -d, bounds=(lower * size, upper * size), method="bvls")
        return np.asarray(found.x / size)

    def doubt(self, surprise: Array, gate: float) -> None:
        """Leave out the newest samples whose surprise (ny,) is greater, until `review` finds otherwise."""
        self.faith_newest[np.abs(np.nan_to_num(surprise)) > gate] = DOUBTED

    def review(self, run: int, gate: float) -> bool:
        """Whether samples are to be judged otherwise now.

        A doubted one that agrees with the trajectory is ordinary; as many as `run` in a row of an output, all beyond the gate on one side
        and none ALIKE times as far as their median, are no errors but what happened, and trusted.
        """
        seen = self._seen
        e, last = (seen[1], seen[2]) if seen is not None and seen[0] is self.here else self._errors(self.here, self.here.p)[:2]
        ny, changed = len(self.corner), False
        z = np.column_stack([e[len(e) - ny :], last])
        if not (self.faith.any() or self.faith_newest.any() or (np.abs(z) > self.corner[:, None]).any()):
            return False
        scale = np.column_stack([self.d, np.zeros(len(self.d))])[len(self.d) - ny :]
        scale[:, -1] = self.newest[len(self.newest) - ny :]
        faith = np.column_stack([self.faith, self.faith_newest])
        for i in np.flatnonzero((np.abs(z) > self.corner[:, None]).any(axis=1) | (faith == DOUBTED).any(axis=1)):
            agreeing = (faith[i] == DOUBTED) & (np.abs(z[i]) <= self.corner[i])
            faith[i, agreeing] = ORDINARY
            latest = np.flatnonzero(scale[i] > 0)[-run:]
            gross = z[i, latest]
            far, one_side = np.abs(gross), np.all(gross > 0) or np.all(gross < 0)
            if len(latest) == run and one_side and far.min() > max(gate, self.corner[i]) and far.max() < ALIKE * np.median(far):
                changed |= bool((faith[i, latest] != TRUSTED).any())
                faith[i, latest] = TRUSTED
            changed |= bool(agreeing.any())
        rejudged = np.flatnonzero((faith[:, :-1] != self.faith).any(axis=0))
        if len(rejudged):
            self.reopen(int(rejudged[0]))
        self.faith, self.faith_newest = faith[:, :-1], faith[:, -1].copy()
        return changed

    # ---- reading

    def covariance(self) -> Array:
        """Of the newest state and p, (n, n); inf on the diagonal where nothing is known."""
        half, unknown = self.spread()
        C = half @ half.T
        C[unknown, :] = C[:, unknown] = 0.0
        C[unknown, unknown] = np.inf
        return np.asarray(C)

    def spread(self) -> tuple[Array, NDArray[np.bool_]]:
        """Root L of the covariance L L' of the newest state and p, (n, ..), and of which of them nothing is known, (n,)."""
        if self._root is None or self._root[0] is not self.told:
            self._root = self.told, root(self.told.Rd[:, :-1])
        return self._root[1]

    def surprise(self) -> Array:
        """The newest sample less its prediction over the deviation of that, (ny,), NaN where nothing is told; after `look_ahead`."""
        e, J = self._last(self.here.x[:, -1], self.here.p, self.newest)
        half, unknown = root(self.ahead.about(np.concatenate([self.here.x[:, -1], self.here.p]))[:, :-1])
        z = -e[:, 0] / np.sqrt(1.0 + np.sum((J @ half) ** 2, axis=1))
        z[(np.abs(J[:, unknown]) > 0).any(axis=1) | (self.newest[-len(z) :] == 0)] = np.nan
        return np.asarray(z)

    def forces(self) -> tuple[Array, Array]:
        """Mean residual forces of the soft places over the newest stage, and their standard deviations, (n_soft,); inf if nobody knows."""
        stage, at, ns = self.stage, self.here, len(self.stage.soft)
        y, d, n, nx = at.stages[:, -1], self.d[:, -1], self.stage.size, at.x.shape[0]
        d = self._weighed(d, self._lessened(self._residual(y, at.p, d)[0], self.faith[:, -1:])[:, 0])
        _, E, G = self._spread(self.before.about(np.concatenate([at.x[:, -2], at.p])), y, at.p, d)
        e, J = self._rows(y, at.p, d)[:2]
        half, unknown = self.spread()
        own = nx + len(at.inner)
        rest = J[:ns, own:] - J[:ns, :own] @ E[:, :n]
        scale = np.sqrt(d[0]) * d[len(d) - ns - stage.dae.output.shape[0] : len(d) - stage.dae.output.shape[0]]
        std = np.sqrt(np.sum((J[:ns, :own] @ G) ** 2, axis=1) + np.sum((rest @ half) ** 2, axis=1)) / scale
        lost = (np.abs(rest[:, unknown]) > 0).any(axis=1) | ~np.isfinite(std)
        return e[:ns, 0] / scale, np.where(lost, np.inf, std)
