"""States that nothing depends on, and the model without them: positions and a heading that no force and no output knows of.

    q' = g(x, q),     q in no other equation, output or invariant

Such a q is a quadrature of the others, an ignorable coordinate (E. T. Whittaker, A Treatise on the Analytical Dynamics of Particles and
Rigid Bodies, 4th ed., section 38): what is estimated does not change without it, and its start is open by as much as one likes.
Positions of a pair, whose rate *is* a state, stay: a transcription keeps a pair as one polynomial, and nothing is saved.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .dae import Dae

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Ignorable:
    """State `state` and residual row `row`, the only one that it appears in, as its rate."""

    state: int
    row: int


def ignorable(dae: Dae, kept: Collection[str] = ()) -> tuple[Ignorable, ...]:
    """The ignorable states but those named in `kept`, in an order in which each may depend on later ones: the last is integrated first."""
    in_x, in_dx = _there(dae.residual, dae.x), _there(dae.residual, dae.dx)
    others = ca.vertcat(dae.z, dae.u, dae.p, dae.w, dae.t)
    alone: NDArray[np.bool_] = np.logical_not(np.any(_there(dae.residual, others), axis=1, keepdims=True))[
        :, 0
    ]  # rows of nothing but states
    looked_at = ca.vertcat(dae.output, dae.invariants)
    needed = _there(looked_at, dae.x).any(axis=0) | _there(looked_at, dae.dx).any(axis=0)
    needed = needed | np.isin([q.name for q in dae.states], list(kept))
    paired, found = {row for _, _, row in dae.kinematics}, list[Ignorable]()
    left: NDArray[np.bool_] = np.ones(len(alone), dtype=np.bool_)
    while True:
        before = len(found)
        for i in np.flatnonzero(~needed).tolist():
            rows = np.flatnonzero(left & (in_x[:, i] | in_dx[:, i]))
            if len(rows) != 1:
                continue
            row = int(rows[0])
            own = in_dx[row, i] and not in_x[row, i] and in_dx[row].sum() == 1 and alone[row] and row not in paired
            if own and not _there(ca.jacobian(dae.residual[row], dae.dx[i]), ca.vertcat(dae.dx, dae.x)).any():
                found.append(Ignorable(state=i, row=row))
                left[row] = False
        if len(found) == before:
            return tuple(found)


def without_ignorable(dae: Dae, kept: Collection[str] = ()) -> Dae:
    """The model without its ignorable states; itself where it has none."""
    gone = ignorable(dae, kept)
    if not gone:
        return dae
    states = [i for i in range(len(dae.states)) if i not in {g.state for g in gone}]
    rows = [r for r in range(len(dae.equations)) if r not in {g.row for g in gone}]
    symbols = ca.vertcat(*(s[g.state] for g in gone for s in (dae.x, dae.dx)))
    return replace(
        dae,
        x=dae.x[states],
        dx=dae.dx[states],
        states=tuple(dae.states[i] for i in states),
        residual=dae.residual[rows],
        equations=tuple(dae.equations[r] for r in rows),
        kinematics=tuple((states.index(i), states.index(j), rows.index(r)) for i, j, r in dae.kinematics),
        variables={name: e for name, e in dae.variables.items() if not ca.depends_on(e, symbols)},
    )


def integrated(dae: Dae, gone: tuple[Ignorable, ...], times: Array, x: Array) -> Array:
    """The ignorable states at M times, by Simpson's rule from their declared starts, (len(gone), M).

    x (nx, 2 M - 1): all states at the times and in the middle between them, in which the ignorable ones need no value.
    """
    x, h = x.copy(), np.diff(times)
    out = np.empty((len(gone), len(times)))
    for k in reversed(range(len(gone))):
        i, row = gone[k].state, gone[k].row
        slope = ca.jacobian(dae.residual[row], dae.dx[i])
        rest = ca.substitute(dae.residual[row], dae.dx[i], 0.0)
        rate = np.asarray(ca.Function("rate", [dae.x], [-rest / slope])(x), dtype=np.float64).ravel()
        left, middle, right = rate[:-1:2], rate[1::2], rate[2::2]
        out[k] = dae.states[i].start + np.concatenate([[0.0], np.cumsum(h * (left + 4 * middle + right) / 6)])
        x[i, ::2] = out[k]
        x[i, 1::2] = out[k, :-1] + h * (5 * left + 8 * middle - right) / 24
    return out


def step(dae: Dae, gone: tuple[Ignorable, ...]) -> Any:
    """One step of the same as a function (values at its start (len(gone),), x (nx, 3) at its start, middle and end, its length)."""
    start, x, h = ca.SX.sym("start", len(gone)), ca.SX.sym("x", dae.x.shape[0], 3), ca.SX.sym("h")
    places, out = ca.horzsplit(x), ca.SX(len(gone), 1)
    for k in reversed(range(len(gone))):
        i, row = gone[k].state, gone[k].row
        slope = ca.jacobian(dae.residual[row], dae.dx[i])
        rate = ca.Function("rate", [dae.x], [-ca.substitute(dae.residual[row], dae.dx[i], 0.0) / slope])
        left, middle, right = (rate(place) for place in places)
        out[k] = start[k] + h * (left + 4 * middle + right) / 6
        for place, value in zip(places, (start[k], start[k] + h * (5 * left + 8 * middle - right) / 24, out[k]), strict=True):
            place[i] = value
    return ca.Function("step", [start, x, h], [out])


def _there(expression: Any, symbols: Any) -> NDArray[np.bool_]:
    """Which rows of an expression depend on which symbols."""
    pattern = ca.jacobian_sparsity(expression, symbols)
    out = np.zeros(pattern.shape, dtype=bool)
    out[pattern.row(), pattern.get_col()] = True
    return out
