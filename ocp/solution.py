"""A solved program read back in the terms of the model: states, outputs and residual forces at the samples, with deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .curvature import Curvature, curvature, determined_variance
from .forces import Forces
from .ipopt import Solver
from .linear import bridge_variance
from .nlp import Values
from .polynomials import Array
from .readout import read
from .solved import Solved
from .transcription import Transcription


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """Estimates at the n samples of one horizon; standard deviations have the shapes of their values.

    A standard deviation is inf where the data do not determine the value, and NaN where the solution is no minimum.

    states (n, nx), outputs (n, ny), forces (n, n_soft): what the mesh resolves of the residual forces.
    """

    time: Array
    states: Array
    states_std: Array
    outputs: Array
    outputs_std: Array
    forces: Array
    forces_std: Array


@dataclass(frozen=True, kw_only=True)
class Solution:
    """What a solve gave. Readable whatever its status; standard deviations exist where the unknowns are determined."""

    transcription: Transcription
    solver: Solver
    values: Values
    solved: Solved

    @property
    def parameters(self) -> Array:
        """All parameters of the model, the free ones estimated; (np_all,)."""
        out = self.values.parameters.copy()
        out[list(self.transcription.nlp.free)] = self.solved.decisions[self.transcription.nlp.trajectory_size :]
        return out

    @cached_property
    def curvature(self) -> Curvature | None:
        """Covariances from the Gauss-Newton KKT matrix; None where it is not that of a minimum."""
        return self.curvature_with(self.held)

    def curvature_with(self, known: NDArray[np.int64]) -> Curvature | None:
        """The same with other decisions that cannot move."""
        hessian, jacobian, softness = self.solver.kkt(self.solved.decisions, self.values)
        if not (np.isfinite(hessian.data).all() and np.isfinite(jacobian.data).all()):
            return None
        try:
            found = curvature(self.transcription.nlp, hessian, jacobian, softness, self.values.unit, known)
        except np.linalg.LinAlgError:
            return None
        return found if found.definite else None

    @property
    def determined(self) -> bool:
        """Whether the data determine all unknowns: the solution is a strict minimum."""
        return self.curvature is not None and not len(self.curvature.null)

    @cached_property
    def interval_covariance(self) -> Array:
        """Covariance of the local unknowns and parameters of every interval, given the null directions; NaN without a minimum."""
        return self._without_minimum(2) if self.curvature is None else self.curvature.interval_covariance

    @property
    def interval_null(self) -> Array:
        """The null directions at every interval (`Curvature`)."""
        return np.empty((*self._without_minimum(1).shape, 0)) if self.curvature is None else self.curvature.interval_null

    def _without_minimum(self, dimensions: int) -> Array:
        nlp = self.transcription.nlp
        return np.broadcast_to(np.nan, (len(nlp.steps), *(nlp.interpolation.local + len(nlp.free),) * dimensions))

    @cached_property
    def rows(self) -> list[Array]:
        """Scaled rows r of every term."""
        return self.solver.rows(self.solved.decisions, self.values)

    @cached_property
    def forces(self) -> Forces:
        """Residual forces."""
        return Forces(self)

    def term(self, name: str) -> int:
        """Number of the term called `name`."""
        return [t.name for t in self.transcription.nlp.terms].index(name)

    def jacobian_of_rows(self, number: int) -> Array:
        """Derivative of a term's values m in local unknowns and parameters, (C, K m, local + np)."""
        return self.solver.jacobian_of_rows(number, self.solved.decisions, self.values)

    def leverage(self, number: int) -> Array:
        """Variance, given the data and the null directions, of a term's values m, not scaled; (K m, C)."""
        if number not in self._leverages:  # every family of its rows asks for it
            J = self.jacobian_of_rows(number)
            C = self.interval_covariance[self.transcription.nlp.terms[number].interval]
            self._leverages[number] = np.asarray(np.einsum("rmi,rmi->mr", J @ C, J), dtype=np.float64)
        return self._leverages[number]

    @cached_property
    def _leverages(self) -> dict[int, Array]:
        return {}

    def variance(self, number: int) -> Array:
        """Variance, given the data, of a term's values m, not scaled; inf where they do not determine it; (K m, C)."""
        null = self.jacobian_of_rows(number) @ self.interval_null[self.transcription.nlp.terms[number].interval]
        return determined_variance(self.leverage(number), np.swapaxes(null, 0, 1))

    def outputs(self, number: int) -> Array:
        """Outputs at all samples of horizon `number`, also the missing ones, (ny, n)."""
        moved = read(self.transcription, number, self.solved.decisions, self.parameters).moved_outputs
        return self._polynomial_outputs[:, self._part(number)] + moved

    def sampled(self, number: int) -> Sampled:
        """Estimates at the samples of horizon `number`."""
        t = self.transcription
        horizon, ip = t.horizons[number], t.nlp.interpolation
        at = read(t, number, self.solved.decisions, self.parameters)
        part, samples = self._part(number), self.term("samples")
        # white forces drive the states between the knots also beyond the moments that the mesh resolves
        spread = bridge_variance(horizon.mesh, t.degree, at.interval - t.offsets[number], at.tau)
        density = (t.force_std_at(self.values)[:, at.interval] ** 2).T * spread[:, None]
        beyond = np.einsum("nij,nj->ni", at.linear.G**2, density)
        beyond_outputs = np.einsum("nij,nj->ni", (at.linear.C @ at.linear.G) ** 2, density)
        T = ip.matrix(at.basis)[:, ip.states : 2 * ip.states]
        C = self.interval_covariance[at.interval][:, : ip.local, : ip.local]
        null = T @ self.interval_null[at.interval][:, : ip.local]
        states = determined_variance(np.einsum("nij,nij->ni", T @ C, T), null) + beyond
        outputs = self.variance(samples)[:, part].T + beyond_outputs
        force, force_std = self.forces.at_samples(number)
        return Sampled(
            time=horizon.time,
            states=(at.x + at.moved).T,
            states_std=np.sqrt(np.maximum(states, 0.0)),
            outputs=(self._polynomial_outputs[:, part] + at.moved_outputs).T,
            outputs_std=np.sqrt(np.maximum(outputs, 0.0)),
            forces=force,
            forces_std=force_std,
        )

    @property
    def parameters_on_bounds(self) -> NDArray[np.int64]:
        """Which of the free parameters ended on a bound."""
        n = self.transcription.nlp.trajectory_size
        return np.array([k - n for k in self.solved.on_bound if k >= n], dtype=np.int64)

    @property
    def held(self) -> NDArray[np.int64]:
        """Decisions that cannot move: initial states with standard deviation zero, and what is held by a bound."""
        exact = np.array([h.initial_std == 0 for h in self.transcription.horizons])
        return np.union1d(self.transcription.starts[exact], np.array(self.solved.on_bound, dtype=np.int64)).astype(np.int64)

    def _part(self, number: int) -> slice:
        """The samples of one horizon among all."""
        first = sum(len(h.time) for h in self.transcription.horizons[:number])
        return slice(first, first + len(self.transcription.horizons[number].time))

    @cached_property
    def _polynomial_outputs(self) -> Array:
        """Outputs of the polynomials at all samples, also the missing ones, (ny, all samples)."""
        samples = self.term("samples")
        ones = tuple(np.ones_like(s) if i == samples else s for i, s in enumerate(self.values.scale))
        zeros = tuple(np.zeros_like(s) if i == samples else s for i, s in enumerate(self.values.target))
        return self.solver.rows(self.solved.decisions, replace(self.values, scale=ones, target=zeros))[samples]
