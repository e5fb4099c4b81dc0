"""A smoothed problem on its mesh, with every weight on a knob of its own: log of the factor on its standard deviation.

    r_f -> r_f exp(-theta_f),        r_f the rows of the cost that weight f scales

What differs between two solves is then the weights alone, and not a mesh that was chosen for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from backsight.models.augmentation import stationary_std
from backsight.models.augmentation.parameters import case_name
from backsight.models.errors import InputError
from backsight.ocp import Solution, Status
from backsight.ocp.nlp import Values

from ..problem import Problem
from ..results import Smoothing
from ..smoothing.marginal import released
from ..smoothing.program import Program
from ..smoothing.rest import near_rest
from ..smoothing.robust import RobustSolution
from ..supposed import INPUT, PARAMETER
from ..wording import per_root_bandwidth

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = NDArray[np.bool_]
Kind = Literal["W", "V", "drift", "prior"]

TOLERANCE = 1e-3  # of a solve at other weights: on its gradient, with every unknown in deviations that it would have by itself


@dataclass(frozen=True, kw_only=True)
class Weight:
    """One entry of W or V, the rate of drift of a parameter, or all priors of the parameters: its name, std in force and unit.

    row: among the soft places, or of an output among the model's; measured_input: V of an input, which acts as a residual force does.
    own: of an output whose noise differs between recordings, "<output> [<recording>]" -> std there, turned together; std is their rms.
    Priors are turned together, and their std is the factor on them.
    """

    name: str
    kind: Kind
    std: float
    unit: str
    row: int
    measured_input: bool = False
    own: tuple[tuple[str, float], ...] = ()

    @property
    def is_noise(self) -> bool:
        """Whether it scales samples of an output."""
        return self.kind == "V" and not self.measured_input

    @property
    def label(self) -> str:
        """W of drive_1, V of x_r, drift of bha.d."""
        return f"{self.kind} of {self.name}"

    @property
    def is_component(self) -> bool:
        """Whether it says how large something random is, which the data may tell; a prior is what is known without them."""
        return self.kind != "prior"


@dataclass(frozen=True, kw_only=True)
class Turned:
    """The program of a solution and its weights (F,).

    coloured: place -> rows of the initial state that its std scales too, because a coloured force starts stationary. outliers: how many
    samples a robust loss took for far off. They are left out, and all others are squares: so much the same at all weights, of which the
    likelihoods could not be compared if each had outliers of its own. bent: whether the likelihood is taken at the parameters of most
    marginal likelihood, which are others than those most probable together with a trajectory (`likelihood.py`).
    """

    program: Program
    weights: tuple[Weight, ...]
    coloured: dict[int, tuple[int, ...]]
    outliers: int = 0
    bent: bool = False

    def solve(
        self, theta: Array, start: Array | None = None, *, newton: bool = False, say: Callable[[str], None] | None = None
    ) -> Solution:
        """The problem solved with log factors theta (F,) on the standard deviations, from decisions `start` (n + np,)."""
        begin = self.program.start if start is None else start
        return self.program.solve(begin, self.values(theta), newton, say or (lambda _: None))

    def solved(self, theta: Array, start: Array | None = None) -> Solution:
        """The same to TOLERANCE, with exact second derivatives where steps of Gauss and Newton do not suffice."""
        program, values = self._roughly, self.values(theta)
        found = program.solve(program.start if start is None else start, values, False, lambda _: None)
        if found.solved.status is not Status.ITERATIONS:
            return found
        return program.solve(found.solved.decisions, values, True, lambda _: None)

    def along(self, theta: Array, near: Solution) -> Solution:
        """The most probable trajectories at the parameters of a solution with other weights, as one in which these are free."""
        program = replace(self._roughly, start=near.solved.decisions).held
        return released(program.solve(program.start, self.values(theta), True, lambda _: None), near.solved.on_bound)

    @cached_property
    def _roughly(self) -> Program:
        solver = self.program.solver
        return replace(self.program, solver=replace(solver, options=replace(solver.options, tolerance=TOLERANCE)))

    def with_parameters(self, found: Mapping[str, float]) -> Turned:
        """The same with other values of the parameters that are not estimated here, by name."""
        t, values = self.program.transcription, self.program.values.parameters.copy()
        for i, info in enumerate(t.dae.parameters):
            if i not in t.nlp.free:
                values[i] = found.get(info.name, values[i])
        return replace(self, program=replace(self.program, values=replace(self.program.values, parameters=values)))

    @property
    def noise(self) -> Mask:
        """Which weights are noise of a sensor, (F,)."""
        return np.array([w.is_noise for w in self.weights], dtype=np.bool_)

    @property
    def moving(self) -> Mask:
        """Intervals of every soft place that are not near rest, (n_soft, N)."""
        return ~self._rests

    def stds(self, theta: Array) -> dict[str, float]:
        """Weight, by its label -> std at theta."""
        return {w.label: w.std * float(np.exp(v)) for w, v in zip(self.weights, theta, strict=True)}

    def values(self, theta: Array) -> Values:
        """The program's numbers at theta."""
        t, values = self.program.transcription, self.program.values
        force, noise = self._factors(theta)
        scale = [s.copy() for s in t.with_force_std(values, self._std(force) / self._standing).scale]
        prior = [v for w, v in zip(self.weights, theta, strict=True) if w.kind == "prior"]
        for number, term in enumerate(t.nlp.terms):
            if term.name == "parameter prior":
                scale[number] /= np.exp(sum(prior))
            if term.name == "samples":
                scale[number] /= noise[:, None]
            if term.name == "initial state":
                for i, rows in self.coloured.items():
                    scale[number][list(rows)] /= force[i]
        return replace(values, scale=tuple(scale))

    def rows(self, f: int, theta: Array) -> list[tuple[int, Mask]]:
        """The rows that weight f scales at theta: (number of the term, which of its rows (K m, C))."""
        weight, t, found = self.weights[f], self.program.transcription, []
        for number, term in enumerate(t.nlp.terms):
            of = np.zeros(term.target.shape, dtype=np.bool_)
            if weight.kind == "prior":
                of[:] = term.name == "parameter prior"
            elif weight.is_noise and term.name == "samples":
                of[weight.row] = True
            elif not weight.is_noise and term.name == t.force_term:
                force, _ = self._factors(theta)
                of[weight.row :: len(t.soft)] = ~self._rests[weight.row] | (self._std(force) > self._standing)[weight.row]
            elif not weight.is_noise and term.name == "initial state" and weight.row in self.coloured:
                of[list(self.coloured[weight.row])] = True
            if of.any():
                found.append((number, of))
        return found

    def _factors(self, theta: Array) -> tuple[Array, Array]:
        """Factors on the stds of the soft places and of the outputs."""
        t = self.program.transcription
        force, noise = np.ones(len(t.soft)), np.ones(len(t.dae.outputs))
        for weight, value in zip(self.weights, theta, strict=True):
            if weight.kind == "prior":
                continue
            (noise if weight.is_noise else force)[weight.row] = np.exp(value)
        return force, noise

    def _std(self, force: Array) -> Array:
        """Standard deviations of the residual forces, (n_soft, N): near rest they keep their room, unless all have more."""
        return np.where(self._rests, np.maximum(self._standing, force[:, None] * self._elsewhere), force[:, None] * self._standing)

    @cached_property
    def _standing(self) -> Array:
        return self.program.transcription.force_std_at(self.program.values)

    @cached_property
    def _rests(self) -> Mask:
        rests = near_rest(self._standing)
        return np.asarray(rests & ~rests.all(axis=1, keepdims=True), dtype=np.bool_)

    @cached_property
    def _elsewhere(self) -> Array:
        """Of every soft place the usual standard deviation away from rest, (n_soft, 1)."""
        return np.array([[np.median(std[~rests])] for std, rests in zip(self._standing, self._rests, strict=True)]).reshape(-1, 1)


def turned(problem: Problem, result: Smoothing) -> Turned:
    """The knobs of a smoothed problem. Raises InputError where there is no solution to begin with."""
    solution, in_force = result.solution, result.weights
    if solution is None or not result.solver.converged:
        raise InputError(f"weigh: the study cannot begin, because smoothing did not converge ({result.solver.status.rstrip('.')}).")
    t, posed, outliers = solution.transcription, problem.posed, 0
    if isinstance(solution, RobustSolution):
        there = solution.values.scale[solution.term("samples")] > 0
        outliers, solution = int(np.count_nonzero(solution.far & there)), solution.without_outliers
    program = replace(Program.at(posed, solution), losses=None)
    weights, coloured, names = [], {}, [q.name for q in posed.dae.states]
    for row, k in enumerate(t.soft):
        place = posed.dae.places[k]
        if place.name.startswith(INPUT):
            name = place.name.removeprefix(INPUT)
            weights.append(Weight(name=name, kind="V", std=in_force.V[name], unit=place.unit, row=row, measured_input=True))
        elif place.name.startswith(PARAMETER):
            name = place.name.removeprefix(PARAMETER)
            weights.append(Weight(name=name, kind="drift", std=posed.weights.W[place.name], unit=per_root_bandwidth(place.unit), row=row))
        else:
            name = place.name
            unit = place.unit if name in in_force.tau else per_root_bandwidth(place.unit)
            weights.append(Weight(name=name, kind="W", std=in_force.W[name], unit=unit, row=row))
            if name in in_force.tau:
                states = stationary_std(name, 1.0, in_force.tau[name], in_force.kind.get(name, "ou"))
                coloured[row] = tuple(names.index(state) for state in states)
    for row, q in enumerate(posed.dae.outputs):
        if q.name in in_force.V:
            own = tuple((case, in_force.V[case]) for r in problem.recordings if (case := case_name(q.name, r.name)) in in_force.V)
            weights.append(Weight(name=q.name, kind="V", std=in_force.V[q.name], unit=q.unit, row=row, own=own))
    if any(term.name == "parameter prior" for term in t.nlp.terms):
        weights.append(Weight(name="the parameters", kind="prior", std=1.0, unit="1", row=-1))
    return Turned(program=program, weights=tuple(weights), coloured=coloured, outliers=outliers)
