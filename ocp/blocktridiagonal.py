"""Symmetric block-tridiagonal matrices: solve, log-determinant and the blocks of the inverse, linear in their number.

Cyclic reduction: every second block is eliminated at once, which leaves a block-tridiagonal matrix of half the length
(Heller, SIAM J. Numer. Anal. 13, 1976). All blocks of a level are handled by one batched call, so there is no loop over time.
The inverse is wanted on the pattern of the matrix only and comes back along the same levels (Takahashi's equations).

With o an eliminated block between its neighbours a and b, and S the inverse:

    L_a = D_o^-1 H_oa,  L_b = D_o^-1 H_ob
    S_oa = -(L_a S_aa + L_b S_ba),   S_ob = -(L_a S_ab + L_b S_bb),   S_oo = D_o^-1 - S_oa L_a' - S_ob L_b'
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .polynomials import Array


@dataclass(frozen=True)
class Level:
    """What the elimination of the odd blocks of one level leaves to be used on the way back."""

    inverse: Array
    to_left: Array
    to_right: Array


@dataclass(frozen=True)
class BlockTridiagonal:
    """Factor of a symmetric matrix with blocks diagonal[k] (n, b, b) and lower[k] = H[k + 1, k] (n - 1, b, b).

    pivots: the blocks that were inverted, level by level.
    """

    levels: tuple[Level, ...]
    root: Array
    pivots: tuple[Array, ...]

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
        saved = []
        for level in self.levels:
            odd, even = rhs[1::2], rhs[0::2].copy()
            saved.append(odd)
            even[: len(odd)] -= _t(level.to_left) @ odd
            right = len(even) - 1
            even[1:] -= _t(level.to_right[:right]) @ odd[:right]
            rhs = even
        x = self.root @ rhs
        for level, odd in zip(reversed(self.levels), reversed(saved), strict=True):
            out = np.empty((len(x) + len(odd), *x.shape[1:]))
            out[0::2] = x
            here = level.inverse @ odd - level.to_left @ x[: len(odd)]
            right = len(x) - 1
            here[:right] -= level.to_right[:right] @ x[1 : right + 1]
            out[1::2] = here
            x = out
        return x

    def inverse_blocks(self) -> tuple[Array, Array]:
        """Diagonal blocks (n, b, b) and blocks [k + 1, k] (n - 1, b, b) of the inverse."""
        diagonal = self.root
        lower = np.empty((0, *self.root.shape[1:]))
        for level in reversed(self.levels):
            odd, even = len(level.inverse), len(diagonal)
            right = even - 1
            S_oa = -level.to_left @ diagonal[:odd]
            S_oa[:right] -= level.to_right[:right] @ lower
            S_ob = -level.to_left[:right] @ _t(lower) - level.to_right[:right] @ diagonal[1:]
            S_oo = level.inverse - S_oa @ _t(level.to_left)
            S_oo[:right] -= S_ob @ _t(level.to_right[:right])
            wide = np.empty((odd + even, *self.root.shape[1:]))
            wide[0::2], wide[1::2] = diagonal, (S_oo + _t(S_oo)) / 2
            between = np.empty((odd + even - 1, *self.root.shape[1:]))
            between[0::2], between[1::2] = S_oa, _t(S_ob)
            diagonal, lower = wide, between
        return diagonal, lower


def factor(diagonal: Array, lower: Array) -> BlockTridiagonal:
    """Factor H; a singular block raises numpy.linalg.LinAlgError. The blocks themselves need not be positive definite."""
    if not (np.all(np.isfinite(diagonal)) and np.all(np.isfinite(lower))):
        raise np.linalg.LinAlgError("the matrix has entries that are not finite")
    levels, pivots = [], []
    while len(diagonal) > 1:
        D, odd = diagonal[1::2], len(diagonal) // 2
        pivots.append(D)
        inverse = _inverse(D)
        inverse = (inverse + _t(inverse)) / 2
        H_oa, right = lower[0::2], (len(diagonal) - 1) // 2
        H_bo = lower[1::2]
        to_left = inverse @ H_oa
        to_right = np.zeros_like(to_left)
        to_right[:right] = inverse[:right] @ _t(H_bo)
        even = diagonal[0::2].copy()
        even[:odd] -= _t(H_oa) @ to_left
        even[1:] -= H_bo @ to_right[:right]
        between = -H_bo @ to_left[:right]
        levels.append(Level(inverse, to_left, to_right))
        diagonal, lower = even, between
    return BlockTridiagonal(tuple(levels), _inverse(diagonal), (*pivots, diagonal))


def _inverse(blocks: Array) -> Array:
    try:
        return np.linalg.inv(blocks)
    except np.linalg.LinAlgError:
        raise np.linalg.LinAlgError("a block of the matrix is singular") from None


def times(diagonal: Array, lower: Array, x: Array) -> Array:
    """H x of the blocks as `factor` takes them; x (n, b, m)."""
    out = diagonal @ x
    out[1:] += lower @ x[:-1]
    out[:-1] += _t(lower) @ x[1:]
    return np.asarray(out, dtype=np.float64)


def _t(blocks: Array) -> Array:
    return np.swapaxes(blocks, -1, -2)
