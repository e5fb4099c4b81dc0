"""What every classical method gives back: parameters with deviations, and how well its model meets the samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from backsight.models import SolveError, Trajectory
from backsight.models.errors import InputError

from ..problem import Problem
from ..recordings.drive import run as run_under_inputs
from ..recordings.recording import Recording
from ..results import OutputFit, ParameterEstimate
from ..validation.fit import output_fit
from ..wording import listed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The answer of a classical method.

    parameters: name -> estimate; of a method that fits a plant, all parameters of the plant, fixed ones too. fit: recording -> output ->
    how its samples are met by what `predicted` says: the model simulated under the inputs from the start the method found, or its
    prediction from one sample to the next. notes: what the method assumed, left out or could not do.
    """

    method: str
    model: str
    parameters: Mapping[str, ParameterEstimate]
    fit: Mapping[str, Mapping[str, OutputFit]]
    predicted: Literal["simulated", "one step ahead"]
    notes: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        free = ", ".join(f"{p.name} = {p}" for p in self.parameters.values() if not p.fixed)
        return f"Baseline({self.method} of {self.model}: {free or 'no free parameter'})"


def estimates(problem: Problem, theta: Array, std: Array, determined: Sequence[bool] | None = None) -> dict[str, ParameterEstimate]:
    """All parameters of the plant: theta and std (np_free,) for the free ones in the model's order, the others as they were given."""
    out, free = {}, problem.free
    for i, info in enumerate(problem.dae.parameters):
        k = free.index(i) if i in free else None
        known = k is not None and (determined is None or bool(determined[k]))
        out[info.name] = ParameterEstimate(
            name=info.name,
            value=float(problem.values[i] if k is None else theta[k]),
            std=float(std[k]) if k is not None and known and np.isfinite(std[k]) else None,
            unit=info.unit,
            fixed=k is None,
            identifiable=None if k is None else known,
            guess=None if k is None else float(problem.values[i]),
        )
    return out


def require_free(problem: Problem, method: str) -> list[int]:
    """Indices of the free parameters; raises InputError where there is none, or where one is no constant."""
    if not problem.free:
        raise InputError(f"parameters: {method} has nothing to estimate; give at least one parameter as Free(guess).")
    if problem.varying:
        raise InputError(
            f"parameters: {listed(list(problem.varying))}: {method} knows constants only; leave drift and per_recording out, or use smooth."
        )
    return list(problem.free)


def prior(problem: Problem) -> tuple[Array, Array]:
    """Prior means and 1/std^2 of the free parameters, each (np_free,); zero where nothing is known."""
    given = [getattr(problem.parameters[problem.dae.parameters[i].name], "std", None) for i in problem.free]
    return problem.values[list(problem.free)], np.array([0.0 if s is None else 1.0 / s**2 for s in given])


def known_start(problem: Problem) -> dict[str, float]:
    """State -> what the problem says of its start, certain or not."""
    return {name: known.value for name, known in problem.start.items()}


def bounds(problem: Problem) -> tuple[Array, Array]:
    """Bounds of the free parameters, the plant's and the problem's, each (np_free,)."""
    infos = [problem.dae.parameters[i] for i in problem.free]
    given = [problem.parameters[info.name] for info in infos]
    low = [max(info.minimum, getattr(g, "min", -np.inf)) for info, g in zip(infos, given, strict=True)]
    high = [min(info.maximum, getattr(g, "max", np.inf)) for info, g in zip(infos, given, strict=True)]
    return np.array(low), np.array(high)


def simulated(
    problem: Problem, recording: Recording, rows: slice, theta: Array, start: Mapping[str, float], rtol: float = 1e-10
) -> Trajectory:
    """The plant with the free parameters at theta, at `rows`, under the inputs as they acted, from the states `start`.

    Rounded corners are sharp, as in every simulation, unless the problem names their width.
    """
    values = problem.values.copy()
    values[list(problem.free)] = theta
    named = {
        p.name: float(v) for p, v in zip(problem.dae.parameters, values, strict=True) if not p.smoothing or p.name in problem.parameters
    }
    return run_under_inputs(problem.dae, recording, named, start, rows=rows, rtol=rtol)


def simulated_fits(
    problem: Problem, theta: Array, starts: Mapping[str, tuple[int, Mapping[str, float]]]
) -> tuple[dict[str, dict[str, OutputFit]], tuple[str, ...]]:
    """Fit of every recording, each piece simulated from row `starts[title][0]`, and a note where that fails.

    `starts[title][1]` are guesses of the states there; one Gauss-Newton step in them is taken where it pays, so that the fit is that of the
    parameters and not of a noisy start.
    """
    met: dict[str, dict[str, list[Array]]] = {}
    failed = []
    for recording in problem.fitted:
        first, start = starts[recording.title]
        rows = slice(first, len(recording.time))
        try:
            run = _from_a_good_start(problem, recording, rows, theta, start)
        except (SolveError, ValueError) as error:
            failed.append(f"{recording.title} ({str(error).rstrip('.')})")
            continue
        for name, y in recording.outputs.items():
            met.setdefault(recording.name, {}).setdefault(name, []).append(np.stack([y[rows], run.outputs[name]]))
    fits = {r: {name: output_fit(*np.hstack(parts)) for name, parts in outputs.items()} for r, outputs in met.items()}
    return fits, (f"Not simulated with the estimates: {listed(failed)}.",) if failed else ()


def _from_a_good_start(problem: Problem, recording: Recording, rows: slice, theta: Array, start: Mapping[str, float]) -> Trajectory:
    spread = {name: float(np.nanstd(y)) or 1.0 for name, y in recording.outputs.items()}

    def errors(run: Trajectory) -> Array:
        return np.concatenate([np.nan_to_num((y[rows] - run.outputs[name]) / spread[name]) for name, y in recording.outputs.items()])

    run = simulated(problem, recording, rows, theta, start)
    # after a gap nothing is known
    moved = [name for name in start if recording.part or name not in problem.known_exactly]
    size = {q.name: max(abs(start.get(q.name, 0.0)), 1e-3 * abs(q.nominal)) * 1e-3 for q in problem.dae.states}
    e = errors(run)
    slopes = [
        (e - errors(simulated(problem, recording, rows, theta, {**start, name: start[name] + size[name]}))) / size[name] for name in moved
    ]
    if not moved:
        return run
    J = np.column_stack(slopes)
    unit = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    step = np.linalg.lstsq(J / unit, e, rcond=1e-8)[0] / unit
    better = simulated(
        problem, recording, rows, theta, {**start, **{name: start[name] + float(s) for name, s in zip(moved, step, strict=True)}}
    )
    return better if np.linalg.norm(errors(better)) < np.linalg.norm(e) else run
