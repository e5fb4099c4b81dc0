"""From the most probable parameters together with a trajectory towards those of most marginal likelihood, trajectories integrated out.

With J(p) the cost of the best trajectory x^(p), by Laplace,

    -log p(y | p)  =  J(p)  +  1/2 log |det K(p)|  -  1/2 log |det K_0(p)|  +  const

K is the KKT matrix (`curvature.py`) at x^(p) with parameters and first states known: these are parameters too, so that of a model without
residual forces J is the likelihood. K_0 is the same without the samples, which makes a density of forces one of trajectories. A smoother
that minimises J alone takes too little damping where white forces are large (Dutra, Teixeira & Aguirre, Automatica 50, 2014). A Newton step
of the whole, with Sigma the parameters' covariance and S how all unknowns move with them, dx^/dp, the parameters that terms refer to held
(`pieces.py`):

    dp  =  Sigma (-dJ/dp + g),      g_a = 1/2 tr(K_0^-1 dK_0/dp_a) - 1/2 tr(K^-1 dK/dp_a),    d/dp_a along column a of S

A trace is a sum over intervals. What one of them adds to either is large where a law is steep, but to their difference hardly depends on
what is far from it, so that intervals can be left out of it where Laplace's parabola tells nothing of a law.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from .bordered import Index, bordered, entries
from .curvature import Curvature, curvature
from .nlp import Values
from .polynomials import Array
from .solution import Solution

Mask = NDArray[np.bool_]
SHARE = 0.01  # of a parameter's deviation: how far slopes of determinants look


@dataclass(frozen=True)
class Marginal:
    """What the marginal likelihood says at a solution; apart (N,): intervals that are left out of the determinants."""

    solution: Solution
    apart: Mask

    @property
    def determined(self) -> bool:
        """Whether the data determine all unknowns, those on a bound too; nothing else may be asked where they do not."""
        return self._curvature is not None and not len(self._curvature.null)

    @property
    def covariance(self) -> Array:
        """Of the free parameters, those on a bound too, (np, np)."""
        assert self._curvature is not None
        return self._curvature.parameter_covariance

    @property
    def std(self) -> Array:
        """Their deviations, (np,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    def step(self, lower: Array, upper: Array) -> Array:
        """dp (np,) within the bounds (n + np,) of the decisions."""
        n, decisions = self.solution.transcription.nlp.trajectory_size, self.solution.solved.decisions
        least, most = np.minimum(lower[n:] - decisions[n:], 0.0), np.maximum(upper[n:] - decisions[n:], 0.0)
        # with Sigma = L L', the parabola is |L^-1 dp - L' slope|^2
        L, std, moves = np.linalg.cholesky(self.covariance), self.std, most > least
        found = np.zeros(len(std))
        if moves.any():
            bounds = (least / std)[moves], (most / std)[moves]
            found[moves] = lsq_linear((np.linalg.inv(L) * std)[:, moves], L.T @ self.slope, bounds, method="bvls").x
        return np.asarray(found * std, dtype=np.float64)

    def moved(self, step: Array) -> Array:
        """Decisions (n + np,) after a step (np,) of the parameters, to first order."""
        return np.asarray(self.solution.solved.decisions + self._path @ step, dtype=np.float64)

    @property
    def slope(self) -> Array:
        """Of the log marginal likelihood in the free parameters, (np,)."""
        return np.asarray(self.determinants - self.pull, dtype=np.float64)

    @property
    def pull(self) -> Array:
        """dJ/dp (np,): zero at the most probable parameters together with a trajectory, but for those on a bound."""
        s = self.solution
        evaluated, X = s.transcription.nlp.evaluated, s.values.scaled(s.solved.decisions)
        parts = [evaluated.linearised(k, X, s.values) for k, term in enumerate(s.transcription.nlp.terms) if not term.equality]
        return np.asarray((evaluated.gradient(parts) / s.values.unit) @ self._path, dtype=np.float64)

    @cached_property
    def determinants(self) -> Array:
        """g (np,)."""
        s, nlp = self.solution, self.solution.transcription.nlp
        posterior, samples = s.values, s.term("samples")
        prior = replace(posterior, scale=tuple(np.zeros_like(x) if k == samples else x for k, x in enumerate(posterior.scale)))
        known = np.unique(np.concatenate([self._held, s.transcription.starts.ravel(), np.arange(nlp.trajectory_size, nlp.size)]))
        return (self._slopes(prior, known) - self._slopes(posterior, known)) / 2.0

    def _slopes(self, values: Values, known: NDArray[np.int64]) -> Array:
        """d/dp log |det K| in the intervals that are not left out, (np,), with these numbers and these decisions known."""
        s = self.solution
        H, J, softness = s.solver.kkt(s.solved.decisions, values)
        K, there = bordered(s.transcription.nlp, H, J, softness, known), (entries(s.transcription.nlp, H, J), _sizes(softness))
        steps = SHARE * self.std
        changes = (self._change(values, there, step * direction) for step, direction in zip(steps, self._path.T, strict=True))
        return np.array([float(np.sum(K.traces(*change)[~self.apart])) for change in changes]) / steps

    def _change(self, values: Values, there: tuple[sp.csc_matrix, Array], move: Array) -> tuple[Index, Index, Array]:
        """Entries of one triangle of K's change some way off `there`: K, and the units of the rows of J that stay."""
        nlp, (before, size) = self.solution.transcription.nlp, there
        H, J, softness = self.solution.solver.kkt(self.solution.solved.decisions + move, values)
        change = sp.coo_matrix(entries(nlp, H, sp.csc_matrix(sp.diags(_sizes(softness) / size) @ J)) - before)
        return change.row.astype(np.int64), change.col.astype(np.int64), change.data

    @cached_property
    def _path(self) -> Array:
        """S (n + np, np)."""
        nlp, found = self.solution.transcription.nlp, self._curvature
        assert found is not None
        local, n = nlp.interpolation.local, nlp.trajectory_size
        path = np.zeros((nlp.size, len(nlp.free)))
        along = found.interval_covariance[:, :local, local:] @ np.linalg.inv(self.covariance)
        path[nlp.index.T] = along
        path[n:] = np.eye(len(nlp.free))
        return path

    @cached_property
    def _curvature(self) -> Curvature | None:
        s = self.solution
        if len(self._held) == len(s.held):
            return s.curvature
        try:
            H, J, softness = s.solver.kkt(s.solved.decisions, s.values)
            found = curvature(s.transcription.nlp, H, J, softness, s.values.unit, self._held)
        except np.linalg.LinAlgError:
            return None
        return found if found.definite else None

    @property
    def _held(self) -> NDArray[np.int64]:
        """What of the trajectories cannot move."""
        held = self.solution.held
        return held[held < self.solution.transcription.nlp.trajectory_size]


def _sizes(softness: Array) -> Array:
    """The units that rows of J were divided by (`Solver.kkt`)."""
    return np.asarray(1.0 / np.sqrt(np.where(softness > 0, softness, 1.0)), dtype=np.float64)
