"""Symmetric block-tridiagonal matrices: solve, log-determinant and the blocks of the inverse, linear in their number.

A block acts on the next one by few of its places, the same in every block: those of the knot between them. So the block below the diagonal
is kept by its columns there, H_kc (b, c). Cyclic reduction: every second block is eliminated at once, which leaves a matrix of half the
length and the same pattern (Heller, SIAM J. Numer. Anal. 13, 1976). All blocks of a level are handled by one batched call, so there is no
loop over time; beside the inverses of blocks, work is of order b^2 c. The inverse is wanted on the pattern of the matrix only and comes
back along the same levels (Takahashi's equations).

With o an eliminated block between its neighbours a and b, I = D_o^-1, S the inverse, and c the places of the knots:

    L = I H_oa (b, c),    D_a,cc -= H_oa' L,    D_b -= H_bo I_cc H_bo',    H_ba = -H_bo L_c
    S_oa = -(L S_aa,cc + I_c H_bo' S_ba),       S_bo = -(S_ba L_c' + S_bb H_bo I_cc)          both in the columns c
    S_oo = I - S_oa L' - T I_c',                T = S_ob H_bo = -(L S_ba' H_bo + I_c H_bo' S_bb H_bo)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .polynomials import Array


@dataclass(frozen=True)
class Level:
    """What the elimination of the odd blocks of one level leaves to be used on the way back: I, L and H_bo."""

    inverse: Array
    to_left: Array
    below: Array


@dataclass(frozen=True)
class BlockTridiagonal:
    """Factor of a symmetric matrix with blocks diagonal[k] (n, b, b) and lower[k] = H[k + 1, k] (n - 1, b, c) in the columns `knot`.

    pivots: the blocks that were inverted, level by level.
    """

    levels: tuple[Level, ...]
    root: Array
    pivots: tuple[Array, ...]
    knot: slice

    @cached_property
    def _eigenvalues(self) -> Array:
        values = np.concatenate([np.linalg.eigvalsh(blocks).ravel() for blocks in self.pivots])
        if not np.all(np.isfinite(values)):
            raise np.linalg.LinAlgError("a block of the matrix is singular")
        return values

    @property
    def log_abs_determinant(self) -> float:
        """log |det H|; -inf where a block is singular but for rounding, which costs the solutions with H only their digits there."""
        found = float(sum(np.sum(np.linalg.slogdet(blocks)[1]) for blocks in self.pivots))
        if np.isnan(found):
            raise np.linalg.LinAlgError("a block of the matrix is singular")
        return found

    @property
    def negative_eigenvalues(self) -> int:
        """Number of negative eigenvalues of H, by Sylvester's law of inertia; a singular block may raise numpy.linalg.LinAlgError."""
        if np.any(self._eigenvalues == 0):
            raise np.linalg.LinAlgError("a block of the matrix is singular")
        return int(np.sum(self._eigenvalues < 0))

    def solve(self, rhs: Array) -> Array:
        """H^-1 rhs; rhs (n, b, m)."""
        saved, knot = [], self.knot
        for level in self.levels:
            odd, even = rhs[1::2], rhs[0::2].copy()
            saved.append(odd)
            right = len(even) - 1
            even[: len(odd), knot] -= _t(level.to_left) @ odd
            even[1:] -= level.below @ (level.inverse[:right, knot] @ odd[:right])
            rhs = even
        x = self.root @ rhs
        for level, odd in zip(reversed(self.levels), reversed(saved), strict=True):
            out = np.empty((len(x) + len(odd), *x.shape[1:]))
            out[0::2] = x
            here = level.inverse @ odd - level.to_left @ x[: len(odd), knot]
            right = len(x) - 1
            here[:right] -= level.inverse[:right, :, knot] @ (_t(level.below) @ x[1 : right + 1])
            out[1::2] = here
            x = out
        return x

    def inverse_blocks(self) -> tuple[Array, Array]:
        """Of the inverse: diagonal blocks (n, b, b), and blocks [k + 1, k] in the columns `knot`, (n - 1, b, c)."""
        diagonal, knot = self.root, self.knot
        lower = np.empty((0, self.root.shape[1], self.root[0, :, knot].shape[1]))
        for level in reversed(self.levels):
            odd, even = len(level.inverse), len(diagonal)
            right = even - 1
            L, H_bo, I_c = level.to_left, level.below, level.inverse[:right, :, knot]
            S_oa = -L @ diagonal[:odd, knot, knot]
            S_oa[:right] -= I_c @ (_t(H_bo) @ lower)
            S_bb_H = diagonal[1:] @ H_bo
            S_bo = -(lower @ _t(L[:right, knot]) + S_bb_H @ I_c[:, knot])
            T = -(L[:right] @ (_t(lower) @ H_bo) + I_c @ (_t(H_bo) @ S_bb_H))
            S_oo = level.inverse - S_oa @ _t(L)
            S_oo[:right] -= T @ _t(I_c)
            wide = np.empty((odd + even, *self.root.shape[1:]))
            wide[0::2], wide[1::2] = diagonal, (S_oo + _t(S_oo)) / 2
            between = np.empty((odd + even - 1, *lower.shape[1:]))
            between[0::2], between[1::2] = S_oa, S_bo
            diagonal, lower = wide, between
        return diagonal, lower


def factor(diagonal: Array, lower: Array, knot: slice) -> BlockTridiagonal:
    """Factor H; a singular block raises numpy.linalg.LinAlgError. The blocks themselves need not be positive definite."""
    if not (np.all(np.isfinite(diagonal)) and np.all(np.isfinite(lower))):
        raise np.linalg.LinAlgError("the matrix has entries that are not finite")
    levels, pivots = [], []
    with np.errstate(over="ignore", invalid="ignore"):  # what is next to singular is told below
        while len(diagonal) > 1:
            D, odd = diagonal[1::2], len(diagonal) // 2
            pivots.append(D)
            inverse = _inverse(D)
            inverse = (inverse + _t(inverse)) / 2
            H_oa, H_bo, right = lower[0::2], lower[1::2], (len(diagonal) - 1) // 2
            to_left = inverse @ H_oa
            even = diagonal[0::2].copy()
            even[:odd, knot, knot] -= _t(H_oa) @ to_left
            even[1:] -= H_bo @ inverse[:right, knot, knot] @ _t(H_bo)
            levels.append(Level(inverse, to_left, H_bo))
            diagonal, lower = even, -H_bo @ to_left[:right, knot]
    if not np.all(np.isfinite(diagonal)):
        raise np.linalg.LinAlgError("a block of the matrix is singular to rounding")
    return BlockTridiagonal(tuple(levels), _inverse(diagonal), (*pivots, diagonal), knot)


def _inverse(blocks: Array) -> Array:
    try:
        return np.linalg.inv(blocks)
    except np.linalg.LinAlgError:
        raise np.linalg.LinAlgError("a block of the matrix is singular") from None


def times(diagonal: Array, lower: Array, knot: slice, x: Array) -> Array:
    """H x of the blocks as `factor` takes them; x (n, b, m)."""
    out = diagonal @ x
    out[1:] += lower @ x[:-1, knot]
    out[:-1, knot] += _t(lower) @ x[1:]
    return np.asarray(out, dtype=np.float64)


def _t(blocks: Array) -> Array:
    return np.swapaxes(blocks, -1, -2)
