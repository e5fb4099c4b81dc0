"""A model that holds the smoothed one and more: what the strengths that it has besides would do to the rows of the solution."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.ocp import Horizon, ParameterPrior, Transcription, transcribe
from backsight.ocp.columnwise import Columnwise
from backsight.ocp.nlp import Values
from backsight.ocp.pointwise import COMMON
from backsight.ocp.terms import Term

from .score import Columns, Linearised

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SAME = 1e-5  # of a row: more is another model


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
