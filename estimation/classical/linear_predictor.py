"""The predictions of a plant that is linear about a working point, as functions of parameters, noise densities and starts.

Unknowns: [p (np_free), log W of the places (nw or none), log V of all outputs but the first (ny - 1), x_0 of every recording]. All
variances are relative to that of the first output, which is estimated from the innovations.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from backsight.models import SolveError
from backsight.models.analysis import OperatingPoint
from backsight.models.errors import InputError

from ..problem import Problem
from ..results import OutputFit
from ..smoothing.horizons import output_stds
from ..validation.fit import output_fit
from ..wording import listed
from .kalman import Innovations, innovations
from .linear_plant import AffineStep, affine
from .sampling import held_inputs, uniform_step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
STEP = 1e-5  # of an unknown's size, for differences; working points are solved to 1e-12
SETTLING = 20  # samples over which a first density moves the outputs by their noise


class LinearPredictor:
    """Innovations of every fitted recording, and what follows from them."""

    def __init__(self, problem: Problem, point: OperatingPoint, *, with_forces: bool, room: float) -> None:
        dae, self.room = problem.dae, room
        self.problem, self.point = problem, point
        first = problem.fitted[0]
        self.outputs = [i for i, q in enumerate(dae.outputs) if q.name in first.outputs]
        self.names = [dae.outputs[i].name for i in self.outputs]
        for r in problem.fitted:
            if set(r.outputs) != set(first.outputs):
                raise InputError(f"{r.name}: zoh_prediction_error needs the same outputs in all recordings: {listed(self.names)}.")
        self.steps = [uniform_step(r, "zoh_prediction_error") for r in problem.fitted]
        self.y = [np.column_stack([r.outputs[name] for name in self.names]) for r in problem.fitted]
        self.u = [held_inputs(dae, r, "zoh_prediction_error") for r in problem.fitted]
        stds = output_stds(problem)[0]
        self.noise = np.array([np.mean([s[name] for s in stds]) for name in self.names])
        # what is known of the start of a recording is not known of a piece after a gap
        self.known = {} if any(r.part for r in problem.fitted) else problem.known_exactly
        self.free_states = [i for i, q in enumerate(dae.states) if q.name not in self.known]
        self.count = len(problem.free)
        self._plants: dict[bytes, list[AffineStep]] = {}
        self.density = np.zeros(len(dae.places))
        if with_forces:
            self._first_densities()
        self.forces = [int(j) for j in np.flatnonzero(self.density > 0)]
        self.logarithms = slice(self.count, self.count + len(self.forces) + len(self.names) - 1)
        self.unknowns = self.logarithms.stop + len(self.free_states) * len(self.y)
        infos = [dae.parameters[i] for i in problem.free]
        sizes = [max(abs(problem.values[i]), abs(info.nominal)) for i, info in zip(problem.free, infos, strict=True)]
        states = np.maximum(np.abs([dae.states[i].nominal for i in self.free_states]), 1e-12)
        self.units = np.concatenate([sizes, np.ones(self.logarithms.stop - self.count), np.tile(states, len(self.y))])

    def start(self) -> Array:
        """Guesses of the parameters, first densities, every start at the working point."""
        out = np.zeros(self.unknowns)
        out[: self.count] = self.problem.values[list(self.problem.free)]
        return out

    def innovations(self, v: Array) -> list[Innovations]:
        """Of every recording, in the units of the outputs, with covariances relative to the common variance."""
        plants = self._linear(v[: self.count])
        logs = v[self.logarithms]
        density = self.density.copy()
        density[self.forces] *= np.exp(logs[: len(self.forces)])
        R = np.diag((self.noise * np.exp(np.concatenate([[0.0], logs[len(self.forces) :]]))) ** 2)
        out = []
        for plant, y, u, x in zip(plants, self.y, self.u, self._starts(v, plants), strict=True):
            out.append(innovations(plant, y, u, plant.noise(density), R, x))
        return out

    def residuals(self, v: Array) -> Array:
        """prod det(L)^(1/m) L^-1 e of all samples; inf where the plant has no linear model."""
        try:
            found = self.innovations(v)
        except (SolveError, np.linalg.LinAlgError):
            return np.full(sum(y.size for y in self.y), np.inf)
        return np.concatenate([np.linalg.solve(i.L, i.e[:, :, None]).ravel() for i in found]) * self._volume(found)

    def scale(self, v: Array) -> float:
        """What turns a residual in units of its own deviation into the unit of `residuals`."""
        found = self.innovations(v)
        return float(np.sqrt(self._variance(found)) * self._volume(found))

    def deviations(self, v: Array, upper: Array, information: Array) -> Array:
        """Standard deviations of the parameters (np_free,) by Fisher's information, inf where it has none."""
        found = self.innovations(v)
        variance = self._variance(found)

        def whitened(w: Array) -> Array:
            e = [np.linalg.solve(i.L, j.e[:, :, None])[:, :, 0] for i, j in zip(found, self.innovations(w), strict=True)]
            return np.asarray(np.concatenate(e).ravel() / np.sqrt(variance))

        def spread(w: Array) -> Array:
            parts = []
            for i, j in zip(found, self.innovations(w), strict=True):
                M = np.linalg.solve(i.L, j.L)
                parts.append((M @ np.swapaxes(M, 1, 2)).reshape(len(M), -1))
            return np.asarray(np.concatenate(parts).ravel() / np.sqrt(2.0))

        # the common variance is one more unknown: it moves all of S alike
        rows = np.hstack([differences(spread, v, self.units, upper), spread(v)[:, None]])
        jacobian = np.vstack([np.pad(differences(whitened, v, self.units, upper), ((0, 0), (0, 1))), rows])
        units = np.concatenate([self.units, [1.0]])
        fisher = (jacobian * units).T @ (jacobian * units)
        fisher[: self.count, : self.count] += np.diag(information * units[: self.count] ** 2)
        # a deviation known to no better than the room that it has is not known: its row would be noise on a unit diagonal
        kept = np.ones(len(fisher), dtype=bool)
        kept[self.logarithms] = np.diag(fisher)[self.logarithms] > 1.0 / self.room**2
        fisher = fisher[np.ix_(kept, kept)]
        size = np.sqrt(np.maximum(np.diag(fisher), 1e-300))
        covariance = np.linalg.pinv(fisher / np.outer(size, size), rcond=1e-13, hermitian=True) / np.outer(size, size)
        return np.asarray(np.sqrt(np.diag(covariance))[: self.count] * self.units[: self.count])

    def fits(self, v: Array) -> dict[str, dict[str, OutputFit]]:
        """Of every recording and output, predicted from sample to sample."""
        met: dict[str, list[Array]] = {}
        for r, y, found in zip(self.problem.fitted, self.y, self.innovations(v), strict=True):
            met.setdefault(r.name, []).append(np.stack([y, y - found.e]))
        joined = {name: np.concatenate(parts, axis=1) for name, parts in met.items()}
        return {r: {name: output_fit(*both[:, :, i]) for i, name in enumerate(self.names)} for r, both in joined.items()}

    def described(self) -> str:
        """The working point in words."""
        return ", ".join(f"{name} = {value:.4g}" for name, value in {**self.point.x, **self.point.u}.items())

    def noise_notes(self, v: Array) -> tuple[str, ...]:
        """The deviations that were found."""
        size = np.sqrt(self._variance(self.innovations(v)))
        logs = v[self.logarithms]
        outputs = self.noise * np.exp(np.concatenate([[0.0], logs[len(self.forces) :]])) * size
        said = [f"{name} {s:.3g}" for name, s in zip(self.names, outputs, strict=True)]
        for j, log in zip(self.forces, logs, strict=False):
            place = self.problem.dae.places[j]
            said.append(f"{place.name} {self.density[j] * np.exp(log) * size:.3g} {place.unit}")
        return (f"Noise, std: {'; '.join(said)}.",)

    def _linear(self, theta: Array) -> list[AffineStep]:
        key = theta.tobytes()
        if key not in self._plants:
            values = self.problem.values.copy()
            values[list(self.problem.free)] = theta
            named = {
                p.name: float(x)
                for p, x in zip(self.problem.dae.parameters, values, strict=True)
                if not p.smoothing or p.name in self.problem.parameters
            }
            if len(self._plants) > 4 * self.count + 4:
                self._plants.clear()
            by_step = {h: affine(self.problem.dae, self.point, named, h, self.outputs) for h in dict.fromkeys(self.steps)}
            self._plants[key] = [by_step[h] for h in self.steps]
        return self._plants[key]

    def _starts(self, v: Array, plants: list[AffineStep]) -> list[Array]:
        given = np.array([self.known.get(q.name, 0.0) for q in self.problem.dae.states])
        out = []
        for plant, free in zip(plants, v[self.logarithms.stop :].reshape(len(self.y), -1), strict=True):
            x = given - plant.at
            x[self.free_states] = free
            out.append(x)
        return out

    def _first_densities(self) -> None:
        """Forces that, each alone, move some output by its noise within SETTLING samples; zero at places that no output feels."""
        plant = self._linear(self.problem.values[list(self.problem.free)])[0]
        given = self.problem.weights.W
        for j, (Q, place) in enumerate(zip(plant.unit_noise, self.problem.dae.places, strict=True)):
            P = np.zeros_like(Q)
            for _ in range(SETTLING):
                P = plant.F @ P @ plant.F.T + Q
            felt = float(np.max(np.sqrt(np.maximum(np.diag(plant.C @ P @ plant.C.T), 0.0)) / self.noise))
            self.density[j] = given.get(place.name, 1.0 / felt) if felt > 0 else 0.0

    def _count(self) -> int:
        return max(1, int(sum(np.isfinite(y).sum() for y in self.y)))

    def _volume(self, found: list[Innovations]) -> float:
        logarithm = sum(float(np.sum(np.log(np.diagonal(i.L, axis1=1, axis2=2)))) for i in found)
        return float(np.exp(logarithm / self._count()))

    def _variance(self, found: list[Innovations]) -> float:
        """The common variance, mean |L^-1 e|^2."""
        return float(sum(np.sum(np.linalg.solve(i.L, i.e[:, :, None]) ** 2) for i in found) / self._count())


def differences(function: Callable[[Array], Array], v: Array, units: Array, upper: Array) -> Array:
    """Derivatives of a function (m,) of v (n,) by forward differences, (m, n); backward at an upper bound."""
    base = function(v)
    out = np.empty((len(base), len(v)))
    for k in range(len(v)):
        moved = v.copy()
        step = STEP * max(abs(v[k]), 1e-1 * units[k])
        moved[k] += step if v[k] + step <= upper[k] else -step
        out[:, k] = (function(moved) - base) / (moved[k] - v[k])
    return out
