"""Many windows of a recording predicted at once: the model under its inputs, without residual forces, from many starts side by side.

All windows go from row to row in one batch (`steps.py`). No event is located: signs of friction stay rounded, so narrowly that what creeps
at rest does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.models import Dae
from backsight.ocp.columnwise import Columnwise

from ...recordings.drive import acting, drive_of
from ...recordings.recording import Recording
from .steps import Cell, Step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = NDArray[np.int64]


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
    step, last = Step(dae, size, len(starts.rows)), len(piece.time) - 1
    x, k, z = starts.x.copy(), starts.rates.copy(), starts.z.copy()
    taken = [(x.copy(), k.copy(), z.copy())]
    for ahead_by in range(rows):
        now = np.flatnonzero((starts.rows + ahead_by < last) & np.isfinite(x).all(axis=0))
        gone = np.setdiff1d(np.arange(x.shape[1]), now)
        x[:, gone] = np.nan
        at, until = grid.cells[starts.rows[now] + ahead_by], grid.cells[np.minimum(starts.rows[now] + ahead_by + 1, last)]
        while len(now):
            p = starts.parameters[:, now]
            x[:, now], k[:, now], z[:, now] = step.over(x[:, now], k[:, now], z[:, now], grid.cell(at), p, now)
            at = at + 1
            more = (at < until) & np.isfinite(x[:, now]).all(axis=0)
            now, at, until = now[more], at[more], until[more]
        taken.append((x.copy(), k.copy(), z.copy()))
    return _outputs(dae, step, grid, starts, taken, last)


def _outputs(dae: Dae, step: Step, grid: _Grid, starts: Starts, taken: list[tuple[Array, Array, Array]], last: int) -> Array:
    """The outputs of all windows at all their rows, with the rates that the inputs of that row make: accelerometers notice them."""
    count = len(taken)
    X, K, Z = (np.concatenate([part[i] for part in taken], axis=1) for i in range(3))
    rows = np.concatenate([np.minimum(starts.rows + n, last) for n in range(count)])
    p = np.tile(starts.parameters, count)
    there = np.flatnonzero(np.isfinite(X).all(axis=0))
    y = np.full((dae.output.shape[0], X.shape[1]), np.nan)
    u, t = grid.inputs[:, grid.cells[rows[there]]], _times(grid, rows[there])
    k, z = step.at(X[:, there], K[:, there], Z[:, there], u, p[:, there], t)
    function = ca.Function("outputs", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], [ca.densify(dae.undisturbed(dae.output))])
    y[:, there] = Columnwise(function)(k, X[:, there], z, u, p[:, there], t[None, :])[0]
    return np.asarray(y.reshape(len(y), count, -1).swapaxes(1, 2), dtype=np.float64)


def _times(grid: _Grid, rows: Index) -> Array:
    """Times of some rows [s]."""
    return np.asarray(grid.time[grid.cells[rows]], dtype=np.float64)


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

    def cell(self, at: Index) -> Cell:
        """The steps from these times to the next ones."""
        first, second = self.inputs[:, at], self.inputs[:, at + 1] if self.linear else self.inputs[:, at]
        return Cell(t=self.time[at], h=self.time[at + 1] - self.time[at], first=first, second=second)
