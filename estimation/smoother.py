"""Whole-horizon smoothing: states, residual forces and parameters of all recordings at once.

    recordings -> follow the samples -> mesh -> program -> weights left out (iterated) -> solution -> estimates
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from backsight.ocp import Horizon, Options, ParameterPrior, Solution, Solver, Transcription, transcribe
from backsight.ocp.bandwidth import fastest_rate
from backsight.ocp.follow import Followed, follow
from backsight.ocp.nlp import Values

from .horizons import make_horizon, output_stds, sample_density, sampling_interval
from .initial_guess import balance, smoothing_widths, start_decisions
from .outcome import outcome
from .problem import Free, Problem
from .results import Smoothing
from .variances import Choice, choose_weights

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

RESOLUTION = 0.5  # mesh step times the fastest mode of the smoother
LONGEST = 5.0  # mesh step over the sampling interval, at most
STIFF = 1e4  # scaled residual per conditional deviation of the trajectory beyond which the balances become constraints


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numerics of a smoothing run; the defaults choose by themselves.

    method: "spline", "collocation" or "auto". degree: K. step: mesh step [s]. options: of the solver.
    """

    method: Literal["auto", "spline", "collocation"] = "auto"
    degree: int = 2
    step: float | None = None
    options: Options = Options()


def smooth(problem: Problem, *, settings: Settings = Settings(), progress: Callable[[str], None] | None = None) -> Smoothing:  # noqa: B008
    """Smooth the fitted recordings of a problem.

    Weights that the problem leaves out are chosen from the data (`variances.py`). Returns the estimates even when the solver did not
    converge: `solver.converged` tells. Raises InputError for a problem that cannot be posed.
    """
    say = progress or (lambda _: None)
    began = time.perf_counter()
    dae = problem.dae
    stds, chosen_outputs = output_stds(problem)
    say("following the samples")
    step = LONGEST * min(sampling_interval(r) for r in problem.fitted)
    followed = follow(dae, _horizons(problem, stds, 2 * step), problem.values)
    parameters = problem.values
    for index, width in smoothing_widths(problem, followed).items():
        parameters[index] = width
    start = balance(problem, followed, parameters)
    given = {k: problem.weights.W[p.name] for k, p in enumerate(dae.places) if p.name in problem.weights.W}
    force_std = {**start.force_std, **given}
    if settings.step is None:
        step = min(step, _mesh_step(problem, followed, stds, force_std, parameters))
    say(f"mesh step {1e3 * (settings.step or step):.3g} ms")
    horizons = _horizons(problem, stds, settings.step or step)
    transcription = _transcribe(problem, horizons, force_std, settings)
    solver = Solver(transcription.nlp, settings.options)
    first = start_decisions(transcription, followed, start.parameters)
    values = transcription.nlp.values(parameters)
    values = replace(values, unit=_units(solver, first, values))
    lower, upper = _bounds(problem, transcription)
    build = time.perf_counter() - began

    def solve(decisions: Array, values: Values, newton: bool) -> Solution:
        solved = solver.solve(decisions, values, lower=lower, upper=upper, newton=newton, progress=say)
        return Solution(transcription=transcription, solver=solver, values=values, solved=solved)

    open_places = [k for k in transcription.soft if k not in given]
    choice = choose_weights(solve, first, values, transcription, open_places, chosen_outputs, say)
    return outcome(problem, choice, stds, build=build, seconds=time.perf_counter() - began - build)


def _horizons(problem: Problem, stds: list[dict[str, float]], step: float) -> list[Horizon]:
    return [make_horizon(problem.dae, r, std, problem.initial, step) for r, std in zip(problem.fitted, stds, strict=True)]


def _mesh_step(problem: Problem, followed: Followed, stds: list[dict[str, float]], force_std: dict[int, float], parameters: Array) -> float:
    """The step that resolves the fastest mode of the smoother in every recording."""
    step = np.inf
    for number, (recording, std) in enumerate(zip(problem.fitted, stds, strict=True)):
        horizon = followed.horizons[number]
        times = np.linspace(horizon.time[0], horizon.time[-1], 41)[1:-1]
        dx, x, z = followed.at(number, times)
        density = sample_density(problem.dae, recording, std)
        rate = fastest_rate(problem.dae, dx, x, z, horizon.input_at(times), parameters, force_std, density)
        step = min(step, RESOLUTION / rate if rate > 0 else np.inf)
        step = max(step, 0.25 * sampling_interval(recording))
    return step


def _transcribe(problem: Problem, horizons: list[Horizon], force_std: dict[int, float], settings: Settings) -> Transcription:
    free = [problem.parameters[problem.dae.parameters[i].name] for i in problem.free]
    known = [f.std if isinstance(f, Free) and f.std is not None else np.inf for f in free]
    prior = ParameterPrior(mean=problem.values[list(problem.free)], std=np.array(known, dtype=np.float64))
    method = "spline" if settings.method == "auto" else settings.method
    return transcribe(problem.dae, horizons, free=problem.free, prior=prior, force_std=force_std, method=method, degree=settings.degree)


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


def _units(solver: Solver, decisions: Array, values: Values) -> Array:
    """The unit of every decision: its deviation when all others are known, 1/sqrt(H_ii), the same for all copies of a variable.

    What the cost does not see gets the size of its start instead.
    """
    nlp = solver.nlp
    diagonal = solver.hessian(decisions, replace(values, gamma=0.0))[0].diagonal()
    n, stride = nlp.trajectory_size, nlp.interpolation.states + nlp.interpolation.interior
    unit = np.ones(nlp.size)
    for column in range(stride):
        where = nlp.index[column]
        seen = diagonal[where] > 0
        size = float(np.sqrt(np.mean(decisions[where] ** 2)))
        unit[where] = float(np.median(diagonal[where][seen] ** -0.5)) if seen.any() else size or 1.0
    last = np.setdiff1d(np.arange(n), nlp.index[:stride].ravel())
    for i in last:
        column = int(np.argwhere(nlp.index[stride:] == i)[0][0])
        unit[i] = unit[nlp.index[column, 0]]
    for k in range(n, nlp.size):
        size = abs(decisions[k]) or 1.0
        unit[k] = diagonal[k] ** -0.5 if diagonal[k] > 0 else size
    return unit
