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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from backsight.models import Dae
from backsight.ocp import Horizon, ParameterPrior, Solution, Transcription, transcribe
from backsight.ocp.columnwise import Columnwise
from backsight.ocp.nlp import Values
from backsight.ocp.pointwise import COMMON
from backsight.ocp.terms import Term

from ..smoothing.rest import near_rest
from ..weighing.kkt import Kkt, gauss_newton

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

SAME = 1e-5  # of a row: more is another model
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
            (multiplied if term.equality or term.heavy else squares).append(part.reshape(-1, n))
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


class Enlarged:
    """A model that holds that of a solution and more: the same equations where its strengths have the values `parameters` (np_all,).

    strengths: indices of these among its parameters. horizons: of the solution, with further inputs where the model has them.
    What a strength does to a force that a sensor reads is left out of its reading but where the reading itself has the strength: it is the
    difference of that force from its mean over a sampling interval. exact: it is not left out, which is dear where strengths are many.
    Raises ValueError where the rows at the solution are not the same.
    """

    def __init__(
        self, base: Linearised, dae: Dae, strengths: list[int], horizons: tuple[Horizon, ...], parameters: Array, *, exact: bool = False
    ) -> None:
        self._base, self._dae, self._strengths, self._exact = base, dae, strengths, exact
        self._read: dict[int, Array] = {}
        t = base.solution.transcription
        self._program: Transcription = transcribed_as(t, dae, horizons, strengths)
        at = {term.name: k for k, term in enumerate(t.nlp.terms)}
        terms = self._program.nlp.terms
        if [term.name for term in t.nlp.terms if term.name != "parameter prior"] != [term.name for term in terms]:
            raise ValueError("the larger model has other kinds of equations")
        self._numbered = [at[term.name] for term in terms]
        order = {t.dae.places[k].name: i for i, k in enumerate(t.soft)}
        if [order[dae.places[k].name] for k in self._program.soft] != list(range(len(t.soft))):
            raise ValueError("the larger model has its places in another order")
        self.check(parameters)

    def check(self, parameters: Array) -> None:
        """Raises ValueError where the rows at the solution are not the same."""
        values, decisions = self._values(parameters)
        rows = self._program.nlp.evaluated.rows(values.scaled(decisions), values)
        for k, row, term in zip(self._numbered, rows, self._program.nlp.terms, strict=True):
            own = self._base.solution.rows[k]
            if row.shape != own.shape or not np.allclose(row, own, rtol=SAME, atol=SAME * max(1.0, float(np.abs(own).max(initial=0.0)))):
                raise ValueError(f"the larger model does not hold the solution: {term.name} differ")

    def columns(self, parameters: Array) -> Columns:
        """The derivatives in all strengths, with these values of the other parameters."""
        values, decisions = self._values(parameters)
        n = len(self._strengths)
        return self._gathered([self._derivative(k, values, decisions).reshape(-1, n) for k in range(len(self._program.nlp.terms))], n)

    def _gathered(self, parts: Sequence[Array], n: int) -> Columns:
        """Rows of all terms (rows, n), as the base problem has them."""
        squares, multiplied = list[Array](), list[Array]([np.empty((0, n))])
        for part, term in zip(parts, self._program.nlp.terms, strict=True):
            (multiplied if term.equality or term.heavy else squares).append(part)
        for k, term in enumerate(self._base.solution.transcription.nlp.terms):
            if k not in self._numbered:  # what is known beforehand of the parameters comes last, and no strength is in it
                squares.append(np.zeros((term.target.size, n)))
        return Columns(squares=np.concatenate(squares), multiplied=np.concatenate(multiplied) / self._base.sizes[:, None])

    def waves(self, parameters: Array, strength: int, position: Any, numbers: Sequence[float]) -> list[Columns]:
        """Of one strength (its place among them) times sin and cos of number * position, for wave numbers [rad per its unit]."""
        values, _ = self._values(parameters)
        terms, found = self._program.nlp.terms, list[Columns]()
        there = {}
        for number, term in enumerate(terms):
            if self._depends[number] and term.within is None:
                slopes = np.array([J[:, strength] for J in self._slopes_at(number, values)])
                there[number] = slopes, self._position_at(number, values, position), _weights(term)
        for wave in numbers:
            parts = [np.zeros((term.columns * term.target.shape[0], 2)) for term in terms]
            for number, (slopes, s, weights) in there.items():
                both = np.stack([np.sin(wave * s), np.cos(wave * s)])
                summed = np.einsum("pmc,fpc,pk->kmcf", slopes, both, weights).reshape(-1, terms[number].columns, 2)
                parts[number] = (summed * values.scale[number][:, :, None]).transpose(1, 0, 2).reshape(-1, 2)
            found.append(self._gathered(parts, 2))
        return found

    def _slopes_at(self, number: int, values: Values) -> Iterator[Array]:
        """Derivatives in the strengths at every place of a term, each (m, n, C)."""
        for v, d in self._places(number, values):
            (J,) = self._slopes[number](v, values.parameters, values.parameters, d)
            yield J.reshape(len(self._strengths), -1, J.shape[1]).transpose(1, 0, 2)

    def _position_at(self, number: int, values: Values, position: Any) -> Array:
        """A position at the places of a term, (S, C)."""
        dae, term, nx, nu = self._dae, self._program.nlp.terms[number], self._program.nlp.interpolation.states, self._dae.u.shape[0]
        inner = ca.Function("position", [dae.x, dae.p, dae.u, dae.t], [position]).map(term.columns)
        found = [inner(v[nx : 2 * nx], values.parameters, d[:nu], d[nu : nu + 1]) for v, d in self._places(number, values)]
        return np.array([np.asarray(one).ravel() for one in found])

    def _places(self, number: int, values: Values) -> Iterator[tuple[Array, Array]]:
        """[dx; x; z; w] and what belongs to it, at every place of a term."""
        term, rows = self._program.nlp.terms[number], self._program.nlp.interpolation.rows
        width = term.data.shape[0] // term.places
        for k in range(term.places):
            yield values.base[number][k * rows : (k + 1) * rows], values.data[number][k * width : (k + 1) * width]

    def _derivative(self, number: int, values: Values, decisions: Array) -> Array:
        """Of one term's rows, (C, K m, n)."""
        nlp, n = self._program.nlp, len(self._strengths)
        term = nlp.terms[number]
        if not self._depends[number]:
            return np.zeros((term.columns, term.target.shape[0], n))
        if term.within is not None:
            if number not in self._read or self._exact:  # no shape is in a reading itself
                own = nlp.interpolation.local + len(nlp.free) - n
                self._read[number] = nlp.evaluated.linearised(number, values.scaled(decisions), values).J[:, :, own:].copy()
            return self._read[number]
        parts = zip(_weights(term), self._slopes_at(number, values), strict=True)
        out = sum(weights[:, None, None, None] * J for weights, J in parts)
        scaled = np.asarray(out).reshape(-1, n, term.columns) * values.scale[number][:, None, :]
        return np.asarray(scaled.transpose(2, 0, 1))

    @cached_property
    def _depends(self) -> list[bool]:
        """Which terms have a strength in them; of the samples, whether a reading itself has."""
        dae, chosen, found = self._dae, ca.vertcat(*(self._dae.p[i] for i in self._strengths)), list[bool]()
        for term in self._program.nlp.terms:
            if term.name == "samples" and not self._exact:
                found.append(bool(ca.depends_on(dae.output, chosen)))
            else:
                columns = set(term.function.jac_sparsity(0, 1).get_col())
                found.append(bool(columns & set(self._strengths)))
        return found

    @cached_property
    def _slopes(self) -> list[Columnwise]:
        """Derivatives of the terms' functions in the strengths, (v, p, p_ref, d) -> (m n)."""
        found = []
        for term in self._program.nlp.terms:
            v, p, p_ref, d = (ca.SX.sym(name, *term.function.size_in(i)) for i, name in enumerate(("v", "p", "p_ref", "d")))
            slope = ca.jacobian(term.function(v, p, p_ref, d), p)[:, self._strengths]
            found.append(Columnwise(ca.Function("slope", [v, p, p_ref, d], [ca.densify(ca.cse(ca.vec(slope)))]), COMMON))
        return found

    def _values(self, parameters: Array) -> tuple[Values, Array]:
        there = self._there
        decisions = np.concatenate([self._base.solution.solved.decisions, parameters[self._strengths]])
        return replace(there, parameters=parameters, reference=decisions), decisions

    @cached_property
    def _there(self) -> Values:
        """The numbers at the solution."""
        s, nlp = self._base.solution, self._program.nlp
        first = nlp.values(np.zeros(nlp.parameter_count))
        values = Values(
            parameters=first.parameters,
            data=first.data,
            target=tuple(s.values.target[k] for k in self._numbered),
            scale=tuple(s.values.scale[k] for k in self._numbered),
            reference=first.reference,
            unit=np.concatenate([s.values.unit, np.ones(len(self._strengths))]),
            base=first.base,
        )
        return nlp.about(values, np.concatenate([s.solved.decisions, np.zeros(len(self._strengths))]))


def transcribed_as(t: Transcription, dae: Dae, horizons: Sequence[Horizon], strengths: Sequence[int] = ()) -> Transcription:
    """A model that has all that of a transcription has, by the same scheme, with its forces and no prior.

    Its unknowns are those, and last the parameters `strengths` by their indices.
    """
    names, places = [p.name for p in dae.parameters], [p.name for p in dae.places]
    free = [*(names.index(t.dae.parameters[i].name) for i in t.nlp.free), *strengths]
    return transcribe(
        dae,
        horizons,
        free=free,
        prior=ParameterPrior(mean=np.zeros(len(free)), std=np.full(len(free), np.inf)),
        force_std={places.index(t.dae.places[k].name): float(std) for k, std in zip(t.soft, t.force_std, strict=True)},
        method=t.method,
        degree=t.degree,
    )


def _weights(term: Term) -> Array:
    """Of a term's places in its row groups, (S, K)."""
    return np.eye(term.places) if term.moments is None else term.moments
