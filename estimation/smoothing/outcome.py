"""From a solution to what the user reads: names, units, tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from backsight.models import ParameterInfo
from backsight.models.augmentation.parameters import case_name
from backsight.ocp import Solution

from ..problem import Free, Problem, Weights
from ..recordings.recording import Recording
from ..results import DETERMINED, DOUBT, ParameterEstimate, ResidualSummary, Smoothing, SolverFacts
from ..supposed import noisy_inputs, own_parameters
from ..validation.rates import undriven_rates
from ..validation.validate import Validation, followed, remembered, validate
from .columns import columns, places
from .mesh_error import Checked
from .notes import notes
from .on_bounds import OnBounds, on_bounds
from .program import decision_bounds
from .rest import rows_near_rest
from .variances import Choice

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NEGLIGIBLE = 0.05  # or of its nominal size, for one near zero that is not up against its physical bound


@dataclass(frozen=True, kw_only=True)
class Run:
    """A solved smoothing problem.

    stds, open_outputs: per recording, the outputs' standard deviations that `choice.output_factor` multiplies, and those that nobody gave.
    remeshed: whether the weights asked for a second mesh. checked: what its mesh was found to do.
    said: sentences of the last steps (`marginal.py`). marginal: whether they led to the parameters of most marginal likelihood.
    """

    choice: Choice
    stds: list[dict[str, float]]
    open_outputs: tuple[set[str], ...]
    remeshed: bool
    checked: Checked
    said: tuple[str, ...] = ()
    marginal: bool = False

    def noise(self, number: int, output: str, index: int) -> float:
        """Standard deviation in force of an output, the `index`-th of the model, in recording `number`."""
        return self.stds[number][output] * float(self.choice.output_factor[number, index])


NO_MINIMUM = "Ended on no minimum: give better guesses, more room in W, or fewer free parameters."


def outcome(problem: Problem, run: Run, *, build: float, seconds: float) -> Smoothing:
    """The result object of a smoothing run."""
    choice = run.choice
    dae, solution = problem.dae, choice.solution
    t, solved = solution.transcription, solution.solved
    recordings = {r.name: r for r in problem.recordings}
    pieces: dict[str, list[pd.DataFrame]] = {}
    for number, piece in enumerate(problem.fitted):
        pieces.setdefault(piece.name, []).append(pd.DataFrame(columns(problem, solution, number, recordings[piece.name])))
    in_force = {t.dae.places[k].name: float(s) for k, s in zip(t.soft, choice.force_std, strict=True)}
    estimates = {name: _joined(recordings[name], tables) for name, tables in pieces.items()}
    validation = validate(solution, [piece.name for piece in problem.fitted], weighed=choice.rounds > 0)
    fit = {name: validation.fits(recordings[name], table) for name, table in estimates.items()}
    inputs: dict[str, dict[str, Array]] = {name: dict(recordings[name].inputs) for name in estimates}
    rates = undriven_rates(solution, problem.fitted)
    tables = [piece for parts in pieces.values() for piece in parts]
    sizes = _sizes(problem, solution, tables)
    residuals = _residuals(problem, sizes, estimates, inputs, validation, rates)
    lower, upper = (end[t.nlp.trajectory_size :] for end in decision_bounds(problem.posed, t))
    bounds = on_bounds(solution, lower, upper, run.marginal)
    parameters = _parameters(problem, solution, bounds, tables)
    return Smoothing(
        model=dae.name,
        parameters=parameters,
        estimates=estimates,
        inputs=inputs,
        units=_units(problem),
        fit=fit,
        weights=Weights(
            W={**problem.weights.W, **{name: std for name, std in in_force.items() if name in places(problem)}},
            V=_noises(problem, run) | noisy_inputs(problem),
            tau=problem.weights.tau,
            kind=problem.weights.kind,
        ),
        solver=SolverFacts(
            status=solved.status.value if solution.curvature is not None else NO_MINIMUM,
            converged=solved.status.converged and solution.curvature is not None,
            iterations=choice.iterations,
            seconds=seconds,
            build_seconds=build,
            variables=t.nlp.size,
        ),
        residual_places=residuals,
        notes=notes(problem, run, bounds, fit, residuals, estimates, validation.errors),
        correlation=_correlation(problem.posed, solution, bounds, parameters),
        criteria=validation.criteria,
        solution=solution,
    )


def _joined(recording: Recording, pieces: list[pd.DataFrame]) -> pd.DataFrame:
    """The pieces of a recording as one table with all its rows; those of no piece have no estimates."""
    table = pd.concat(pieces, ignore_index=True)
    if len(table) == len(recording.time):
        return table
    table = table.set_index("t_s").reindex(recording.time).reset_index(names="t_s")
    return table.assign(**{f"{name}.measured": y for name, y in recording.outputs.items()})


def _parameters(
    problem: Problem, solution: Solution, bounds: OnBounds | None, pieces: Sequence[pd.DataFrame]
) -> dict[str, ParameterEstimate]:
    """The model's parameters in its order; one that every recording has of its own in each, one that drifts as its mean over time.

    pieces: the estimates of every horizon.
    """
    posed, values = problem.posed, solution.parameters
    curvature = solution.curvature if bounds is None else bounds
    variance = np.full(len(posed.free), np.nan) if curvature is None else curvature.parameter_variance
    std = dict(zip(posed.free, np.sqrt(np.maximum(variance, 0.0)), strict=True))
    number = {info.name: i for i, info in enumerate(posed.dae.parameters)}
    held = {posed.free[k] for k in solution.parameters_on_bounds}
    own, out = own_parameters(problem), {}
    for info in problem.dae.parameters:
        given = problem.parameters.get(info.name)
        for name in own.get(info.name, [info.name]):
            value, s = float(values[number[name]]), float(std.get(number[name], np.nan))
            if number[name] in held:
                value, s = posed.nearest_bound(number[name], value), np.nan
            if isinstance(given, Free) and given.drift is not None:
                value, s = (_over_time(pieces, column) for column in (name, f"{name}.std"))
            known = s if isinstance(given, Free) and np.isfinite(s) and s > 0 else None
            out[name] = ParameterEstimate(
                name=name,
                value=value,
                std=known,
                unit=info.unit,
                fixed=not isinstance(given, Free),
                identifiable=_identified(value, known, info) if isinstance(given, Free) else None,
                guess=given.guess if isinstance(given, Free) else None,
                on_bound=number[name] in held,
                size=info.nominal if info.minimum < 0 else 0.0,
            )
    return out


def _over_time(pieces: Sequence[pd.DataFrame], column: str) -> float:
    """Mean of a column over the time of all pieces, trapezoidal between the rows that are known; NaN where none are."""
    area = span = 0.0
    for piece in pieces:
        t, y = piece[["t_s", column]].dropna().to_numpy().T
        if len(t):
            area, span = area + float(np.trapezoid(y, t)), span + float(t[-1] - t[0])
    return area / span if span > 0 else float("nan")


def _correlation(
    problem: Problem, solution: Solution, bounds: OnBounds | None, parameters: Mapping[str, ParameterEstimate]
) -> pd.DataFrame:
    """Correlations of the free parameters of the posed problem that have a deviation; what drifts is a state there, and no number."""
    curvature = solution.curvature if bounds is None else bounds
    if curvature is None:
        return pd.DataFrame()
    names = [problem.dae.parameters[i].name for i in problem.free]
    told = [name for name, p in parameters.items() if p.std is not None and name in names]
    rows = [names.index(name) for name in told]
    covariance = curvature.parameter_covariance[np.ix_(rows, rows)]
    std = np.sqrt(np.diag(covariance))
    return pd.DataFrame((covariance + covariance.T) / (2 * np.outer(std, std)), told, told)  # rounding leaves no two halves the same


def _identified(value: float, std: float | None, info: ParameterInfo) -> bool:
    if std is None:
        return False
    bounded = min(value - info.minimum, info.maximum - value) < 3.0 * std
    return std < DETERMINED * abs(value) or (std < NEGLIGIBLE * info.nominal and not bounded)


def _units(problem: Problem) -> dict[str, str]:
    dae = problem.dae
    units = {"t_s": "s"} | {q.name: q.unit for q in (*dae.inputs, *dae.outputs, *dae.states)}
    units |= {p.name: p.unit for p in dae.parameters if p.name in problem.varying}
    return units | {f"residual.{name}": unit for name, unit in places(problem).items()}


def _residuals(
    problem: Problem,
    rms: Mapping[str, Rms],
    estimates: dict[str, pd.DataFrame],
    inputs: dict[str, dict[str, Array]],
    validation: Validation,
    rates: Mapping[str, pd.DataFrame],
) -> dict[str, ResidualSummary]:
    states, units = tuple(q.name for q in problem.dae.states), _units(problem)
    return {
        place.name: ResidualSummary(
            place=place.name,
            unit=place.unit,
            origin=place.origin,
            whiteness_p=validation.force_p.get(place.name),
            memory=remembered(place.name, estimates) if validation.force_p.get(place.name, 1.0) < DOUBT else None,
            follows=followed(place.name, place.unit, estimates, inputs, states, units, rates),
            **asdict(rms[place.name]),
        )
        for place in problem.posed.dae.places
        if place.name in rms
    }


@dataclass(frozen=True, kw_only=True)
class Rms:
    """Of a residual force, as `ResidualSummary` has it."""

    rms: float
    rest_rms: float | None
    rest_share: float


def _sizes(problem: Problem, solution: Solution, pieces: Sequence[pd.DataFrame]) -> dict[str, Rms]:
    """Place -> how large its residual force is; pieces: the estimates of every horizon."""
    found, rests = {}, [rows_near_rest(solution, number) for number in range(len(pieces))]
    for k, place in enumerate(problem.posed.dae.places):
        if place.name in places(problem):
            squares = np.concatenate([piece[f"residual.{place.name}"].to_numpy() ** 2 for piece in pieces])
            resting = np.concatenate([rest.get(k, np.zeros(len(piece), bool)) for rest, piece in zip(rests, pieces, strict=True)])
            found[place.name] = Rms(
                rms=float(np.sqrt(np.mean(squares if resting.all() else squares[~resting]))),
                rest_rms=float(np.sqrt(np.mean(squares[resting]))) if resting.any() else None,
                rest_share=float(np.mean(resting)),
            )
    return found


def _noises(problem: Problem, run: Run) -> dict[str, float]:
    """Output -> std of its noise in force; where recordings differ also "<output> [<recording>]", beside their rms."""
    found: dict[str, float] = {}
    for i, q in enumerate(problem.dae.outputs):
        own: dict[str, list[tuple[float, int]]] = {}
        for number, piece in enumerate(problem.fitted):
            if q.name in run.stds[number]:
                count = int(np.isfinite(piece.outputs[q.name]).sum())
                own.setdefault(piece.name, []).append((run.noise(number, q.name, i), count))
        if own:
            found[q.name] = _rms([pair for pairs in own.values() for pair in pairs])
            each = {case_name(q.name, name): _rms(pairs) for name, pairs in own.items()}
            found |= each if len(set(each.values())) > 1 else {}
    return found


def _rms(pairs: Sequence[tuple[float, int]]) -> float:
    """The rms of values, each with how often it counts."""
    values, counts = np.array(pairs, dtype=float).T
    return float(values[0]) if np.all(values == values[0]) else float(np.sqrt(np.average(values**2, weights=np.maximum(counts, 1.0))))
