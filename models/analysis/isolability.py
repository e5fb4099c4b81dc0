"""Which faults the outputs of a model can tell apart, whatever is recorded: by structure alone.

Every place, input and output may be faulty: w_i = 0, u_j = what was recorded, or y_k = h may not hold. In the equations of a model, with
x, x', z, w and u unknown, x and x' joined by one more equation each, those equations can be contradicted by recordings that lie in the
over-determined part of the Dulmage-Mendelsohn decomposition:

    fault i is seen                   its equation lies there
    fault i is told from fault j      it still lies there without the equation of j

(structural detectability and isolability: M. Krysander, E. Frisk, Sensor placement for fault diagnosis, IEEE Trans. Systems, Man and
Cybernetics A 38, 2008). Parameters count as known. Of terms that cancel the structure does not know: so columns of the transfer matrix must
not be parallel either, of the model linearised at one of a few random points. What is not told here never is, if a fault may have any
course; one that follows a law, as friction does, may be told all the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array, vstack

from ..compilation.structure import fault
from ..dae import Dae

Array = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

FREQUENCY = 3.0 + 7.0j  # rad/s
REACHES = (1.0, 1e-1, 1e-2, 1e-3)  # of the points' values: what is played out, saturated or slips at one is not at another
NONE = 1e-9  # of a sum's terms: rounding


@dataclass(frozen=True, kw_only=True)
class Isolability:
    """faults: places by name, input:<name>, sensor:<name>. seen (n,): which can be seen; apart (n, n): i can be told from j."""

    faults: tuple[str, ...]
    seen: Array
    apart: Array

    def alike(self, name: str) -> tuple[str, ...]:
        """The faults that could as well be there where this one seems to be."""
        i = self.faults.index(name)
        if not self.seen[i]:
            return ()
        return tuple(other for j, other in enumerate(self.faults) if j != i and self.seen[j] and not self.apart[i, j])

    @property
    def classes(self) -> list[tuple[str, ...]]:
        """Those of which none can be told from the others, where they are several."""
        found = dict.fromkeys(
            tuple(sorted((name, *self.alike(name)), key=self.faults.index)) for name in self.faults if name not in self.unseen
        )
        return [names for names in found if len(names) > 1]

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that no output shows."""
        return tuple(name for name, seen in zip(self.faults, self.seen, strict=True) if not seen)


def isolability(dae: Dae, measured: Collection[str] | None = None) -> Isolability:
    """Of all places and inputs of a model, and of the outputs that are measured, by default all."""
    dae = dae if measured is None else _with_outputs(dae, [i for i, q in enumerate(dae.outputs) if q.name in measured])
    rows, own = _structure(dae)
    apart, shown = np.array([_seen(rows, own, without=j) for j in own]).T, _seen(rows, own)
    transferred = list(_transfers(dae))
    if transferred:
        shown &= np.any([np.any(G != 0, axis=0) for G in transferred], axis=0)
        apart &= np.any([_not_parallel(G) for G in transferred], axis=0)
    return Isolability(faults=_names(dae), seen=shown, apart=apart)


def telling(dae: Dae, name: str, others: Collection[str], measured: Collection[Collection[str]], states: Collection[str]) -> list[str]:
    """Of these states those of which one more sensor would tell a fault from all the others. measured: outputs of every recording."""
    found = list[str]()
    for i, state in enumerate(dae.states):
        if state.name not in states:
            continue
        left = set(others)
        for outputs in measured:
            own = _with_outputs(dae, [k for k, q in enumerate(dae.outputs) if q.name in outputs])
            rows, at = _structure(
                replace(own, output=ca.vertcat(own.output, dae.x[i]), outputs=(*own.outputs, replace(state, name="more")))
            )
            faults = _names(own)
            f = faults.index(name)
            left -= {other for other in left if other not in faults or _seen(rows, at[[f]], without=at[faults.index(other)])[0]}
        if not left:
            found.append(state.name)
    return found


def _names(dae: Dae) -> tuple[str, ...]:
    return (*(p.name for p in dae.places), *(f"input:{q.name}" for q in dae.inputs), *(f"sensor:{q.name}" for q in dae.outputs))


def _structure(dae: Dae) -> tuple[csr_array, Index]:
    """Which unknown stands in which equation, and the equations of the faults."""
    x, w, u = dae.x.shape[0], dae.w.shape[0], dae.u.shape[0]
    unknown = ca.vertcat(dae.x, dae.dx, dae.z, dae.w, dae.u)
    n, rates, forces = unknown.shape[0], np.arange(x, 2 * x), np.arange(unknown.shape[0] - w - u, unknown.shape[0])
    model = _rows(ca.jacobian_sparsity(ca.vertcat(dae.residual, dae.output), unknown))
    joined = _ones(np.concatenate([np.arange(x)] * 2), np.concatenate([np.arange(x), rates]), (x, n))
    given = _ones(np.arange(w + u), forces, (w + u, n))
    sensors = w + u + dae.residual.shape[0] + np.arange(len(dae.outputs))
    return csr_array(vstack([given, model, joined])), np.concatenate([np.arange(w + u), sensors])


def _transfers(dae: Dae) -> Iterator[Any]:
    """From all faults to all outputs, (ny, faults), at random points near and far from nothing, at a frequency of no mode."""
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t]
    both = ca.vertcat(dae.residual, dae.output)
    slopes = ca.Function("slopes", arguments, [ca.densify(ca.jacobian(both, a)) for a in (dae.dx, dae.x, dae.z, dae.w, dae.u)])
    rng, n = np.random.default_rng(0), dae.residual.shape[0]
    for reach in REACHES:
        point = [reach * rng.uniform(0.1, 1.0, a.shape[0]) for a in arguments]
        point[4] = np.array([p.value or p.nominal for p in dae.parameters])
        dx, x, z, w, u = (np.asarray(J) for J in slopes(*point))
        inner, caused = np.hstack([FREQUENCY * dx + x, z]), np.hstack([w, u])
        try:
            moved = np.linalg.solve(inner[:n], caused[:n])
        except np.linalg.LinAlgError:
            continue
        G, size = caused[n:] - inner[n:] @ moved, np.abs(caused[n:]) + np.abs(inner[n:]) @ np.abs(moved)
        if np.isfinite(G).all():
            yield np.hstack([np.where(np.abs(G) > NONE * size, G, 0.0), np.eye(len(G))])


def _not_parallel(G: Any) -> Array:
    """Which columns of a matrix (ny, n) are not a multiple of which others, (n, n), in whatever units: by minors of two rows."""
    there = np.any(G != 0, axis=0)
    found = np.asarray(there[:, None] & ~there, dtype=np.bool_)
    for k, one in enumerate(G):
        for other in G[:k]:
            products = one[:, None] * other
            minor = products - products.T
            found |= np.abs(minor) > NONE * (np.abs(products) + np.abs(products.T))
    return found


def _with_outputs(dae: Dae, numbers: Sequence[int]) -> Dae:
    return replace(dae, output=dae.output[numbers], outputs=tuple(dae.outputs[i] for i in numbers))


def _seen(rows: csr_array, own: Index, without: int | None = None) -> Array:
    """Which of the equations `own` lie in the over-determined part."""
    left = np.delete(np.arange(rows.shape[0]), [] if without is None else [without])
    over = left[np.array(fault(csr_array(rows[left]))[0], dtype=np.int64)]
    return np.isin(own, over)


def _ones(rows: object, columns: object, shape: tuple[int, int]) -> csr_array:
    at = np.asarray(rows), np.asarray(columns)
    return csr_array((np.ones(len(at[0]), dtype=bool), at), shape=shape)


def _rows(sparsity: ca.Sparsity) -> csr_array:
    return _ones(sparsity.get_triplet()[0], sparsity.get_triplet()[1], sparsity.shape)
