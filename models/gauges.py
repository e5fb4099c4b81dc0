"""Positions of which only differences matter: where a machine stands as a whole, of which speeds and forces between its parts say nothing.

    F(x', x + s n, z, u, p, w, t) = F(x', x, z, u, p, w, t),   the same of outputs and invariants, for every s

Such an n is a direction of shifts (a cyclic coordinate: H. Goldstein, Classical Mechanics, 3rd ed., section 8.2); what is estimated is the
same wherever the machine is put along it.
"""

from __future__ import annotations

from collections.abc import Collection

import casadi as ca
import numpy as np
import scipy.linalg

from .dae import Dae

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LOOKS = 8  # random points at which derivatives are taken
ZERO = 1e-10  # of the largest singular value: of what is no shift some derivative is far larger


def gauges(dae: Dae, parameters: Array, outputs: Collection[str], kept: Collection[str] = ()) -> list[int]:
    """States of which one each, held at its start, says where the machine stands; none where its equations or outputs tell that.

    parameters (np,): their values; one that is 0 is taken for what the model would be with it. outputs: those that
    are read; kept: states that are held already.
    """
    nx, read = len(dae.states), [i for i, q in enumerate(dae.outputs) if q.name in outputs]
    there = ca.vertcat(dae.residual, dae.output[read], dae.invariants)
    shifts = ca.Function("shifts", [dae.x, dae.dx, dae.z, dae.u, dae.p, dae.w, dae.t], [ca.jacobian(there, dae.x)])
    rng, size = np.random.default_rng(0), np.array([q.nominal for q in dae.states])
    start = np.array([q.start for q in dae.states])
    looks = []
    for _ in range(LOOKS):
        x, dx = (size * rng.standard_normal(nx) for _ in range(2))
        others = (rng.standard_normal(n) for n in (dae.z.numel(), dae.u.numel()))
        p = np.where(parameters == 0, rng.uniform(0.1, 1.0, len(parameters)), parameters)
        J = np.asarray(ca.DM(shifts(start + x, dx, *others, p, rng.standard_normal(dae.w.numel()), rng.uniform())), dtype=np.float64) * size
        looks.append(J[np.all(np.isfinite(J), axis=1)])
    held = [np.eye(nx)[i : i + 1] for i, q in enumerate(dae.states) if q.name in kept]
    rows = np.vstack([*looks, *held])
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    n = scipy.linalg.null_space(rows / np.where(length > 0, length, 1.0), rcond=ZERO)
    if n.shape[1] == 0:
        return []
    _, _, order = scipy.linalg.qr(n.T, pivoting=True)
    return sorted(int(i) for i in order[: n.shape[1]])
