"""From the most probable parameters together with a trajectory towards those of most marginal likelihood, trajectories integrated out.

With J(p) the cost of the best trajectory x^(p), by Laplace,

    -log p(y | p)  =  J(p)  +  1/2 log |det K(p)|  -  1/2 log |det K_0(p)|  +  const

K is the KKT matrix (`curvature.py`) at x^(p) with parameters and first states known: these are parameters too, so that of a model without
residual forces J is the likelihood. K_0 is the same without the samples, which makes a density of forces one of trajectories. A smoother
that minimises J alone takes too little damping where white forces are large (Dutra, Teixeira & Aguirre, Automatica 50, 2014). A Newton step
of the whole, with Sigma the parameters' covariance and S how all unknowns move with them, dx^/dp, those that terms refer to held
(`pieces.py`):

    dp  =  Sigma (-dJ/dp + g),      g_a = 1/2 tr(K_0^-1 dK_0/dp_a) - 1/2 tr(K^-1 dK/dp_a),    d/dp_a along column a of S

A trace is a sum over intervals. What one of them adds to either is large where a law is steep, but to their difference hardly depends on
what is far from it, so that intervals can be left out of it where Laplace's parabola tells nothing of a law.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import qr

from .bordered import Index, bordered, entries
from .curvature import Curvature
from .nlp import Values
from .polynomials import Array
from .solution import Solution

Mask = NDArray[np.bool_]
SHARE = 0.1  # of a parameter's deviation: how far slopes of determinants look, ahead and back
FIRST = 1e3  # times its part in a null direction: what is on a bound is held before all else
MOVES = 1e-4  # of the largest part of a null direction, in the program's units: less is rounding


@dataclass(frozen=True, kw_only=True)
class Marginal:
    """What the marginal likelihood says at a solution.

    values: the numbers whose cost J is, where those of the solution serve its deviations (robust losses). apart (N,): intervals that are
    left out of the determinants. All that follows is of the k free parameters `moving`: where a combination of parameters is not
    determined, others that make it up are held, one for each. rather (r,): those that are held where any would do.
    """

    solution: Solution
    values: Values
    apart: Mask
    rather: Index | None = None

    @cached_property
    def moving(self) -> Index:
        """Which of the free parameters, those on a bound too, (k,)."""
        everything = np.arange(len(self.solution.transcription.nlp.free))
        if self.whole is None or not len(self.whole.null):
            return everything
        t, unit = self.solution.transcription, self.solution.values.unit
        null = self.whole.null / np.concatenate([unit[t.starts.ravel()], unit[t.nlp.trajectory_size :]])
        null = (null / np.abs(null).max(axis=1, keepdims=True))[:, -len(everything) :]
        if self.rather is not None and len(self.rather) == len(null) and np.linalg.svd(null[:, self.rather])[1].min() > MOVES:
            return np.setdiff1d(everything, self.rather)
        # what lies on a bound is held first
        null[:, np.isin(t.nlp.trajectory_size + everything, self.solution.solved.on_bound)] *= FIRST
        _, R, order = qr(null, mode="economic", pivoting=True)
        lost = np.flatnonzero(np.abs(np.diag(R)) > MOVES)
        return np.setdiff1d(everything, order[lost])

    @property
    def still(self) -> Index:
        """The free parameters that are held, (r,)."""
        return np.setdiff1d(np.arange(len(self.solution.transcription.nlp.free)), self.moving)

    @property
    def minimum(self) -> bool:
        """Whether the solution is one, with parameters that can move; nothing else may be asked where it is not."""
        return self._curvature is not None and len(self.moving) > 0

    @property
    def covariance(self) -> Array:
        """(k, k)."""
        assert self._curvature is not None
        return self._curvature.parameter_covariance[np.ix_(self.moving, self.moving)]

    @property
    def std(self) -> Array:
        """(k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    def moved(self, step: Array) -> Array:
        """Decisions (n + np,) after a step (k,), to first order."""
        return np.asarray(self.solution.solved.decisions + self._path @ step, dtype=np.float64)

    @property
    def slope(self) -> Array:
        """Of the log marginal likelihood, (k,)."""
        return np.asarray(self.determinants - self.pull, dtype=np.float64)

    @cached_property
    def pull(self) -> Array:
        """dJ/dp (k,): zero at the most probable parameters together with a trajectory, but for those on a bound."""
        s = self.solution
        evaluated, X = s.transcription.nlp.evaluated, self.values.scaled(s.solved.decisions)
        parts = [evaluated.linearised(k, X, self.values) for k, term in enumerate(s.transcription.nlp.terms) if not term.equality]
        return np.asarray((evaluated.gradient(parts) / self.values.unit) @ self._path, dtype=np.float64)

    @cached_property
    def determinants(self) -> Array:
        """g (k,), by central differences: at a kink of a law a shorter way would see either side of it, or nothing."""
        nlp, here, known = self.solution.transcription.nlp, self.solution.solved.decisions, _known(self.solution)
        H, J, softness = self._kkt(here)
        units = _sizes(softness)
        before = bordered(nlp, H, J, softness, known)
        after = bordered(nlp, H + self._samples(here), J, softness, known)
        number, found = self.solution.term("samples"), []
        for step, direction in zip(SHARE * self.std, self._path.T, strict=True):
            ends = [here + sign * step * direction for sign in (1.0, -1.0)]
            ahead, behind = (self._matrix(end, units) for end in ends)
            change = _triplets((ahead - behind) / (2.0 * step))
            parts = before.traces(*change) - after.traces(*change)
            if nlp.evaluated.curved(number):
                ahead, behind = (self._samples(end) for end in ends)
                parts -= after.traces(*_triplets((ahead - behind) / (2.0 * step)))
            found.append(0.5 * float(np.sum(parts[~self.apart])))
        return np.array(found)

    def _kkt(self, decisions: Array) -> tuple[sp.csc_matrix, sp.csc_matrix, Array]:
        return self.solution.solver.kkt(decisions, self.solution.values, without=(self.solution.term("samples"),))

    def _matrix(self, decisions: Array, units: Array) -> sp.csc_matrix:
        """One triangle of K_0 but for its softness, the rows of J in these units."""
        H, J, softness = self._kkt(decisions)
        return entries(self.solution.transcription.nlp, H, sp.csc_matrix(sp.diags(_sizes(softness) / units) @ J))

    def _samples(self, decisions: Array) -> sp.csc_matrix:
        """What the samples add to H."""
        s = self.solution
        evaluated = s.transcription.nlp.evaluated
        part = evaluated.linearised(s.term("samples"), s.values.scaled(decisions), s.values)
        return evaluated.upper(evaluated.squares([part]))

    @cached_property
    def _path(self) -> Array:
        """S (n + np, k)."""
        nlp, found = self.solution.transcription.nlp, self._curvature
        assert found is not None
        local, n = nlp.interpolation.local, nlp.trajectory_size
        path = np.zeros((nlp.size, len(self.moving)))
        path[nlp.index.T] = found.interval_covariance[:, :local, local + self.moving] @ np.linalg.inv(self.covariance)
        path[n + self.moving] = np.eye(len(self.moving))
        return path

    @cached_property
    def _curvature(self) -> Curvature | None:
        """With what does not move held."""
        held = self.solution.transcription.nlp.trajectory_size + self.still
        return self.solution.curvature_with(np.union1d(self._held, held)) if len(held) else self.whole

    @cached_property
    def whole(self) -> Curvature | None:
        """With all parameters free."""
        return self.solution.curvature if len(self._held) == len(self.solution.held) else self.solution.curvature_with(self._held)

    @property
    def _held(self) -> Index:
        """What of the trajectories cannot move."""
        return _held(self.solution)


def log_density_of_forces(solution: Solution) -> float:
    """1/2 log |det K_0| in the program's units, heavy terms in H: the largest density of trajectories that forces of their stds give.

    Raises numpy.linalg.LinAlgError where K_0 is singular.
    """
    H, J, softness = solution.solver.kkt(solution.solved.decisions, solution.values, without=(solution.term("samples"),))
    K_0, heavy = bordered(solution.transcription.nlp, H, J, softness, _known(solution)), softness[softness != 0]
    return 0.5 * (K_0.log_abs_determinant - float(np.sum(np.log(heavy))))


def _held(solution: Solution) -> Index:
    """What of the trajectories cannot move."""
    return solution.held[solution.held < solution.transcription.nlp.trajectory_size]


def _known(solution: Solution) -> Index:
    """That, the first states and the parameters: what K_0 supposes to be known."""
    t = solution.transcription
    return np.unique(np.concatenate([_held(solution), t.starts.ravel(), np.arange(t.nlp.trajectory_size, t.nlp.size)]))


def _triplets(matrix: sp.csc_matrix) -> tuple[Index, Index, Array]:
    there = sp.coo_matrix(matrix)
    return there.row.astype(np.int64), there.col.astype(np.int64), there.data


def _sizes(softness: Array) -> Array:
    """The units that rows of J were divided by (`Solver.kkt`)."""
    return np.asarray(1.0 / np.sqrt(np.where(softness > 0, softness, 1.0)), dtype=np.float64)
