"""Positions of which only differences matter: where a machine stands as a whole, of which speeds and forces between its parts say nothing.

    F(x', x + s n, z, u, p + s m, w, t) = F(x', x, z, u, p, w, t),   the same of outputs and invariants, for every s

Such an n is a direction of shifts (a cyclic coordinate: H. Goldstein, Classical Mechanics, 3rd ed., section 8.2); what is estimated is the
same wherever the machine is put along it. With an m it takes parameters along, as the phase of a wave over the position. Derivatives vanish
along it wherever one looks, also far away: a stop that nothing touches here is touched there.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import casadi as ca
import numpy as np
import scipy.linalg

from .dae import Dae

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LOOKS = 8  # random points at which derivatives are taken
ZERO = 1e-10  # of all derivatives of an equation: of what is no shift that by the states is far larger
REACH = (-1.0, 5.0)  # decades of nominal sizes, how far along a shift is looked


class Gauges:
    """The shifts of a model.

    parameters (np,): their values, where one that is 0 is taken for what the model would be with it. along: indices of those that a shift
    may take along.
    """

    def __init__(self, dae: Dae, parameters: Array, along: Sequence[int] = ()) -> None:
        self.dae, self._rng = dae, np.random.default_rng(0)
        self._p = np.where(parameters == 0, self._rng.uniform(0.1, 1.0, len(parameters)), parameters)
        self._states, self._along = np.array([q.nominal for q in dae.states]), np.abs(self._p)[list(along)]
        there, arguments = ca.vertcat(dae.residual, dae.invariants, dae.output), [dae.x, dae.dx, dae.z, dae.u, dae.p, dae.w, dae.t]
        taken = ca.vertcat(dae.x, *(dae.p[i] for i in along))
        by = [ca.jacobian(there, v) for v in (taken, dae.dx, dae.z, dae.u)]
        self._derivatives = ca.Function("derivatives", arguments, by)
        self._depends = np.array(ca.DM(by[0].sparsity(), 1.0).full(), dtype=bool)
        self._looks = [self._look(np.zeros(len(dae.states))) for _ in range(LOOKS)]

    def open(self, outputs: Collection[str], kept: Collection[str] = ()) -> list[int]:
        """States of which one each, held at its start, says where the machine stands; none where its equations or outputs tell that.

        outputs: those that are read; kept: states of which something is known already.
        """
        fixed = np.eye(len(self._states) + len(self._along))[len(self._states) :]
        return _telling(self._shifts(outputs, kept, fixed)[: len(self._states)])

    def taken_along(self, outputs: Collection[str], kept: Collection[str] = ()) -> list[int]:
        """Of the parameters that a shift may take along those of which one each, held, leaves the machine to stand where it has to."""
        nx = len(self._states)
        kept = {*kept, *(self.dae.states[i].name for i in self.open(outputs, kept))}
        n = self._shifts(outputs, kept, np.empty((0, nx + len(self._along))))
        return _telling(n[nx:]) if np.linalg.matrix_rank(n[:nx]) == n.shape[1] else []

    def _shifts(self, outputs: Collection[str], kept: Collection[str], fixed: Array) -> Array:
        """Directions, in nominal sizes, along which nothing that is read changes at any look, (nx + along, number)."""
        n = self._null_space(outputs, kept, fixed)
        while n.shape[1]:
            for decade in np.linspace(*REACH, LOOKS):
                far = n[: len(self._states)] @ self._rng.standard_normal(n.shape[1])
                self._looks += [self._look(sign * 10.0**decade * far) for sign in (1.0, -1.0)]
            fewer = self._null_space(outputs, kept, fixed)
            if fewer.shape[1] == n.shape[1]:
                break
            n = fewer
        return n

    def _null_space(self, outputs: Collection[str], kept: Collection[str], fixed: Array) -> Array:
        first = len(self._depends) - len(self.dae.outputs)
        rows = [*range(first), *(first + i for i, q in enumerate(self.dae.outputs) if q.name in outputs)]
        seen, each = np.array(self._looks)[:, rows], np.eye(fixed.shape[1])
        finite = np.all(np.isfinite(seen), axis=2)
        held = [q.name in kept for q in self.dae.states] + [False] * len(self._along)
        told = np.any(self._depends[rows][~np.any(finite, axis=0)], axis=0)  # by what is a number nowhere
        return np.asarray(scipy.linalg.null_space(np.vstack([seen[finite], each[told | held], fixed]), rcond=ZERO), dtype=np.float64)

    def _look(self, shift: Array) -> Array:
        """Derivatives by states and parameters at a random point and a shift from there, over the norm of all of their equation's."""
        dae, rng = self.dae, self._rng
        x = np.array([q.start for q in dae.states]) + self._states * (shift + rng.standard_normal(len(shift)))
        dx = self._states * rng.standard_normal(len(shift))
        z, u, w = (rng.standard_normal(v.numel()) for v in (dae.z, dae.u, dae.w))
        found = self._derivatives(x, dx, z, u, self._p, w, rng.uniform())
        by, by_dx, *others = (np.asarray(ca.DM(part).full(), dtype=np.float64) for part in found)
        by, by_dx = by * np.concatenate([self._states, self._along]), by_dx * self._states
        length = np.linalg.norm(np.hstack([by, by_dx, *others]), axis=1, keepdims=True)
        return np.asarray(by / np.where(length > 0, length, 1.0), dtype=np.float64)


def _telling(n: Array) -> list[int]:
    """As many rows as there are directions, that tell how far along each one is."""
    if n.shape[1] == 0:
        return []
    _, _, order = scipy.linalg.qr(n.T, pivoting=True)
    return sorted(int(i) for i in order[: n.shape[1]])
