"""From a solution to what the user reads: names, units, tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from backsight.models import ParameterInfo
from backsight.ocp import Solution

from .problem import Free, Problem, Weights
from .rest import ROOM
from .results import ParameterEstimate, ResidualSummary, Smoothing, SolverFacts
from .uncertainty import output_fit
from .unseen import unseen_states
from .variances import Choice

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

DETERMINED = 0.5  # a parameter counts as identified when its std is below this share of its size
NEGLIGIBLE = 0.05  # or of its nominal size, for one near zero that is not up against its physical bound


def outcome(problem: Problem, choice: Choice, stds: list[dict[str, float]], *, build: float, seconds: float) -> Smoothing:
    """The result object of a smoothing run."""
    dae, solution = problem.dae, choice.solution
    t, solved = solution.transcription, solution.solved
    determined = solution.determined
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
    notes = _notes(problem, choice, stds)
    if not determined and problem.free:
        notes += (
            "The recordings do not determine the unknowns: no deviations are given. Fix a parameter, give it a std, or use a richer "
            "recording.",
        )
    return Smoothing(
        model=dae.name,
        parameters=_parameters(problem, solution, determined),
        estimates=estimates,
        inputs={r.name: dict(r.inputs) for r in problem.fitted},
        units=_units(problem),
        fit=fit,
        weights=Weights(
            W={**problem.weights.W, **{dae.places[k].name: float(s) for k, s in zip(t.soft, choice.force_std, strict=True)}},
            V={q.name: std * float(choice.output_factor[i]) for i, q in enumerate(dae.outputs) if (std := _first_std(q.name, stds))},
        ),
        solver=SolverFacts(
            status=solved.status.value,
            converged=solved.status.converged,
            iterations=choice.iterations,
            seconds=seconds,
            build_seconds=build,
            variables=t.nlp.size,
        ),
        residual_places=_residuals(problem, estimates),
        notes=notes,
    )


def _parameters(problem: Problem, solution: Solution, determined: bool) -> dict[str, ParameterEstimate]:
    values = solution.parameters
    covariance = solution.curvature.parameter_covariance if determined and solution.curvature else np.full((len(problem.free),) * 2, np.nan)
    variance = np.diag(covariance)
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


def _first_std(output: str, stds: list[dict[str, float]]) -> float | None:
    """An output's noise in the first recording that has it."""
    return next((table[output] for table in stds if output in table), None)


def _share_with_room(solution: Solution) -> float:
    std = solution.transcription.force_std_at(solution.values)
    return float(np.mean(np.any(std > 2.0 * std.min(axis=1, keepdims=True), axis=0))) if std.size else 0.0


def _notes(problem: Problem, choice: Choice, stds: list[dict[str, float]]) -> tuple[str, ...]:
    """How every weight came about, in a sentence each."""
    dae, t, notes = problem.dae, choice.solution.transcription, []
    held = [r.name for r in problem.recordings if r.role == "held_out"]
    if held:
        notes.append(f"Held out, and not used for smoothing: {', '.join(held)}.")
    for i, info in enumerate(dae.parameters):
        if info.smoothing and info.name not in problem.parameters and choice.solution.parameters[i] != info.value:
            notes.append(f"{info.name} was chosen: {choice.solution.parameters[i]:.3g} {info.unit}, one percent of the rms velocity there.")
    unseen = unseen_states(problem)
    if unseen and problem.free:
        notes.append(f"No output shows {', '.join(unseen)}: it started from the model at the guesses, on which the answer may depend.")
    if not t.soft and dae.places:
        notes.append("W leaves the residual forces no room: every balance was made to hold exactly.")
    for k, s in zip(t.soft, choice.force_std, strict=True):
        place = dae.places[k]
        if place.name in problem.weights.W:
            notes.append(f"W of {place.name}: std {s:.3g} {place.unit} as given.")
        else:
            end = "" if choice.settled else "; it had not settled"
            notes.append(f"W of {place.name}: std {s:.3g} {place.unit} from what the fit leaves over, iterated {choice.rounds} times{end}.")
    for k in choice.solution.solved.on_bound:
        if k >= t.nlp.trajectory_size:
            info = dae.parameters[t.nlp.free[k - t.nlp.trajectory_size]]
            value = choice.solution.solved.decisions[k]
            notes.append(
                f"{info.name} ended on its bound, {value:.6g} {info.unit}: the data pull beyond it, and all other values and deviations "
                "suppose that it is right."
            )
    share = _share_with_room(choice.solution)
    if share > 0:
        notes.append(
            f"Near rest, in {100 * share:.1f} % of the mesh, a friction law is least certain: W gives it {ROOM:.0f} times the room "
            "there, and these stretches say hardly anything about the parameters."
        )
    for i, q in enumerate(dae.outputs):
        first = _first_std(q.name, stds)
        if first is None:
            continue
        std = first * choice.output_factor[i]
        given = q.name in problem.weights.V or all(r.output_std.get(q.name) is not None for r in problem.fitted if q.name in r.outputs)
        rule = "as given" if given else "from the samples' differences, then from what the fit leaves over"
        notes.append(f"V of {q.name}: std {std:.3g} {q.unit} {rule}.")
    return tuple(notes)
