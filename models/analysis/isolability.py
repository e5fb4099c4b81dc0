"""Which faults the outputs of a model can tell apart, whatever is recorded: by structure alone.

Every place, input and output may be faulty: w_i = 0, u_j = what was recorded, or y_k = h may not hold. In the equations of a model, with
x, x', z, w and u unknown, x and x' joined by one more equation each, those equations can be contradicted by recordings that lie in the
over-determined part of the Dulmage-Mendelsohn decomposition:

    fault i is seen                   its equation lies there
    fault i is told from fault j      it still lies there without the equation of j

(M. Krysander, E. Frisk, Sensor placement for fault diagnosis, IEEE Trans. Systems, Man and Cybernetics A 38, 2008.) Parameters count as
known. What is told here by structure may be told by next to nothing in a recording; what is not told here never is, if a fault may have any
course. One that follows a law, as friction does, may be told all the same.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.sparse import csr_array, vstack

from ..compilation.structure import fault
from ..dae import Dae

Array = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@dataclass(frozen=True, kw_only=True)
class Isolability:
    """faults: places by name, input:<name>, sensor:<name>. seen (n,): which can be seen; apart (n, n): i can be told from j."""

    faults: tuple[str, ...]
    seen: Array
    apart: Array

    def alike(self, name: str) -> tuple[str, ...]:
        """The faults that could as well be there where this one seems to be."""
        i = self.faults.index(name)
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
    x, w, u = dae.x.shape[0], dae.w.shape[0], dae.u.shape[0]
    unknown = ca.vertcat(dae.x, dae.dx, dae.z, dae.w, dae.u)
    n, rates, forces = unknown.shape[0], np.arange(x, 2 * x), np.arange(unknown.shape[0] - w - u, unknown.shape[0])
    model = _rows(ca.jacobian_sparsity(ca.vertcat(dae.residual, dae.output), unknown))
    joined = _ones(np.concatenate([np.arange(x)] * 2), np.concatenate([np.arange(x), rates]), (x, n))
    given = _ones(np.arange(w + u), forces, (w + u, n))
    rows = csr_array(vstack([given, model, joined]))
    sensors = w + u + dae.residual.shape[0] + np.arange(len(dae.outputs))
    own = np.concatenate([np.arange(w + u), sensors])
    faults = [p.name for p in dae.places] + [f"input:{q.name}" for q in dae.inputs] + [f"sensor:{q.name}" for q in dae.outputs]
    apart = np.array([_seen(rows, own, without=j) for j in own]).T
    return Isolability(faults=tuple(faults), seen=_seen(rows, own), apart=apart)


def telling(dae: Dae, name: str, others: Collection[str], measured: Collection[str]) -> list[str]:
    """The states of which one more sensor would tell a fault from all the others."""
    own = _with_outputs(dae, [i for i, q in enumerate(dae.outputs) if q.name in measured])
    found = list[str]()
    for i, state in enumerate(dae.states):
        more = replace(own, output=ca.vertcat(own.output, dae.x[i]), outputs=(*own.outputs, replace(state, name=f"{state.name} (more)")))
        if not set(others) & set(isolability(more).alike(name)):
            found.append(state.name)
    return found


def _with_outputs(dae: Dae, numbers: Sequence[int]) -> Dae:
    return replace(dae, output=dae.output[numbers], outputs=tuple(dae.outputs[i] for i in numbers))


def _seen(rows: csr_array, own: np.ndarray[tuple[int], np.dtype[np.int64]], without: int | None = None) -> Array:
    """Which of the equations `own` lie in the over-determined part."""
    left = np.delete(np.arange(rows.shape[0]), [] if without is None else [without])
    over = left[np.array(fault(csr_array(rows[left]))[0], dtype=np.int64)]
    return np.isin(own, over)


def _ones(rows: object, columns: object, shape: tuple[int, int]) -> csr_array:
    at = np.asarray(rows), np.asarray(columns)
    return csr_array((np.ones(len(at[0]), dtype=bool), at), shape=shape)


def _rows(sparsity: ca.Sparsity) -> csr_array:
    return _ones(sparsity.get_triplet()[0], sparsity.get_triplet()[1], sparsity.shape)
