"""Steps of the model for many windows at once, by Radau IIA of three stages (order 5, L-stable; Hairer, Wanner, Solving ODEs II, IV.5).

    0 = F(k_i, x + h sum_j a_ij k_j, z_i, u(t + c_i h), p, w = 0, t + c_i h)         i = 1 .. 3,     x(t + h) = x + h sum_j a_3j k_j

Windows in which a step is too coarse, as where a friction changes its sign, take it in halves, the others do not wait.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.models import Dae
from backsight.models.simulation.radau import tableau
from backsight.ocp.columnwise import Columnwise

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = NDArray[np.int64]

STAGES = 3
TOLERANCE = 1e-4  # error over the size of the state of a rule of order 2 in the step: what moves smoothly is off by a thousandth of that
ROUNDED = 1e-5  # the same of a model with rounded signs: where one changes the step is no better than that
GROSS = 1e-2  # error of the shortest step over the size of the state: a corner costs less, and what moves so has no end
SETTLED = 1e-2  # of the tolerance: the last Newton correction
NEWTON, HALVINGS = 25, 8
DEEPEST = 12  # halvings of a row's step
MOST = 5000  # steps of a window beside those from row to row: one that swings so fast that it needs more ends where they do


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Steps of M windows: t and h (M,), inputs at both ends (nu, M)."""

    t: Array
    h: Array
    first: Array
    second: Array

    def half(self, which: int) -> Cell:
        """The first or the second half."""
        middle = (self.first + self.second) / 2
        ends = (self.first, middle) if which == 0 else (middle, self.second)
        return Cell(t=self.t + which * self.h / 2, h=self.h / 2, first=ends[0], second=ends[1])

    def some(self, of: Index) -> Cell:
        """Of some of the windows."""
        return Cell(t=self.t[of], h=self.h[of], first=self.first[:, of], second=self.second[:, of])


class Step:
    """One step of all windows; size (nx,): of the states, to which errors are relative; windows: how many there are."""

    def __init__(self, dae: Dae, size: Array, windows: int) -> None:
        self.nx, self.nz, self.size, self.left = dae.x.shape[0], dae.z.shape[0], size, np.full(windows, MOST)
        self.tolerance = ROUNDED if any(p.smoothing for p in dae.parameters) else TOLERANCE
        self.c, self.a, _ = tableau(STAGES)
        nodes = self.c[:-1]  # an embedded rule of the stages before the last, of order 2: cautious, and it needs no rate at the start
        self.low = np.linalg.solve((nodes[:, None] ** np.arange(STAGES - 1)).T, 1.0 / np.arange(1, STAGES))
        symbols = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
        F = dae.undisturbed(dae.residual)
        parts = [ca.jacobian(F, dae.dx), ca.jacobian(F, dae.x), ca.jacobian(F, dae.z)]
        self.residual = Columnwise(ca.Function("F", symbols, [ca.densify(F)]))
        self.slopes = Columnwise(ca.Function("dF", symbols, [ca.densify(ca.vec(part)) for part in parts]))

    def over(self, x: Array, k: Array, z: Array, cell: Cell, p: Array, windows: Index, depth: int = 0) -> tuple[Array, Array, Array]:
        """States at the end of the cell with their rates and algebraics; NaN where no solution was found, or none in so many steps.

        windows (M,): which ones they are.
        """
        self.left[windows] -= min(depth, 1)
        K, Z, solved = self._stages(x, k, z, cell, p)
        b = self.a[-1]
        end = x + cell.h * np.tensordot(b, K, axes=1)
        error = np.abs(cell.h * (np.tensordot(b, K, axes=1) - np.tensordot(self.low, K[:-1], axes=1))) / self.size[:, None]
        worst = error.max(axis=0, initial=0.0)
        good = solved & (worst < self.tolerance)
        rate, algebraics = K[-1], Z[-1]
        end[:, ~solved | ((depth == DEEPEST) & ~(worst < GROSS))] = np.nan
        end[:, ~good & (self.left[windows] < 0)] = np.nan
        bad = np.flatnonzero(~good & np.isfinite(x).all(axis=0) & (self.left[windows] >= 0))  # of what has no start no part has an end
        if len(bad) and depth < DEEPEST:
            part = x[:, bad], k[:, bad], z[:, bad]
            for which in (0, 1):
                part = self.over(*part, cell.some(bad).half(which), p[:, bad], windows[bad], depth + 1)
            end[:, bad], rate[:, bad], algebraics[:, bad] = part
        return end, rate, algebraics

    def at(self, x: Array, k: Array, z: Array, u: Array, p: Array, t: Array) -> tuple[Array, Array]:
        """Rates and algebraics that belong to states and inputs, from guesses."""
        cell = Cell(t=t, h=np.zeros(len(t)), first=u, second=u)
        K, Z, _ = self._newton(x, k[None], z[None], cell, p, np.zeros(1), np.zeros((1, 1)))
        return K[0], Z[0]

    def _stages(self, x: Array, k: Array, z: Array, cell: Cell, p: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        return self._newton(x, np.stack([k] * STAGES), np.stack([z] * STAGES), cell, p, self.c, self.a)

    def _newton(self, x: Array, K: Array, Z: Array, cell: Cell, p: Array, c: Array, a: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Stage rates (s, nx, M) and algebraics (s, nz, M); corrections are halved while the next one would grow (natural monotonicity).

        Deuflhard, Newton Methods for Nonlinear Problems, section 3.3. Corrections are measured by what they move the states.
        """
        system = _Stages(self, x, cell, p, c, a)
        solved, U, todo = np.zeros(x.shape[1], dtype=bool), np.concatenate([K, Z], axis=1), np.arange(x.shape[1])
        unit = np.where(cell.h > 0, cell.h, 1.0) / self.size[:, None]
        for _ in range(NEWTON):
            if not len(todo):
                break
            V, of = U[:, :, todo], todo
            inverse, usable = _inverses(system.slope(V, of))
            usable &= np.isfinite(rest := system.rest(V, of)).all(axis=1)

            def correction(rows: Array, inverse: Array = inverse) -> Array:
                stages = np.einsum("mij,mj->mi", inverse, rows).reshape(len(inverse), len(c), -1)
                return np.asarray(-stages.transpose(1, 2, 0))

            def length(d: Array, of: Index = of) -> Array:
                return np.asarray(np.abs(d[:, : self.nx] * unit[:, of]).max(axis=(0, 1), initial=0.0))

            d = correction(rest)
            before, factor = length(d), np.ones(len(of))
            for _ in range(HALVINGS):
                second = correction(system.rest(V + factor * d, of))
                after = length(second)
                worse = usable & (after > np.maximum((1.0 - factor / 4.0) * before, SETTLED * self.tolerance))
                if not worse.any():
                    break
                factor[worse] /= 2.0
            left = after * np.minimum(after / np.maximum(before, 1e-300), 1.0)  # once that correction is made too: it contracts
            done = usable & (left < SETTLED * self.tolerance) & (factor == 1.0)
            U[:, :, of] = V + factor * d + np.where(done, second, 0.0)
            solved[of[done]] = True
            todo = of[usable & ~done]
        return U[:, : self.nx], U[:, self.nx :], solved


class _Stages:
    """The equations of s stages of M windows in V = [k_i; z_i], (s, nx + nz, M)."""

    def __init__(self, step: Step, x: Array, cell: Cell, p: Array, c: Array, a: Array) -> None:
        self.step, self.x, self.h, self.p, self.a, self.s = step, x, cell.h, p, a, len(c)
        self.u = np.stack([cell.first + ci * (cell.second - cell.first) for ci in c])
        self.t = np.stack([(cell.t + ci * cell.h)[None] for ci in c])

    def rest(self, V: Array, of: Index) -> Array:
        """F of some windows, stage by stage, (m, s (nx + nz))."""
        (F,) = self.step.residual(*self._arguments(V, of))
        return np.asarray(F.reshape(-1, self.s, len(of)).transpose(2, 1, 0).reshape(len(of), -1))

    def slope(self, V: Array, of: Index) -> Array:
        """Its derivative in V, (m, s (nx + nz), s (nx + nz)): F_k + h a_ij F_x and F_z."""
        s, nx, nz = self.s, self.step.nx, self.step.nz
        n = nx + nz
        parts = zip(self.step.slopes(*self._arguments(V, of)), (nx, nx, nz), strict=True)
        F_k, F_x, F_z = (m.reshape(width, n, s, len(of)).transpose(3, 2, 1, 0) for m, width in parts)
        J = np.zeros((len(of), s, n, s, n))
        for i in range(s):
            for j in range(s):
                J[:, i, :, j, :nx] = (self.h[of] * self.a[i, j])[:, None, None] * F_x[:, i]
            J[:, i, :, i, :nx] += F_k[:, i]
            J[:, i, :, i, nx:] = F_z[:, i]
        return J.reshape(len(of), s * n, s * n)

    def _arguments(self, V: Array, of: Index) -> list[Array]:
        nx = self.step.nx
        X = self.x[:, of] + self.h[of] * np.tensordot(self.a, V[:, :nx], axes=1)
        parts = (V[:, :nx], X, V[:, nx:], self.u[:, :, of], np.stack([self.p[:, of]] * self.s), self.t[:, :, of])
        return [part.swapaxes(0, 1).reshape(part.shape[1], self.s * len(of)) for part in parts]


def _inverses(J: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Inverses of many matrices (m, n, n), and which of them have one."""
    usable = np.asarray(np.isfinite(J).all(axis=(1, 2)), dtype=bool)
    out = np.zeros_like(J)
    with np.errstate(all="ignore"):
        try:
            out[usable] = np.linalg.inv(J[usable])
        except np.linalg.LinAlgError:
            usable &= np.abs(np.linalg.det(np.where(usable[:, None, None], J, np.eye(J.shape[1])))) > 0
            out[usable] = np.linalg.inv(J[usable])
    return out, usable
