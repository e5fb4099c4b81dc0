"""What both transcriptions build their terms from: the model's expressions as functions of a point of the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching, shortest_path

from backsight.models import Dae

from .horizon import Horizon
from .interpolation import Interpolation
from .polynomials import Array


@dataclass(frozen=True, kw_only=True)
class AtOnce:
    """Outputs at a sample, and the symbols that they take beside the model's: `rest` (nu or 0) of the input, `coefficients` (K outputs or
    0), and `moments` (q K or 0) of `force` (q) in the interval. ahead: outputs that see the force of the interval after their sample, in
    the order of their coefficients."""

    output: Any
    rest: Any
    coefficients: Any
    moments: Any
    force: Any
    ahead: tuple[int, ...] = ()


def direct(dae: Dae, soft: Sequence[int]) -> tuple[Any, Any]:
    """E (ny, nu) and D (ny, n_soft): what the input and the residual forces of these places do to the outputs at once."""
    unknown, nu = ca.vertcat(dae.dx, dae.z), dae.u.shape[0]
    if not ca.jacobian_sparsity(dae.output, ca.vertcat(unknown, dae.w)).nnz():
        return ca.SX(dae.output.shape[0], nu), ca.SX(dae.output.shape[0], len(soft))
    right = ca.horzcat(ca.jacobian(dae.residual, dae.u), ca.jacobian(dae.residual, dae.w)[:, list(soft)])
    both: Any = -ca.jacobian(dae.output, unknown) @ ca.solve(ca.jacobian(dae.residual, unknown), right)
    both *= ca.DM((_read_of_rows(dae, unknown) @ _pattern(right) > 0).astype(float))
    both[:, nu:] += ca.jacobian(dae.output, dae.w)[:, list(soft)]
    E, D = ca.horzsplit(ca.sparsify(ca.simplify(dae.undisturbed(both))), [0, nu, both.shape[1]])
    return E, D


def _pattern(expression: Any) -> NDArray[np.int64]:
    """One where an expression of symbols may be other than zero."""
    return np.asarray(ca.DM(expression.sparsity(), 1).full(), dtype=np.int64)


def _read_of_rows(dae: Dae, unknown: Any) -> NDArray[np.int64]:
    """Which rows of the residual every output hangs on by way of x' and z, (ny, rows): what closes a chain is no force's to move.

    By the structure alone: a row is the equation of the unknown that it is matched with, and that of every other one which reads it.
    """
    J = _pattern(ca.jacobian(dae.residual, unknown))
    row_of = maximum_bipartite_matching(csr_array(J), perm_type="row")  # of every unknown
    reads = csr_array(J[row_of])
    near = np.isfinite(shortest_path(reads, unweighted=True)).astype(np.int64)  # (unknown, what it hangs on)
    found = np.zeros((dae.output.shape[0], J.shape[0]), dtype=np.int64)
    found[:, row_of] = _pattern(ca.jacobian(dae.output, unknown)) @ near
    return found


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
        moving, M = self.inertia
        if not moving:
            return F
        # an inertia that drifts is a state; what it is measured by is its entry in p, which stands for nothing else
        names = [p.name for p in dae.parameters]
        drifting = [(i, names.index(q.name)) for i, q in enumerate(dae.states) if q.name in names]
        now = ca.vertcat(dae.p, *(dae.x[i] for i, _ in drifting))
        scaled = ca.SX(F)
        scaled[moving] = ca.substitute(M, now, ca.vertcat(self.p_ref, *(self.p_ref[k] for _, k in drifting))) @ ca.solve(M, F[moving])
        return scaled

    @cached_property
    def inertia(self) -> tuple[list[int], Any]:
        """The soft rows with accelerations in them, and M: how these enter there. Neither where they are not as many.

        A coloured force enters its balance as a state: the accelerations stand there, not in the row that shapes it.
        """
        dae = self.dae
        inertial = dae.residual[dae.balances_of(self.soft)]
        positions = {i for i, _, _ in dae.kinematics}
        pattern = ca.jacobian_sparsity(inertial, dae.dx)
        entries = [(r, i) for r, i in zip(pattern.row(), pattern.get_col(), strict=True) if i not in positions]
        moving, fastest = sorted({r for r, _ in entries}), sorted({i for _, i in entries})
        M = ca.jacobian(inertial[moving], ca.vertcat(*(dae.dx[i] for i in fastest))) if fastest else ca.SX(0, 0)
        if not moving or M.shape[1] != len(moving) or ca.sprank(M) < len(moving):
            return [], ca.SX(0, 0)
        return moving, M

    @cached_property
    def p_ref(self) -> Any:
        """The parameters at which a solve starts: the program's own, before the free ones are put in."""
        return ca.SX.sym("p_ref", self.dae.p.shape[0])

    @cached_property
    def direct(self) -> tuple[Any, Any]:
        """E (ny, nu) and D (ny, n_soft) of the soft places."""
        return direct(self.dae, self.soft)

    def outputs_at_samples(self, degree: int) -> AtOnce:
        """The outputs as the sensors read them.

        An output that looks at x' or z sees input and residual forces at once. The polynomials have the input's projection only, and of a
        white force the value at a point, whose variance is that of the mesh. With F(x', x, z, u) = w

            y = h + E du - D (w - w_mean),      [E, D] = -dh/d(x', z) (dF/d(x', z))^-1 [dF/du, -1]  (D also dh/dw)

        du: what the projection leaves of the input; w_mean = sum_j c_j m_j: the force as its moments m_j in the interval have it over the
        sampling interval of the output, which is what such a sensor averages over. So a reading and the motion share their force on a
        mesh with knots at the samples; on a finer one the force of the first part stands for the whole, and the reading tells less.
        """
        dae, nothing = self.dae, ca.SX(0, 1)
        du, (E, D) = ca.SX.sym("du", dae.u.shape[0]), self.direct
        places, output = sorted(set(D.sparsity().get_col())), dae.output + E @ du
        if not places:
            return AtOnce(output=output, rest=du if E.nnz() else nothing, coefficients=nothing, moments=nothing, force=nothing)
        force = self.forces()[places]
        ahead = tuple(sorted(set(D.sparsity().row())))
        c, m = ca.SX.sym("c", degree, len(ahead)), ca.SX.sym("m", len(places), degree)
        here = ca.substitute(force, dae.u, dae.u - du) if dae.u.shape[0] else force
        for k, i in enumerate(ahead):
            output[i] -= D[i, places] @ (here - m @ c[:, k])
        return AtOnce(output=output, rest=du, coefficients=ca.vec(c), moments=ca.vec(m), force=force, ahead=ahead)

    def forces(self) -> Any:
        """The residual forces of the soft places: what the balances leave over, or unknowns of their own."""
        soft = list(self.soft)
        return self.dae.w[soft] if self.interpolation.forces else self.dae.undisturbed(self.dae.residual[self.rows_of(soft)])

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
