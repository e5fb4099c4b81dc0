"""Whole-horizon smoothing: states, residual forces and parameters of all recordings at once.

recordings -> follow the samples -> mesh -> program -> weights left out (iterated) -> solution -> estimates
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from backsight.ocp import Options, ParameterPrior, Solution, Solver, Transcription, transcribe
from backsight.ocp.follow import follow
from backsight.ocp.nlp import Values
from backsight.ocp.readout import read
from backsight.ocp.scaling import scaled

from .horizons import make_horizon, output_stds
from .initial_guess import balance, start_decisions
from .meshing import Meshed, longest_step, mesh
from .outcome import outcome
from .problem import Free, Problem
from .rest import friction_laws, room, smoothing_widths
from .results import Smoothing
from .unseen import complete, unseen_states
from .variances import choose_weights

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numerics of a smoothing run; the defaults choose by themselves.

    method: "spline", "collocation" or "auto". degree: K, by itself 2 for splines and 3 for
    collocation. step: mesh step [s]. options: of the solver.
    """

    method: Literal["auto", "spline", "collocation"] = "auto"
    degree: int | None = None
    step: float | None = None
    options: Options = field(default_factory=Options)


def smooth(problem: Problem, *, settings: Settings = Settings(), progress: Callable[[str], None] | None = None) -> Smoothing:
    """Smooth the fitted recordings of a problem.

    Weights that the problem leaves out are chosen from the data (`variances.py`). Returns the estimates even when the solver did not
    converge: `solver.converged` tells. Raises InputError for a problem that cannot be posed.
    """
    say = progress or (lambda _: None)
    began = time.perf_counter()
    dae = problem.dae
    stds, chosen_outputs = output_stds(problem)
    say("following the samples")
    followed = follow(
        dae,
        [make_horizon(dae, r, std, problem.initial, 2 * longest_step(r)) for r, std in zip(problem.fitted, stds, strict=True)],
        problem.values,
    )
    parameters = problem.values
    laws = friction_laws(problem)
    if unseen_states(problem):
        say("starting what no output shows")
        followed = complete(problem, followed, laws)
    for index, width in smoothing_widths(problem, laws, followed).items():
        parameters[index] = width
    start = balance(problem, followed, parameters)
    given = {k: problem.weights.W[p.name] for k, p in enumerate(dae.places) if p.name in problem.weights.W}
    force_std = {**start.force_std, **given}
    meshed = mesh(problem, followed, stds, force_std, start.parameters, settings.degree or 2, settings.step)
    say(f"mesh of {sum(h.mesh.count for h in meshed.horizons)} intervals")
    rigid = meshed.rigid and set(given) == set(start.force_std)
    transcription = _transcribe(problem, meshed, {} if rigid else force_std, settings)
    solver = Solver(transcription.nlp, settings.options)
    first = start_decisions(transcription, followed, start.parameters)
    values = _with_fine_input(transcription, first, start.parameters, transcription.nlp.values(parameters))
    knots = [h.mesh.knots for h in transcription.horizons]
    values = transcription.with_force_std(values, room(problem, laws, followed, knots, transcription.soft, start.parameters))
    values = scaled(solver, first, values)
    lower, upper = _bounds(problem, transcription)
    build = time.perf_counter() - began

    def solve(decisions: Array, values: Values, newton: bool) -> Solution:
        solved = solver.solve(decisions, values, lower=lower, upper=upper, newton=newton, progress=say)
        here = transcription.nlp.about(values, solved.decisions)
        return Solution(transcription=transcription, solver=solver, values=here, solved=solved)

    open_places = [k for k in transcription.soft if k not in given]
    choice = choose_weights(solve, first, values, transcription, open_places, chosen_outputs, meshed.least_std, say)
    return outcome(problem, choice, stds, build=build, seconds=time.perf_counter() - began - build)


def _transcribe(problem: Problem, meshed: Meshed, force_std: dict[int, float], settings: Settings) -> Transcription:
    free = [problem.parameters[problem.dae.parameters[i].name] for i in problem.free]
    known = [f.std if isinstance(f, Free) and f.std is not None else np.inf for f in free]
    prior = ParameterPrior(mean=problem.values[list(problem.free)], std=np.array(known, dtype=np.float64))
    # without residual forces every balance is a constraint, which is what collocation is for
    method = settings.method if settings.method != "auto" else "spline" if force_std else "collocation"
    degree = settings.degree or (2 if method == "spline" else 3)
    return transcribe(problem.dae, meshed.horizons, free=problem.free, prior=prior, force_std=force_std, method=method, degree=degree)


def _with_fine_input(transcription: Transcription, decisions: Array, parameters: Array, values: Values) -> Values:
    """Targets less what the input's fine structure adds to the outputs between the knots: the polynomials need not follow it.

    It is a small share of the noise (`meshing.py` sees to that), so the first trajectory and parameters are good enough to compute it.
    """
    parts = [read(transcription, k, decisions, parameters).moved_outputs for k in range(len(transcription.horizons))]
    moved = np.hstack(parts)
    targets = tuple(y - moved if t.name == "samples" else y for t, y in zip(transcription.nlp.terms, values.target, strict=True))
    return replace(values, target=targets)


def _bounds(problem: Problem, transcription: Transcription) -> tuple[Array, Array]:
    """Bounds of all decisions: parameters within their own and the physical ones, known initial states fixed."""
    nlp, dae = transcription.nlp, problem.dae
    lower, upper = np.full(nlp.size, -np.inf), np.full(nlp.size, np.inf)
    for k, i in enumerate(problem.free):
        free = problem.parameters[dae.parameters[i].name]
        if isinstance(free, Free):
            lower[nlp.trajectory_size + k] = max(free.min, dae.parameters[i].minimum)
            upper[nlp.trajectory_size + k] = min(free.max, dae.parameters[i].maximum)
    for start, horizon in zip(transcription.starts, transcription.horizons, strict=True):
        known = horizon.initial_std == 0
        lower[start[known]] = upper[start[known]] = horizon.initial[known]
    return lower, upper
