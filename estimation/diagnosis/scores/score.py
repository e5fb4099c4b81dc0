"""Score tests: what every strength of a candidate would gain, from one factorisation of the base model's smoothing problem.

With r the scaled rows at the solution, J their derivative in trajectory and parameters, s that in a strength a that is nothing now, the
problem linearised about the solution is min |r + J dX + s a|^2/2 subject to g + A dX + s_g a = 0. Trajectory, residual forces and
parameters projected out, as every hypothesis must have its own,

    [G b; b' c] = [s r]'[s r] - q'K^-1 q,     q = [J'[s r]; [s_g g]],  K = [J'J A'; A 0]
    a^ = -G^-1 b,    cov a^ = G^-1,    2 log(likelihood ratio) = b'G^-1 b

(C. R. Rao, Proc. Cambridge Phil. Soc. 44, 1948; nothing is differentiated and regressed). b ~ N(0, G) where nothing is
missing and the weights are right. Entries of G between candidates tell which of them these recordings can tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from backsight.ocp import Solution

from ...smoothing.rest import near_rest
from ...weighing.kkt import Kkt, gauss_newton

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

FREE = 1e3  # times the room near rest: what happens there tells nothing


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Derivatives of the rows in n strengths: of the squares (R, n), and of the rows with multipliers, each over its size (M, n)."""

    squares: Array
    multiplied: Array

    def __len__(self) -> int:
        return self.squares.shape[1]

    def taken(self, columns: Sequence[int]) -> Columns:
        """Some of them."""
        return Columns(squares=self.squares[:, list(columns)], multiplied=self.multiplied[:, list(columns)])

    def less(self, others: Columns) -> Columns:
        """Without what others do."""
        return Columns(squares=self.squares - others.squares, multiplied=self.multiplied - others.multiplied)

    def times(self, strengths: Array) -> Columns:
        """What strengths (n,) do together: one column."""
        return Columns(squares=(self.squares @ strengths)[:, None], multiplied=(self.multiplied @ strengths)[:, None])

    @staticmethod
    def joined(parts: list[Columns]) -> Columns:
        """Side by side."""
        return Columns(squares=np.hstack([p.squares for p in parts]), multiplied=np.hstack([p.multiplied for p in parts]))


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Of n strengths: b (n,), G (n, n), and their squares before anything is projected out, (n,)."""

    b: Array
    G: Array
    plain: Array


@dataclass(frozen=True)
class Linearised:
    """The smoothing problem of a solution, linearised there."""

    solution: Solution

    def scores(self, columns: Columns, more: sp.csc_matrix | None = None) -> Scores:
        """Score and information of strengths.

        more (n, unknowns): derivatives of further squares, which are nothing at the solution and in which no strength stands.
        """
        kkt = self._kkt if more is None else gauss_newton(self.solution, more)
        own = Columns(squares=self._squares[:, None], multiplied=self._multiplied[:, None])
        joined = Columns.joined([columns, own])
        s, q = joined.squares, self.pushed(joined)
        G = s.T @ s - q.T @ kkt.solved(q)
        G = (G + G.T) / 2
        plain = np.sum(columns.squares**2, axis=0) + np.sum((columns.multiplied * self.sizes[:, None]) ** 2, axis=0)
        return Scores(b=G[:-1, -1], G=G[:-1, :-1], plain=plain)

    def pushed(self, columns: Columns) -> Array:
        """By how much strengths push trajectory, parameters and multipliers, the right-hand sides of K, (unknowns + M, n)."""
        return np.concatenate([self._kkt.free[:, None] * (self._J.T @ columns.squares), columns.multiplied])

    def effects(self, columns: Columns) -> Array:
        """What strengths do to all rows, trajectory and parameters projected out: (R + M, n). Its products are G, those with `left` b."""
        moved, unknowns = self._kkt.solved(self.pushed(columns)), len(self._kkt.free)
        return np.concatenate([columns.squares - self._J @ moved[:unknowns], -(self._softness[:, None] ** 0.5) * moved[unknowns:]])

    def drawn(self, seed: int, draws: int) -> Drawn:
        """What chance makes of scores, where nothing is missing: of rows that are white and of unit variance."""
        rng, d = np.random.default_rng(seed), self._softness[:, None]
        squares = rng.standard_normal((self._J.shape[0], draws))
        noise = np.concatenate([self._kkt.free[:, None] * (self._J.T @ squares), d**0.5 * rng.standard_normal((len(d), draws))])
        return Drawn(base=self, squares=squares, moved=self._kkt.solved(noise))

    @cached_property
    def moving(self) -> Linearised:
        """The same with residual forces that are free near rest (`smoothing/rest.py`).

        A rounded sign creeps where a body stands still, and has a law of every kind made better by what holds that back: what acts on a
        machine that moves must be seen while it does.
        """
        s, t = self.solution, self.solution.transcription
        return Linearised(replace(s, values=t.with_force_std(s.values, self._freed)))

    def while_moving(self, columns: Columns) -> Columns:
        """Derivatives of these rows as `moving` has them."""
        now, before = self.moving.solution.values.scale, self.solution.values.scale
        parts = [
            np.divide(new, old, out=np.ones_like(old), where=old > 0).T.ravel()
            for new, old, term in zip(now, before, self.solution.transcription.nlp.terms, strict=True)
            if term.equality or term.heavy
        ]
        factor = np.concatenate([np.empty(0), *parts]) * self.sizes / self.moving.sizes
        return Columns(squares=columns.squares, multiplied=columns.multiplied * factor[:, None])

    @cached_property
    def rests(self) -> bool:
        """Whether there is anything near rest."""
        return bool(np.any(self._freed > 1.0))

    @cached_property
    def _freed(self) -> Array:
        """Factors on the residual forces' deviations, (n_soft, N)."""
        return np.where(near_rest(self.solution.transcription.force_std_at(self.solution.values)), FREE, 1.0)

    @cached_property
    def left(self) -> Array:
        """All rows at the solution, projected like them, (R + M,)."""
        return self.effects(Columns(squares=self._squares[:, None], multiplied=self._multiplied[:, None]))[:, 0]

    @cached_property
    def intervals(self) -> Index:
        """The interval that every one of these rows belongs to, (R + M,)."""
        terms = self.solution.transcription.nlp.terms
        parts = [np.repeat(t.interval, t.target.shape[0]) for heavy in (False, True) for t in terms if (t.equality or t.heavy) is heavy]
        return np.concatenate(parts)

    @cached_property
    def force_rows(self) -> Index:
        """Which of these rows are those of residual forces: place after place within each of an interval's, interval after interval."""
        t, first, found = self.solution.transcription, 0, list[Index]()
        for heavy in (False, True):
            for term in t.nlp.terms:
                if (term.equality or term.heavy) is heavy:
                    if term.name == t.force_term:
                        found.append(first + np.arange(term.target.size).reshape(term.target.T.shape).T)
                    first += term.target.size
        return np.hstack(found)

    @cached_property
    def residual_forces(self) -> Columns:
        """The residual forces themselves, a column for every place: what a scale of all of them would do."""
        t = self.solution.transcription
        n, squares, multiplied = len(t.soft), list[Array](), list[Array]([np.empty((0, len(t.soft)))])
        for term, row in zip(t.nlp.terms, self.solution.rows, strict=True):
            part = np.zeros((*row.T.shape, n))
            if term.name == t.force_term:
                for k in range(n):
                    part[:, k::n, k] = row.T[:, k::n]
            (multiplied if term.equality or term.heavy else squares).append(part.reshape(row.size, n))
        return Columns(squares=np.concatenate(squares), multiplied=np.concatenate(multiplied) / self.sizes[:, None])

    @cached_property
    def sizes(self) -> Array:
        """By which the rows that have multipliers are divided, (M,)."""
        d = self._softness
        return np.where(d > 0, 1.0 / np.sqrt(np.where(d > 0, d, 1.0)), 1.0)

    @cached_property
    def _softness(self) -> Array:
        return np.asarray(self.solution.solver.kkt(self.solution.solved.decisions, self.solution.values)[2])

    @cached_property
    def _kkt(self) -> Kkt:
        return gauss_newton(self.solution)

    @cached_property
    def _J(self) -> sp.csc_matrix:
        s = self.solution
        evaluated, X = s.transcription.nlp.evaluated, s.values.scaled(s.solved.decisions)
        terms = s.transcription.nlp.terms
        return evaluated.jacobian([evaluated.linearised(k, X, s.values) for k, t in enumerate(terms) if not (t.equality or t.heavy)])

    @cached_property
    def _squares(self) -> Array:
        rows = zip(self.solution.transcription.nlp.terms, self.solution.rows, strict=True)
        return np.concatenate([r.T.ravel() for t, r in rows if not (t.equality or t.heavy)])

    @cached_property
    def _multiplied(self) -> Array:
        rows = zip(self.solution.transcription.nlp.terms, self.solution.rows, strict=True)
        parts = [r.T.ravel() for t, r in rows if t.equality or t.heavy]
        return (np.concatenate(parts) if parts else np.empty(0)) / self.sizes


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Draws of all rows: of the squares (R, draws), and what trajectory, parameters and multipliers make of them and the others."""

    base: Linearised
    squares: Array
    moved: Array

    @property
    def left(self) -> Array:
        """All rows, trajectory and parameters projected out, (R + M, draws)."""
        base, unknowns = self.base, len(self.base._kkt.free)
        return np.concatenate([self.squares - base._J @ self.moved[:unknowns], -(base._softness[:, None] ** 0.5) * self.moved[unknowns:]])

    def b(self, columns: Columns) -> Array:
        """Scores of strengths, (n, draws): by the same draws of all of them, N(0, G)."""
        return columns.squares.T @ self.squares - self.base.pushed(columns).T @ self.moved
