"""Numerical rank by a gap of the singular values, and null spaces in words."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NOTHING = 1e-12  # of the largest column: an effect below that is rounding
FLOOR = 1e-10  # of the largest singular value: only below that is a gap looked for
CLEAR = 1e3  # factor between neighbours that makes a gap
ROUNDING = 1e-5  # of the largest entry of a null vector: an entry below that is rounding
COMMON = 1e-9  # trace of a change over its parts: below that, it leaves none
EVEN = 1e-12  # relative singular values that count where a change is balanced by others
EXACT = 1e-4  # an entry of a null vector that is so near a whole number is that number


@dataclass(frozen=True, kw_only=True, eq=False)
class Rank:
    """A matrix with columns of length one (zero where there is nothing), and its rank.

    columns (m, n), lengths (n,) before normalisation; vectors (n, n): right singular vectors, the last n - number span the null space;
    kept, dropped: the singular values on both sides of the gap over the largest; clear: 1e3 apart; threshold: where rounding begins.
    """

    columns: Array
    lengths: Array
    vectors: Array
    number: int
    kept: float
    dropped: float
    threshold: float
    clear: bool

    @property
    def deficiency(self) -> int:
        """Dimensions of the null space beyond the columns that are zero."""
        return int(np.count_nonzero(self.lengths)) - self.number

    def lowered_without(self, i: int) -> bool:
        """Whether column i is independent of the others."""
        return _count(np.delete(self.columns, i, axis=1), self.threshold) < self.number

    def margin(self, i: int) -> float:
        """Distance of column i from the span of the others: 1 at right angles, 0 inside."""
        own, others = self.columns[:, i], np.delete(self.columns, i, axis=1)
        left, sizes, _ = np.linalg.svd(others, full_matrices=False)
        span = left[:, sizes > self.threshold]
        return float(np.linalg.norm(own - span @ (span.T @ own)))


def rank_of(matrix: Array) -> Rank:
    """The rank of a matrix (m, n) with m >= n, at its widest gap below 1e-10; what lies above is independent, however badly."""
    lengths = np.linalg.norm(matrix, axis=0)
    lengths = np.where(lengths > NOTHING * lengths.max(initial=0.0), lengths, 0.0)
    columns = np.where(lengths > 0, matrix / np.where(lengths > 0, lengths, 1.0), 0.0)
    _, sizes, vectors = np.linalg.svd(columns)
    sizes = sizes / (sizes[0] or 1.0) if len(sizes) else sizes
    candidates = [k for k in range(1, len(sizes)) if sizes[k] <= FLOOR < sizes[0]]
    number = max(candidates, key=lambda k: sizes[k - 1] / max(sizes[k], 1e-17), default=int(np.count_nonzero(sizes)))
    kept = float(sizes[number - 1]) if number else 0.0
    dropped = float(sizes[number]) if number < len(sizes) else 0.0
    return Rank(
        columns=columns,
        lengths=lengths,
        vectors=vectors.T,
        number=number,
        kept=kept,
        dropped=dropped,
        threshold=10.0 * max(dropped, float(np.finfo(float).eps)),
        clear=kept >= CLEAR * dropped,
    )


@dataclass(frozen=True, kw_only=True)
class Direction:
    """Changes of parameters, made together, that leave no trace in the outputs.

    changes  parameter -> exponent of a common factor ("factor"), coefficient of a common summand in SI ("summand"), or relative change at
             the values looked at ("local")
    pivot    the parameter that this direction is solved for: with it known, the direction is gone
    states   states whose initial values change along
    sizes    nominal sizes of those that are 0, whose "local" changes are relative to that size
    """

    changes: Mapping[str, float]
    pivot: str
    kind: Literal["factor", "summand", "local"]
    states: tuple[str, ...] = ()
    sizes: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        if self.kind == "factor" and all(e == 1.0 for e in self.changes.values()):
            parts, why = list(self.changes), "a common factor leaves the outputs as they are"
        elif self.kind == "factor":
            parts, why = [f"{name}*c{_power(e)}" for name, e in self.changes.items()], "any factor c leaves the outputs as they are"
        elif self.kind == "summand":
            parts = [f"{name} {'+' if e > 0 else '-'} {_times(abs(e))}c" for name, e in self.changes.items()]
            why = "any summand c leaves the outputs as they are"
        else:
            parts = [f"{n} {e / 100 * self.sizes[n]:+.3g}" if n in self.sizes else f"{n} {e:+.3g} %" for n, e in self.changes.items()]
            why = "such small changes together leave the outputs as they are"
        if len(self.changes) == 1:
            why = f": other initial {', '.join(self.states)} make up for it" if self.states else ""
            return f"{next(iter(self.changes))} cannot be told{why}"
        along = f", with other initial {', '.join(self.states)}" if self.states else ""
        return f"only in combination: {', '.join(parts)} ({why}{along})"


def directions(
    draws: Sequence[tuple[Rank, Array]],
    names: Sequence[str],
    unidentifiable: Sequence[int],
    states: Sequence[str],
    zero: Collection[str] = (),
) -> tuple[Direction, ...]:
    """The null space of the columns [states, names, ...] in directions of few parameters (reduced echelon form).

    Absolute changes of the first experiment that leave no trace in the others either are summands, relative ones are factors; the rest is
    told for the first experiment.

    draws  for each experiment the rank of its sensitivities, and the sizes by which the columns of `names` are scaled: the parameters'
           values, so that changes are relative, or something else for those that are zero
    zero   names of these: they have no factors
    """
    nx = len(states)
    rank, sizes = draws[0]
    usable = [i for i in unidentifiable if rank.lengths[nx + i] > 0]
    rows = np.zeros((rank.vectors.shape[1] - rank.number, len(names)))
    rows[:, usable] = rank.vectors[[nx + i for i in usable], rank.number :].T / rank.lengths[[nx + i for i in usable]]
    space = _echelon(rows)[0]
    others = draws[1:]
    summands = _common(space, [(other, sizes / own) for other, own in others], nx)
    factors = _beyond(_common(space, [(other, np.ones(len(names))) for other, _ in others], nx), summands)
    local = _beyond(space, np.vstack([summands, factors]))
    kinds: tuple[tuple[Literal["factor", "summand", "local"], Array], ...] = (("summand", summands), ("factor", factors), ("local", local))
    out = []
    for kind, space in kinds:
        for vector, pivot in zip(*_echelon(space), strict=True):
            written = _fractions(vector * sizes / sizes[pivot] if kind == "summand" else vector) if kind != "local" else vector
            changes = {name: float(v) for name, v in zip(names, written, strict=True) if v}
            absent = {name: float(s) for name, s in zip(names, sizes, strict=True) if name in zero and name in changes}
            shown = "local" if kind == "factor" and absent else kind
            out.append(Direction(changes=changes, pivot=names[pivot], kind=shown, states=_along(rank, vector, states), sizes=absent))
    return tuple(out)


def _common(space: Array, others: Sequence[tuple[Rank, Array]], nx: int) -> Array:
    """Rows that span those changes of a row space which, rescaled, leave no trace in other experiments either; none without others."""
    if not len(space) or not others:
        return np.zeros((0, space.shape[1]))
    traces = []
    for rank, scale in others:
        last = nx + space.shape[1]
        moved = (space * scale * rank.lengths[nx:last]).T
        rest = np.hstack([rank.columns[:, :nx], rank.columns[:, last:]])
        trace = rank.columns[:, nx:last] @ moved
        trace -= rest @ np.linalg.lstsq(rest, trace, rcond=EVEN)[0]
        traces.append(trace / np.linalg.norm(moved, 2))
    _, sizes, vectors = np.linalg.svd(np.vstack(traces))
    return np.asarray(vectors[np.concatenate([sizes, np.zeros(len(vectors) - len(sizes))]) < COMMON] @ space, dtype=np.float64)


def _beyond(space: Array, part: Array) -> Array:
    """Those rows in echelon form of a space that are independent of `part` and of each other."""
    kept: list[Array] = []
    for row in _echelon(space)[0]:
        known = np.vstack([part, *kept])
        basis = np.linalg.qr(known.T)[0] if len(known) else np.zeros((len(row), 0))
        if np.linalg.norm(row - basis @ (basis.T @ row)) > ROUNDING * np.linalg.norm(row):
            kept.append(row[None, :])
    return np.vstack([np.zeros((0, space.shape[1])), *kept])


def together(found: Sequence[Direction]) -> list[str]:
    """Directions in sentences; those that are no common factor or summand and share parameters, in one."""
    groups: list[list[Direction]] = []
    for direction in found:
        near = [g for g in groups if direction.kind == "local" and any({*direction.changes} & {*d.changes} for d in g if d.kind == "local")]
        groups = [g for g in groups if g not in near] + [[*(d for g in near for d in g), direction]]
    lines = []
    for group in groups:
        if len(group) == 1:
            lines.append(str(group[0]))
        else:
            names = dict.fromkeys(name for d in group for name in d.changes)
            example = ", ".join(d.pivot for d in group)
            lines.append(f"only in combination: {', '.join(names)} ({len(group)} of them must be known, for instance {example})")
    return lines


def _along(rank: Rank, change: Array, states: Sequence[str]) -> tuple[str, ...]:
    """The states that have to change with the parameters."""
    nx, last = len(states), len(states) + len(change)
    moved = change * rank.lengths[nx:last]
    others = np.hstack([rank.columns[:, :nx], rank.columns[:, last:]])
    answer = np.linalg.lstsq(others, -rank.columns[:, nx:last] @ moved, rcond=EVEN)[0][:nx]
    return tuple(name for name, a in zip(states, answer, strict=True) if abs(a) > ROUNDING * np.abs(moved).max())


def _echelon(rows: Array) -> tuple[Array, list[int]]:
    """Reduced row echelon form with the largest entries as pivots, and their columns; without the rows that are rounding."""
    rows, pivots = rows.copy(), []
    size = np.abs(rows).max(initial=0.0)
    for k in range(len(rows)):
        block = np.abs(rows[k:])
        i, column = (int(index) for index in np.unravel_index(int(np.argmax(block)), block.shape))
        if block[i, column] <= ROUNDING * size:
            break
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
        pivots.append(column)
    out = rows[: len(pivots)]
    return np.where(np.abs(out) > ROUNDING * np.abs(out).max(axis=1, keepdims=True, initial=1e-300), out, 0.0), pivots


def _fractions(vector: Array) -> Array:
    """Entries as whole numbers where a small common multiple makes them so."""
    smallest = np.min(np.abs(vector[vector != 0.0]), initial=np.inf)
    for multiple in (1.0, 2.0, 3.0, 4.0, 6.0, min(1.0 / smallest, 100.0)):
        whole = np.asarray(np.round(vector * multiple), dtype=np.float64)
        if np.allclose(vector * multiple, whole, rtol=0.0, atol=EXACT) and np.count_nonzero(whole) == np.count_nonzero(vector):
            return whole
    return vector


def _count(columns: Array, threshold: float) -> int:
    sizes = np.linalg.svd(columns, compute_uv=False)
    return int(np.count_nonzero(sizes > threshold))


def _power(exponent: float) -> str:
    return "" if exponent == 1.0 else f"^{exponent:.4g}"


def _times(factor: float) -> str:
    return "" if factor == 1.0 else f"{factor:.6g} "
