"""Many windows of a recording predicted at once: the model under its inputs, without residual forces, from many starts side by side.

Radau IIA with three stages (order 5, L-stable; Hairer and Wanner, Solving ODEs II, IV.5) from row to row,

    0 = F(k_i, x + h sum_j a_ij k_j, z_i, u(t + c_i h), p, w = 0, t + c_i h)         i = 1 .. 3,     x(t + h) = x + h sum_j b_j k_j

all windows in one batch; those in which the step is too coarse, as where a friction changes its sign, take it in halves. No event is
located: signs stay rounded, so narrowly that what creeps at rest does not matter, and the halving resolves them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.models import Dae
from backsight.models.simulation.radau import tableau

from ..recordings.drive import acting, drive_of
from ..recordings.recording import Recording

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = NDArray[np.int64]

STAGES = 3
TOLERANCE = 1e-5  # error of a step over the size of the state
SETTLED = 1e-2  # of the tolerance: the last Newton correction
NEWTON, HALVINGS = 25, 8
DEEPEST = 12  # halvings of a row's step


@dataclass(frozen=True, kw_only=True)
class Starts:
    """M starts in one piece of a recording.

    rows (M,): of the piece. x (nx, M), and guesses of x' (nx, M) and z (nz, M) there; parameters (np, M).
    """

    rows: Index
    x: Array
    rates: Array
    z: Array
    parameters: Array


def ahead(dae: Dae, piece: Recording, starts: Starts, rows: int, size: Array) -> Array:
    """Outputs (ny, M, 1 + rows) at the row of every start and the next ones; NaN beyond the piece and where no solution was found.

    size (nx,): of the states, to which the tolerance is relative.
    """
    grid = _Grid.of(piece, [q.name for q in dae.inputs])
    step, last = _Step(dae, size), len(piece.time) - 1
    x, k, z = starts.x.copy(), starts.rates.copy(), starts.z.copy()
    taken = [(x.copy(), k.copy(), z.copy())]
    for ahead_by in range(rows):
        now = np.flatnonzero((starts.rows + ahead_by < last) & np.isfinite(x).all(axis=0))
        gone = np.setdiff1d(np.arange(x.shape[1]), now)
        x[:, gone] = np.nan
        at, until = grid.cells[starts.rows[now] + ahead_by], grid.cells[np.minimum(starts.rows[now] + ahead_by + 1, last)]
        while len(now):
            p = starts.parameters[:, now]
            x[:, now], k[:, now], z[:, now] = step.over(x[:, now], k[:, now], z[:, now], grid.cell(at), p)
            at = at + 1
            more = (at < until) & np.isfinite(x[:, now]).all(axis=0)
            now, at, until = now[more], at[more], until[more]
        taken.append((x.copy(), k.copy(), z.copy()))
    return _outputs(dae, step, grid, starts, taken, last)


def _outputs(dae: Dae, step: _Step, grid: _Grid, starts: Starts, taken: list[tuple[Array, Array, Array]], last: int) -> Array:
    """The outputs of all windows at all their rows, with the rates that the inputs of that row make: accelerometers notice them."""
    count = len(taken)
    X, K, Z = (np.concatenate([part[i] for part in taken], axis=1) for i in range(3))
    rows = np.concatenate([np.minimum(starts.rows + n, last) for n in range(count)])
    p = np.tile(starts.parameters, count)
    there = np.flatnonzero(np.isfinite(X).all(axis=0))
    y = np.full((dae.output.shape[0], X.shape[1]), np.nan)
    u, t = grid.inputs[:, grid.cells[rows[there]]], piece_time(grid, rows[there])
    k, z = step.at(X[:, there], K[:, there], Z[:, there], u, p[:, there], t)
    function = ca.Function("outputs", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], [ca.densify(dae.undisturbed(dae.output))])
    y[:, there] = _Mapped(function)(k, X[:, there], z, u, p[:, there], t[None, :])[0]
    return np.asarray(y.reshape(len(y), count, -1).swapaxes(1, 2), dtype=np.float64)


def piece_time(grid: _Grid, rows: Index) -> Array:
    """Times of some rows [s]."""
    return np.asarray(grid.time[grid.cells[rows]], dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class _Cell:
    """Steps of M windows: t and h (M,), inputs at both ends (nu, M)."""

    t: Array
    h: Array
    first: Array
    second: Array

    def half(self, which: int) -> _Cell:
        """The first or the second half."""
        middle = (self.first + self.second) / 2
        ends = (self.first, middle) if which == 0 else (middle, self.second)
        return _Cell(t=self.t + which * self.h / 2, h=self.h / 2, first=ends[0], second=ends[1])

    def some(self, of: Index) -> _Cell:
        """Of some of the windows."""
        return _Cell(t=self.t[of], h=self.h[of], first=self.first[:, of], second=self.second[:, of])


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """Where inputs change and samples are taken: time (n,), inputs (nu, n); cells: of every row of the piece, its number here."""

    time: Array
    inputs: Array
    cells: Index
    linear: bool

    @classmethod
    def of(cls, piece: Recording, names: list[str]) -> _Grid:
        """Of a piece; a drive with a clock of its own adds its times."""
        drive = drive_of(piece)
        inside = drive.time[(drive.time > piece.time[0]) & (drive.time < piece.time[-1])]
        time = piece.time if piece.drive is None else np.union1d(piece.time, inside)
        inputs = acting(drive, time, piece.hold)
        cells = np.searchsorted(time, piece.time).astype(np.int64)
        values = np.array([inputs[name] for name in names]).reshape(len(names), len(time))
        return cls(time=time, inputs=values, cells=cells, linear=piece.hold == "linear")

    def cell(self, at: Index) -> _Cell:
        """The steps from these times to the next ones."""
        first, second = self.inputs[:, at], self.inputs[:, at + 1] if self.linear else self.inputs[:, at]
        return _Cell(t=self.time[at], h=self.time[at + 1] - self.time[at], first=first, second=second)


@dataclass
class _Mapped:
    """A function of one column each, called for many at once; numbers of columns are rounded up, so that few programs are made."""

    function: ca.Function
    made: dict[int, ca.Function] = field(default_factory=dict)

    def __call__(self, *arguments: Array) -> list[Array]:
        wanted = arguments[0].shape[1]
        count = 1 << max(0, int(np.ceil(np.log2(max(wanted, 1)))))
        if count not in self.made:
            self.made[count] = self.function.map(count)
        padded = [np.concatenate([a, np.repeat(a[:, :1], count - wanted, axis=1)], axis=1) if wanted else a for a in arguments]
        function = self.made[count]
        given = [np.ascontiguousarray(a.T, dtype=np.float64).ravel() for a in padded]
        out = [np.empty(function.size1_out(i) * function.size2_out(i)) for i in range(function.n_out())]
        called: Any = function.buffer()
        buffer, evaluate = called
        for i, a in enumerate(given):
            if a.size:
                buffer.set_arg(i, a.data)
        for i, a in enumerate(out):
            if a.size:
                buffer.set_res(i, a.data)
        evaluate()
        return [a.reshape(count, function.size1_out(i)).T[:, :wanted] for i, a in enumerate(out)]


class _Step:
    """One step of all windows."""

    def __init__(self, dae: Dae, size: Array) -> None:
        self.nx, self.nz, self.size = dae.x.shape[0], dae.z.shape[0], size
        self.c, self.a, _ = tableau(STAGES)
        nodes = self.c[:-1]  # an embedded rule of the stages before the last, of order 2: cautious, and it needs no rate at the start
        self.low = np.linalg.solve((nodes[:, None] ** np.arange(STAGES - 1)).T, 1.0 / np.arange(1, STAGES))
        symbols = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
        F = dae.undisturbed(dae.residual)
        parts = [ca.jacobian(F, dae.dx), ca.jacobian(F, dae.x), ca.jacobian(F, dae.z)]
        self.residual = _Mapped(ca.Function("F", symbols, [ca.densify(F)]))
        self.slopes = _Mapped(ca.Function("dF", symbols, [ca.densify(ca.vec(part)) for part in parts]))

    def over(self, x: Array, k: Array, z: Array, cell: _Cell, p: Array, depth: int = 0) -> tuple[Array, Array, Array]:
        """States at the end of the cell with their rates and algebraics; NaN where no solution was found."""
        K, Z, solved = self._stages(x, k, z, cell, p)
        b = self.a[-1]
        end = x + cell.h * np.tensordot(b, K, axes=1)
        error = np.abs(cell.h * (np.tensordot(b, K, axes=1) - np.tensordot(self.low, K[:-1], axes=1))) / self.size[:, None]
        good = solved & (error.max(axis=0, initial=0.0) < TOLERANCE)
        rate, algebraics = K[-1], Z[-1]
        bad = np.flatnonzero(~good)
        if len(bad) and depth < DEEPEST:
            part = x[:, bad], k[:, bad], z[:, bad]
            for which in (0, 1):
                part = self.over(*part, cell.some(bad).half(which), p[:, bad], depth + 1)
            end[:, bad], rate[:, bad], algebraics[:, bad] = part
        else:
            end[:, ~solved] = np.nan
        return end, rate, algebraics

    def at(self, x: Array, k: Array, z: Array, u: Array, p: Array, t: Array) -> tuple[Array, Array]:
        """Rates and algebraics that belong to states and inputs, from guesses."""
        cell = _Cell(t=t, h=np.zeros(len(t)), first=u, second=u)
        K, Z, _ = self._newton(x, k[None], z[None], cell, p, np.zeros(1), np.zeros((1, 1)))
        return K[0], Z[0]

    def _stages(self, x: Array, k: Array, z: Array, cell: _Cell, p: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        return self._newton(x, np.stack([k] * STAGES), np.stack([z] * STAGES), cell, p, self.c, self.a)

    def _newton(self, x: Array, K: Array, Z: Array, cell: _Cell, p: Array, c: Array, a: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Stage rates (s, nx, M) and algebraics (s, nz, M); steps are halved while the next correction would grow (natural monotonicity).

        Deuflhard, Newton Methods for Nonlinear Problems, section 3.3. Corrections are measured by what they move the states.
        """
        s, M, nx = len(c), x.shape[1], self.nx
        n = nx + self.nz
        u = np.stack([cell.first + ci * (cell.second - cell.first) for ci in c])
        t = np.stack([(cell.t + ci * cell.h)[None] for ci in c])
        unit = np.where(cell.h > 0, cell.h, 1.0) / self.size[:, None]

        def flat(stages: Array) -> Array:
            return np.asarray(stages.swapaxes(0, 1).reshape(stages.shape[1], stages.shape[0] * stages.shape[2]))

        P, solved, U = np.tile(p, s), np.zeros(M, dtype=bool), np.concatenate([K, Z], axis=1)
        todo = np.arange(M)

        def arguments(V: Array, of: Index) -> list[Array]:
            X = x[:, of] + cell.h[of] * np.tensordot(a, V[:, :nx], axes=1)
            many = P.reshape(len(p), s, M)[:, :, of].reshape(len(p), -1)
            return [flat(V[:, :nx]), flat(X), flat(V[:, nx:]), flat(u[:, :, of]), many, flat(t[:, :, of])]

        def rest(V: Array, of: Index) -> Array:
            rows = self.residual(*arguments(V, of))[0].reshape(n, s, len(of))
            return np.asarray(rows.transpose(2, 1, 0).reshape(len(of), s * n))

        for _ in range(NEWTON):
            if not len(todo):
                break
            V = U[:, :, todo]
            parts = zip(self.slopes(*arguments(V, todo)), (nx, nx, self.nz), strict=True)
            dk, dx, dz = (m.reshape(width, n, s, len(todo)).transpose(3, 2, 1, 0) for m, width in parts)
            J = np.zeros((len(todo), s, n, s, n))
            for i in range(s):
                for j in range(s):
                    J[:, i, :, j, :nx] = (cell.h[todo] * a[i, j])[:, None, None] * dx[:, i]
                J[:, i, :, i, :nx] += dk[:, i]
                J[:, i, :, i, nx:] = dz[:, i]
            J = J.reshape(len(todo), s * n, s * n)
            r = rest(V, todo)
            fine = np.asarray(np.isfinite(J).all(axis=(1, 2)) & np.isfinite(r).all(axis=1), dtype=bool)
            inverse = np.zeros_like(J)
            with np.errstate(all="ignore"):
                try:
                    inverse[fine] = np.linalg.inv(J[fine])
                except np.linalg.LinAlgError:
                    fine &= np.abs(np.linalg.det(np.where(fine[:, None, None], J, np.eye(s * n)))) > 0
                    inverse[fine] = np.linalg.inv(J[fine])

            def correction(rows: Array, inverse: Array = inverse, count: int = len(todo)) -> Array:
                return np.asarray(-np.einsum("mij,mj->mi", inverse, rows).reshape(count, s, n).transpose(1, 2, 0))

            def length(d: Array, of: Index = todo) -> Array:
                return np.asarray(np.abs(d[:, :nx] * unit[:, of]).max(axis=(0, 1), initial=0.0))

            d = correction(r)
            before, factor = length(d), np.ones(len(todo))
            for _ in range(HALVINGS):
                trial = V + factor * d
                second = correction(rest(trial, todo))
                after = length(second)
                worse = fine & (after > np.maximum((1.0 - factor / 4.0) * before, SETTLED * TOLERANCE))
                if not worse.any():
                    break
                factor[worse] /= 2.0
            left = after * np.minimum(after / np.maximum(before, 1e-300), 1.0)  # once that correction is made too: it contracts
            done = fine & (left < SETTLED * TOLERANCE) & (factor == 1.0)
            U[:, :, todo] = V + factor * d + np.where(done, second, 0.0)
            solved[todo[done]] = True
            todo = todo[fine & ~done]
        return U[:, :nx], U[:, nx:], solved
