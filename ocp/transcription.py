"""From a DAE and horizons to a nonlinear program: two transcriptions of one problem.

    min  1/2 sum_k |(y_k - h(dx, x, z, u, p)(t_k)) / std|^2  +  1/2 int |w / std_w|^2 dt
         + 1/2 |(x(t_0) - x_0) / std_0|^2  +  1/2 |(p - p_0) / std_p|^2
    s.t. F(dx, x, z, u, p, w) = 0 on the horizon,  bounds on p

"spline" (`spline.py`) keeps the balances with a residual force in the cost; "collocation" (`collocation.py`) keeps every
equation as a constraint, with w among the unknowns. Both leave the kinematics exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.models import Dae

from . import collocation, spline
from .horizon import Horizon
from .interpolation import Interpolation, local_index
from .linear import averaging
from .nlp import Nlp, Values
from .pieces import Pieces
from .polynomials import Array, gauss, legendre
from .terms import Term, Within

Method = Literal["spline", "collocation"]


@dataclass(frozen=True, kw_only=True)
class ParameterPrior:
    """p_free ~ (mean, std); std inf = nothing known. Shapes (np,)."""

    mean: Array
    std: Array


@dataclass(frozen=True, kw_only=True)
class Transcription:
    """A program and what its unknowns mean.

    offsets (H + 1,): intervals of horizon k are offsets[k] .. offsets[k + 1] - 1. force_std (nw,): std of every residual force.
    """

    dae: Dae
    method: Method
    degree: int
    horizons: tuple[Horizon, ...]
    offsets: tuple[int, ...]
    soft: tuple[int, ...]
    force_std: Array
    nlp: Nlp

    @property
    def force_term(self) -> str:
        """Name of the term that weighs the residual forces."""
        return "balances" if self.method == "spline" else "residual forces"

    @property
    def balance_rows(self) -> list[int]:
        """Rows of the residual in which the forces of the soft places stand."""
        return self.dae.balances_of(self.soft)

    @property
    def exact_rows(self) -> list[int]:
        """Rows of the residual that a spline's constraints are of, in their order."""
        return spline.rows(self.dae, self.soft)[1]

    def mean_forces(self, rows: Mapping[str, Array]) -> Array:
        """Of every soft place what moments add to its mean force in every interval, (n_soft, N); rows: of a spline's terms, by their names.

        The forces at a coloured place stand among the constraints.
        """
        soft, _ = spline.rows(self.dae, self.soft)
        at = {row: ("balances", i) for i, row in enumerate(soft)} | {row: ("equations", i) for i, row in enumerate(self.exact_rows)}
        places = [at[row] for row in self.balance_rows]
        return np.array([rows[name][i] for name, i in places]).reshape(len(self.soft), len(self.nlp.steps))

    def force_std_at(self, values: Values) -> Array:
        """Standard deviations of the soft places' residual forces in every interval with other numbers in the program, (n_soft, N)."""
        n = len(self.soft)
        for term, now in zip(self.nlp.terms, values.scale, strict=True):
            if n and term.name == self.force_term:
                return np.asarray(self.force_std[:, None] * term.scale[:n] / now[:n], dtype=np.float64)
        return np.empty((0, len(self.nlp.steps)))

    def with_force_std(self, values: Values, factor: Array) -> Values:
        """The program's numbers with the residual forces' standard deviations multiplied, factor (n_soft, N) or (n_soft, 1)."""
        scale = tuple(
            s / np.tile(factor, (len(s) // len(self.soft), 1)) if self.soft and t.name == self.force_term else s
            for t, s in zip(self.nlp.terms, values.scale, strict=True)
        )
        return replace(values, scale=scale)

    def with_prior(self, values: Values, prior: ParameterPrior) -> tuple[Transcription, Values]:
        """The program with a further prior beside those that it has, and these of its numbers with that."""
        pieces = Pieces(self.dae, self.nlp.interpolation, self.horizons, self.offsets, self.soft)
        terms = [replace(term, name="further prior") for term in _prior(pieces, self.nlp.free, prior)]
        nlp = replace(self.nlp, terms=(*self.nlp.terms, *terms))
        own, count = nlp.values(values.parameters), len(self.nlp.terms)
        joined = replace(
            values,
            data=(*values.data, *own.data[count:]),
            target=(*values.target, *own.target[count:]),
            scale=(*values.scale, *own.scale[count:]),
            base=(*values.base, *own.base[count:]),
        )
        return replace(self, nlp=nlp), nlp.about(joined, values.reference)

    @property
    def starts(self) -> NDArray[np.int64]:
        """Decision indices of x at the start of every horizon, shape (H, nx)."""
        nx = self.nlp.interpolation.states
        return self.nlp.index[:nx, list(self.offsets[:-1])].T


def transcribe(
    dae: Dae,
    horizons: Sequence[Horizon],
    *,
    free: Sequence[int],
    prior: ParameterPrior,
    force_std: Mapping[int, float],
    method: Method = "spline",
    degree: int = 2,
) -> Transcription:
    """Write the estimation problem over `horizons` as a program.

    free: indices of the unknown parameters. force_std: standard deviation density of the residual force of each place (index
    into dae.w) that may carry one [unit of the place * sqrt(s)]; the others are zero. degree: K, 2 .. 5 (collocation 1 .. 5).
    """
    lowest = 2 if method == "spline" else 1
    if not lowest <= degree <= 5:
        raise ValueError(f"transcribe(degree=...) must be {lowest} .. 5 for method {method!r}; got {degree}.")
    bad = [dae.places[k].name for k, std in force_std.items() if not (np.isfinite(std) and std > 0)]
    if bad:
        raise ValueError(f"transcribe(force_std=...) needs finite, positive values; check {', '.join(bad)}.")
    soft = tuple(sorted(force_std))
    scheme = spline if method == "spline" else collocation
    interpolation = scheme.interpolation(dae, degree, len(soft))
    index, offsets = _indices(horizons, interpolation)
    steps = np.concatenate([h.mesh.steps for h in horizons])
    std = np.array([force_std[k] for k in soft])
    pieces = Pieces(dae, interpolation, horizons, offsets, soft)
    terms = scheme.dynamics(pieces, degree, std)
    terms += [_samples(pieces, degree), *_initial(pieces), *_prior(pieces, free, prior)]
    nlp = Nlp(interpolation=interpolation, index=index, steps=steps, terms=tuple(terms), parameter_count=dae.p.shape[0], free=tuple(free))
    return Transcription(
        dae=dae, method=method, degree=degree, horizons=tuple(horizons), offsets=offsets, soft=soft, force_std=std, nlp=nlp
    )


def _indices(horizons: Sequence[Horizon], interpolation: Interpolation) -> tuple[NDArray[np.int64], tuple[int, ...]]:
    parts, offsets, start = [], [0], 0
    for horizon in horizons:
        part, start = local_index(horizon.mesh.count, interpolation, start)
        parts.append(part)
        offsets.append(offsets[-1] + horizon.mesh.count)
    return np.concatenate(parts, axis=1), tuple(offsets)


def _samples(pieces: Pieces, degree: int) -> Term:
    """Outputs at the samples, (y - target)/std; a missing sample has weight zero, and so has a last one that sees a force still to come."""
    seen = pieces.outputs_at_samples(degree)
    located = [h.mesh.locate(h.time) for h in pieces.horizons]
    data = [np.vstack([h.input_at(h.time), h.clock + h.time]) for h in pieces.horizons]
    if seen.rest.shape[0]:
        data = [np.vstack([d, h.unresolved_input(degree)]) for d, h in zip(data, pieces.horizons, strict=True)]
    within = None
    if seen.moments.shape[0]:
        nodes, weights = gauss(degree + 1)
        within = Within(function=pieces.function("forces", seen.force), nodes=nodes, weights=(weights * legendre(degree, nodes)).T)
        for k, (h, (interval, _)) in enumerate(zip(pieces.horizons, located, strict=True)):
            inside = h.point_data(degree, nodes).reshape(-1, h.mesh.count, len(nodes))[:, interval]
            data[k] = np.vstack([data[k], averaging(h, degree, seen.ahead), inside.transpose(2, 0, 1).reshape(-1, len(interval))])
    target = np.concatenate([h.target for h in pieces.horizons]).T
    std = np.concatenate([np.broadcast_to(h.target_std, h.target.shape) for h in pieces.horizons]).T
    there = np.isfinite(target)
    ends = np.cumsum([len(h.time) for h in pieces.horizons]) - 1
    there[np.array(seen.ahead, dtype=np.int64)[:, None], ends] = False
    return Term(
        name="samples",
        function=pieces.function("samples", seen.output, ca.vertcat(seen.rest, seen.coefficients, seen.moments)),
        interval=pieces.intervals([i for i, _ in located]),
        tau=np.concatenate([tau for _, tau in located]),
        data=np.hstack(data),
        target=np.where(there, target, 0.0),
        scale=np.where(there, 1.0 / std, 0.0),
        within=within,
    )


def _initial(pieces: Pieces) -> list[Term]:
    """What is known of x(t_0), and the invariants that index reduction left behind."""
    dae = pieces.dae
    first = np.array(pieces.offsets[:-1])
    common: dict[str, Any] = {"interval": first, "tau": np.zeros(len(first))}
    data = np.hstack([np.vstack([h.input_at(h.time[:1]), h.clock + h.time[:1]]) for h in pieces.horizons])
    terms = []
    std = np.array([h.initial_std for h in pieces.horizons]).T
    known = np.isfinite(std) & (std > 0)
    if known.any():
        mean = np.array([h.initial for h in pieces.horizons]).T
        terms.append(
            Term(
                name="initial state",
                function=pieces.function("initial", dae.x),
                data=data,
                target=np.where(known, mean, 0.0),
                scale=np.where(known, 1.0 / np.where(known, std, 1.0), 0.0),
                **common,
            )
        )
    if dae.invariants.shape[0]:
        zero = np.zeros((dae.invariants.shape[0], len(first)))
        terms.append(
            Term(
                name="invariants",
                function=pieces.function("invariants", dae.invariants),
                data=data,
                target=zero,
                scale=zero + 1,
                equality=True,
                **common,
            )
        )
    return terms


def _prior(pieces: Pieces, free: Sequence[int], prior: ParameterPrior) -> list[Term]:
    known = np.isfinite(prior.std)
    if not known.any():
        return []
    p = ca.vertcat(*(pieces.dae.p[i] for i, use in zip(free, known, strict=True) if use))
    return [
        Term(
            name="parameter prior",
            function=pieces.function("prior", p),
            interval=np.zeros(1, dtype=np.int64),
            tau=np.zeros(1),
            data=np.zeros((pieces.dae.u.shape[0] + 1, 1)),
            target=prior.mean[known][:, None],
            scale=1.0 / prior.std[known][:, None],
        )
    ]
