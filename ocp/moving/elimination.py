"""Orthogonal elimination in symbols: reflections of a sparse matrix of expressions, structural zeros left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import qr

from ..polynomials import Array

LEAST = 1e-300  # added to a column's squared length: one of zeros stays as it is
DETERMINED = 1e-9  # of the largest pivot: less determines nothing


def triangular(matrix: Any, columns: int) -> Any:
    """A matrix of SX after Householder reflections have made its first columns upper triangular."""
    rows = [dict[int, Any]() for _ in range(matrix.shape[0])]
    for i, j, value in zip(*matrix.sparsity().get_triplet(), matrix.nonzeros(), strict=True):
        rows[i][j] = value
    for j in range(min(columns, len(rows))):
        below = [i for i in range(j, len(rows)) if j in rows[i]]
        if below in ([], [j]):
            continue
        if below[0] != j:
            below.insert(0, j)
        a = ca.vertcat(*(rows[i].pop(j, ca.SX(0)) for i in below))
        norm = ca.sqrt(ca.sumsqr(a))
        turned = ca.if_else(a[0] > 0, -norm, norm)
        v = ca.SX(a)
        v[0] -= turned
        scale = 1 / (norm * (norm + ca.fabs(a[0])) + LEAST)
        for c in sorted({c for i in below for c in rows[i]}):
            dot = scale * sum((v[k] * rows[i][c] for k, i in enumerate(below) if c in rows[i]), ca.SX(0))
            for k, i in enumerate(below):
                rows[i][c] = rows[i].get(c, ca.SX(0)) - v[k] * dot
        rows[j][j] = turned
    out = ca.SX(*matrix.shape)
    for i, row in enumerate(rows):
        for j, value in row.items():
            out[i, j] = value
    return out


def back_substituted(upper: Any, count: int) -> Any:
    """The first `count` rows of an upper triangular matrix [T | B] as T^-1 B."""
    out = ca.SX(upper[:count, :])
    for i in range(count - 1, -1, -1):
        out[i, :] = out[i, :] / out[i, i]
        for j in range(i):
            out[j, :] -= out[j, i] * out[i, :]
    return out[:, count:]


def best_determined(J: Array, groups: Sequence[Sequence[int]]) -> tuple[int, ...]:
    """As many columns as J (m, ..) has rows, those that it determines best; of every group as many as it can before the next."""
    chosen: list[int] = []
    left, m = J / np.maximum(np.abs(J).max(axis=1, keepdims=True, initial=0.0), LEAST), len(J)
    for group in groups:
        if not len(group) or len(chosen) == m:
            continue
        Q, R, order = qr(left[:, list(group)], pivoting=True)
        size = np.abs(np.diag(R))
        rank = int(np.sum(size > DETERMINED * max(size.max(initial=0.0), LEAST)))
        chosen += [group[k] for k in order[:rank]]
        left = Q[:, rank:].T @ left
    if len(chosen) < m:
        raise np.linalg.LinAlgError(f"{m - len(chosen)} of the equations without residual force determine nothing in an interval")
    return tuple(chosen)
