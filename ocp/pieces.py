"""What both transcriptions build their terms from: the model's expressions as functions of a point of the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.models import Dae

from .horizon import Horizon
from .interpolation import Interpolation
from .polynomials import Array


@dataclass(frozen=True)
class Pieces:
    """A DAE, the interpolation of its variables, and the horizons with the number of their first intervals."""

    dae: Dae
    interpolation: Interpolation
    horizons: Sequence[Horizon]
    offsets: tuple[int, ...]
    soft: tuple[int, ...]

    def balances(self) -> Any:
        """The soft rows without their residual forces, M(p_ref) M(p)^-1 F: what a function over (dx, x, z, u, p, t, p_ref) needs.

        F = M dx' - forces is an implicit equation of the accelerations: read as a density of trajectories it carries det M(p), without
        which inertias come out too small, by about (rms residual force / rms inertial force)^2. In this form the determinant is that of
        M(p_ref), whatever p, and at p_ref = p, where a solve ends, the rows are F itself.
        """
        dae, rows = self.dae, self.rows_of(self.soft)
        F = dae.undisturbed(dae.residual[rows])
        # a coloured force enters its balance as a state: the accelerations stand there, not in the row that shapes it
        shaped = {e.shaped: row for row, e in enumerate(dae.equations) if e.shaped is not None}
        inertial = dae.residual[[shaped.get(k, row) for k, row in zip(self.soft, rows, strict=True)]]
        positions = {i for i, _, _ in dae.kinematics}
        pattern = ca.jacobian_sparsity(inertial, dae.dx)
        entries = [(r, i) for r, i in zip(pattern.row(), pattern.get_col(), strict=True) if i not in positions]
        moving, fastest = sorted({r for r, _ in entries}), sorted({i for _, i in entries})
        M = ca.jacobian(inertial[moving], ca.vertcat(*(dae.dx[i] for i in fastest))) if fastest else ca.SX(0, 0)
        if not moving or M.shape[1] != len(moving) or ca.sprank(M) < len(moving):
            return F
        # an inertia that drifts is a state; what it is measured by is its entry in p, which stands for nothing else
        names = [p.name for p in dae.parameters]
        drifting = [(i, names.index(q.name)) for i, q in enumerate(dae.states) if q.name in names]
        now = ca.vertcat(dae.p, *(dae.x[i] for i, _ in drifting))
        scaled = ca.SX(F)
        scaled[moving] = ca.substitute(M, now, ca.vertcat(self.p_ref, *(self.p_ref[k] for _, k in drifting))) @ ca.solve(M, F[moving])
        return scaled

    @cached_property
    def p_ref(self) -> Any:
        """The parameters at which a solve starts: the program's own, before the free ones are put in."""
        return ca.SX.sym("p_ref", self.dae.p.shape[0])

    def outputs_at_samples(self) -> tuple[Any, Any]:
        """The outputs, and the symbols (nu or 0) of what is left of the held input at a sample by its projection on the interval.

        An output that looks at x' or z sees the whole input at once, where the polynomials have its projection only. With
        F(x', x, z, u) = 0 it differs by E du,  E = -dh/d(x', z) (dF/d(x', z))^-1 dF/du, in which the parameters stay what they are.
        """
        dae = self.dae
        unknown = ca.vertcat(dae.dx, dae.z)
        at_once, forced = ca.jacobian(dae.output, unknown), ca.jacobian(dae.residual, dae.u)
        if not (at_once.nnz() and forced.nnz()):
            return dae.output, ca.SX(0, 1)
        E: Any = -at_once @ ca.solve(ca.jacobian(dae.residual, unknown), forced)
        E = ca.sparsify(ca.simplify(dae.undisturbed(E)))
        du = ca.SX.sym("du", dae.u.shape[0])
        return (dae.output + E @ du, du) if E.nnz() else (dae.output, ca.SX(0, 1))

    def read_at_once(self) -> NDArray[np.bool_]:
        """Which residual forces an output that is sampled sees at once, by dh/d(x', z) (dF/d(x', z))^-1 dF/dw; (n_soft,)."""
        dae = self.dae
        unknown = ca.vertcat(dae.dx, dae.z)
        sampled = [i for i in range(dae.output.shape[0]) if any(np.isfinite(h.target[:, i]).any() for h in self.horizons)]
        at_once = ca.jacobian(dae.output[sampled], unknown)
        if not (at_once.nnz() and self.soft):
            return np.zeros(len(self.soft), dtype=np.bool_)
        D = ca.sparsify(ca.simplify(at_once @ ca.solve(ca.jacobian(dae.residual, unknown), ca.jacobian(dae.residual, dae.w))))
        return np.isin(self.soft, D.sparsity().get_col())

    def function(self, name: str, expression: Any, more: Any = None) -> Any:
        """`expression` of the model as a function (v = [dx; x; z; w_soft], p, p_ref, d = [u; t]); other residual forces are zero.

        more: symbols that the expression also takes, from further rows of d.
        """
        dae, more = self.dae, ca.SX(0, 1) if more is None else more
        w = ca.SX.sym("w", self.interpolation.forces)
        forces = ca.SX.zeros(dae.w.shape[0])
        for k, place in enumerate(self.soft[: self.interpolation.forces]):
            forces[place] = w[k]
        nu = dae.u.shape[0]
        v, d = ca.SX.sym("v", self.interpolation.rows), ca.SX.sym("d", nu + 1 + more.shape[0])
        nx, nz = self.interpolation.states, self.interpolation.algebraics
        dx, x, z, w_v = ca.vertsplit(v, [0, nx, 2 * nx, 2 * nx + nz, self.interpolation.rows])
        inner = ca.Function("model", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t, self.p_ref, more], [expression])
        forces = ca.substitute(forces, w, w_v) if self.interpolation.forces else forces
        p, p_ref = ca.SX.sym("p", dae.p.shape[0]), ca.SX.sym("p_ref", dae.p.shape[0])
        phi = ca.densify(inner(dx, x, z, d[:nu], p, forces, d[nu], p_ref, d[nu + 1 :]))
        return ca.Function(name, [v, p, p_ref, d], [phi], ["v", "p", "p_ref", "d"], ["phi"])

    def intervals(self, of_horizons: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
        """Interval numbers over all horizons from numbers within each."""
        return np.concatenate([i + offset for i, offset in zip(of_horizons, self.offsets, strict=False)])

    def steps(self) -> Array:
        """Interval lengths over all horizons."""
        return np.concatenate([h.mesh.steps for h in self.horizons])

    def rows_of(self, places: Sequence[int]) -> list[int]:
        """Rows of the residual that carry the residual forces of these places, in their order."""
        return self.dae.rows_of(places)
