"""From a solution to what the user reads: names, units, tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from backsight.models import ParameterInfo
from backsight.ocp import Solution

from ..fit import output_fit
from ..problem import Free, Problem, Weights
from ..results import ParameterEstimate, ResidualSummary, Smoothing, SolverFacts
from .notes import notes
from .variances import Choice

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

DETERMINED = 0.5  # a parameter counts as identified when its std is below this share of its size
NEGLIGIBLE = 0.05  # or of its nominal size, for one near zero that is not up against its physical bound


@dataclass(frozen=True, kw_only=True)
class Run:
    """A solved smoothing problem.

    stds, open_outputs: per recording, the outputs' standard deviations that `choice.output_factor` multiplies, and those that nobody gave.
    remeshed: whether the weights asked for a second mesh. mesh_error: output -> error that the mesh leaves, in units of its noise.
    """

    choice: Choice
    stds: list[dict[str, float]]
    open_outputs: tuple[set[str], ...]
    remeshed: bool
    mesh_error: Mapping[str, float]

    def noise(self, number: int, output: str, index: int) -> float:
        """Standard deviation in force of an output, the `index`-th of the model, in recording `number`."""
        return self.stds[number][output] * float(self.choice.output_factor[number, index])


NO_MINIMUM = "Ended on no minimum: give better guesses, more room in W, or fewer free parameters."


def outcome(problem: Problem, run: Run, *, build: float, seconds: float) -> Smoothing:
    """The result object of a smoothing run."""
    choice = run.choice
    dae, solution = problem.dae, choice.solution
    t, solved = solution.transcription, solution.solved
    estimates, fit = {}, {}
    for number, recording in enumerate(problem.fitted):
        s = solution.sampled(number)
        columns: dict[str, Array] = {"t_s": recording.time}
        fits = {}
        for i, q in enumerate(dae.outputs):
            columns[q.name] = s.outputs[:, i]
            if q.name in recording.outputs:
                columns[f"{q.name}.measured"] = recording.outputs[q.name]
                fits[q.name] = output_fit(recording.outputs[q.name], s.outputs[:, i])
            columns[f"{q.name}.std"] = s.outputs_std[:, i]
        for i, q in enumerate(dae.states):
            columns[q.name], columns[f"{q.name}.std"] = s.states[:, i], s.states_std[:, i]
        for k, place in enumerate(dae.places):
            name = f"residual.{place.name}"
            if k in t.soft:
                i = t.soft.index(k)
                columns[name], columns[f"{name}.std"] = s.forces[:, i], s.forces_std[:, i]
            else:
                # so little freedom that the data cannot say anything about it: what is known is what was supposed
                step = t.horizons[number].mesh.steps.mean()
                columns[name] = np.zeros(len(recording.time))
                columns[f"{name}.std"] = np.full(len(recording.time), problem.weights.W.get(place.name, 0.0) / np.sqrt(step))
        estimates[recording.name], fit[recording.name] = pd.DataFrame(columns), fits
    return Smoothing(
        model=dae.name,
        parameters=_parameters(problem, solution),
        estimates=estimates,
        inputs={r.name: dict(r.inputs) for r in problem.fitted},
        units=_units(problem),
        fit=fit,
        weights=Weights(
            W={**problem.weights.W, **{dae.places[k].name: float(s) for k, s in zip(t.soft, choice.force_std, strict=True)}},
            V={q.name: run.noise(first, q.name, i) for i, q in enumerate(dae.outputs) if (first := _first(q.name, run)) is not None},
        ),
        solver=SolverFacts(
            status=solved.status.value if solution.curvature is not None else NO_MINIMUM,
            converged=solved.status.converged and solution.curvature is not None,
            iterations=choice.iterations,
            seconds=seconds,
            build_seconds=build,
            variables=t.nlp.size,
        ),
        residual_places=_residuals(problem, estimates),
        notes=notes(problem, run),
    )


def _parameters(problem: Problem, solution: Solution) -> dict[str, ParameterEstimate]:
    values = solution.parameters
    variance = np.full(len(problem.free), np.nan) if solution.curvature is None else solution.curvature.parameter_variance
    std = dict(zip(problem.free, np.sqrt(np.maximum(variance, 0.0)), strict=True))
    out = {}
    for i, info in enumerate(problem.dae.parameters):
        given = problem.parameters.get(info.name)
        free = isinstance(given, Free)
        s = float(std[i]) if free and np.isfinite(std[i]) and std[i] > 0 else None
        out[info.name] = ParameterEstimate(
            name=info.name,
            value=float(values[i]),
            std=s,
            unit=info.unit,
            fixed=not free,
            identifiable=_identified(float(values[i]), s, info) if free else None,
            guess=given.guess if isinstance(given, Free) else None,
        )
    return out


def _identified(value: float, std: float | None, info: ParameterInfo) -> bool:
    if std is None:
        return False
    bounded = min(value - info.minimum, info.maximum - value) < 3.0 * std
    return std < DETERMINED * abs(value) or (std < NEGLIGIBLE * info.nominal and not bounded)


def _units(problem: Problem) -> dict[str, str]:
    dae = problem.dae
    units = {"t_s": "s"}
    for q in (*dae.inputs, *dae.outputs, *dae.states):
        units[q.name] = q.unit
    for place in dae.places:
        units[f"residual.{place.name}"] = place.unit
    return units


def _residuals(problem: Problem, estimates: dict[str, pd.DataFrame]) -> dict[str, ResidualSummary]:
    out = {}
    for place in problem.dae.places:
        values = np.concatenate([table[f"residual.{place.name}"].to_numpy() for table in estimates.values()])
        out[place.name] = ResidualSummary(place=place.name, unit=place.unit, rms=float(np.sqrt(np.mean(values**2))), origin=place.origin)
    return out


def _first(output: str, run: Run) -> int | None:
    """The first recording that has an output."""
    return next((k for k, table in enumerate(run.stds) if output in table), None)
