"""The moving horizon over recordings, row by row as if they came in now."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from backsight.models.errors import InputError
from backsight.ocp.moving.window import Update

from ..problem import Problem, Weights
from ..recordings.drive import drive_of
from ..recordings.gaps import lost_note
from ..recordings.recording import Recording
from ..results import OutputFit, ParameterEstimate, SolverFacts
from ..smoothing.columns import places
from ..validation.fit import output_fit
from .estimate import Estimate, Outcome, Sample, columns
from .estimator import ITERATIONS, SAMPLES, WILD, Estimator

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SAY_EVERY = 1.0  # s, between reports of how far it is


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """What `track` gives back.

    estimates: recording -> one row per sample, each from the samples up to its own: t_s, outputs with .measured and .std, states, residual
    forces (means over the last stage of the window, a sampling interval or a part of it), parameters and measured inputs, all with .std.
    parameters: as they stand at the end. fit: of the estimates to the samples, judged by the errors of the predictions from sample to
    sample over their deviations. latency_ms: median, p95, p99 and max of the time that an estimate took. failed_steps: solves that did not
    converge. outcomes: how many estimates came about how.
    """

    model: str
    parameters: dict[str, ParameterEstimate]
    estimates: dict[str, pd.DataFrame]
    inputs: dict[str, dict[str, Array]]
    units: Mapping[str, str]
    fit: dict[str, dict[str, OutputFit]]
    weights: Weights
    solver: SolverFacts
    samples: int
    latency_ms: dict[str, float]
    failed_steps: int
    outcomes: dict[Outcome, int]
    notes: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        free = ", ".join(f"{p.name} = {p}" for p in self.parameters.values() if not p.fixed)
        return f"Tracking({self.model}: {free or 'no free parameter'}; {self.failed_steps} failed steps)"


def track(
    problem: Problem,
    *,
    samples: int = SAMPLES,
    iterations: int = ITERATIONS,
    update: Update = "smoothing",
    jit: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Tracking:
    """Track the fitted recordings of a problem one after the other; what is known of the parameters goes along.

    samples, iterations, update, jit: see `Estimator`. Raises InputError for a problem that cannot be posed.
    """
    say, began = progress or (lambda _: None), clock.perf_counter()
    shortest = min((r for r in problem.recordings if r.role == "fit"), key=lambda r: len(r.time))
    if samples > len(shortest.time):
        raise InputError(f"track(samples={samples}): longer than {shortest.name} with {len(shortest.time)} rows; shorten it.")
    say("finding what the study leaves open")
    estimator = Estimator(problem, samples=samples, iterations=iterations, update=update, jit=jit, progress=say)
    build = clock.perf_counter() - began
    tables, fit = dict[str, pd.DataFrame](), dict[str, dict[str, OutputFit]]()
    for number, recording in enumerate(r for r in estimator.tuning.asked.split.recordings if r.role == "fit"):
        if number:
            estimator.restart()
        rows, surprises, words, latest = [], [], [], -np.inf
        for k, estimate in enumerate(followed(estimator, recording)):
            rows.append(estimate.row())
            surprises.append(estimate.surprise)
            words.append(estimate.outcome.word)
            if clock.perf_counter() > latest + SAY_EVERY:
                latest = clock.perf_counter()
                say(f"{recording.name}: row {k + 1} of {len(recording.time)}")
        table = pd.DataFrame(np.array(rows), columns=columns(estimator.names))
        z = np.array(surprises)
        fit[recording.name] = {
            q: output_fit(recording.outputs[q], table[q].to_numpy(), z[:, i])
            for i, q in enumerate(estimator.names.outputs)
            if q in recording.outputs
        }
        unmeasured = [f"{q}.measured" for q in estimator.names.outputs if q not in recording.outputs]
        tables[recording.name] = table.drop(columns=unmeasured).assign(outcome=words)
    found = summary(estimator, tables, fit, build=build, seconds=clock.perf_counter() - began - build)
    lost = [note for r in problem.recordings if r.role == "fit" and (note := lost_note(r))]
    return replace(found, notes=(*lost, *found.notes))


def followed(estimator: Estimator, recording: Recording) -> Iterator[Estimate]:
    """The estimates of a recording's rows, as they are asked for; between rows the inputs act as they were recorded."""
    drive, j = drive_of(recording), 0
    between = drive.time.tolist() if recording.drive is not None else []
    for k, time in enumerate(recording.time.tolist()):
        while j < len(between) and between[j] < time:
            if k:
                estimator.hold(between[j], {name: float(u[j]) for name, u in drive.inputs.items()})
            j += 1
        inputs = {name: float(u[k]) for name, u in recording.inputs.items()}
        yield estimator.update(Sample(time=time, inputs=inputs, outputs={name: float(y[k]) for name, y in recording.outputs.items()}))


def summary(
    estimator: Estimator, tables: dict[str, pd.DataFrame], fit: dict[str, dict[str, OutputFit]], *, build: float, seconds: float
) -> Tracking:
    """The result of what an estimator has done; build, seconds: that its making and its work took."""
    asked = estimator.tuning.asked
    failed = estimator.counts[Outcome.FAILED]
    return Tracking(
        model=asked.dae.name,
        parameters=_parameters(estimator),
        estimates=tables,
        inputs={r.name: dict(r.inputs) for r in asked.recordings if r.name in tables},
        units=_units(estimator),
        fit=fit,
        weights=asked.weights,
        solver=SolverFacts(
            status="every estimate converged" if not failed else f"{failed} of {sum(estimator.counts.values())} solves did not converge",
            converged=not failed,
            iterations=estimator.steps,
            seconds=seconds,
            build_seconds=build,
            variables=estimator.window.stage.size + (estimator.window.length + 1) * len(asked.dae.states),
        ),
        samples=estimator.samples,
        latency_ms=estimator.latency.milliseconds(),
        failed_steps=failed,
        outcomes={outcome: n for outcome, n in estimator.counts.items() if n},
        notes=_notes(estimator),
    )


def _parameters(estimator: Estimator) -> dict[str, ParameterEstimate]:
    """Every parameter of the model as it stands."""
    asked, now = estimator.tuning.asked, estimator.estimate
    found = dict[str, ParameterEstimate]()
    for info in asked.split.dae.parameters:
        if info.name in estimator.names.parameters and now is not None:
            value, std = now[info.name], now.std(info.name)
            determined = bool(np.isfinite(std))
            found[info.name] = ParameterEstimate(
                name=info.name,
                value=value,
                std=std if determined else None,
                unit=info.unit,
                fixed=False,
                identifiable=determined,
            )
        else:
            given = asked.parameters.get(info.name, info.value)
            value = float(given) if isinstance(given, (int, float)) else info.value
            found[info.name] = ParameterEstimate(name=info.name, value=value, std=None, unit=info.unit, fixed=True)
    return found


def _units(estimator: Estimator) -> dict[str, str]:
    asked = estimator.tuning.asked
    units = {q.name: q.unit for q in (*asked.dae.outputs, *asked.dae.states, *asked.dae.inputs)}
    units |= {p.name: p.unit for p in asked.split.dae.parameters}
    return units | {f"residual.{name}": unit for name, unit in places(asked).items()}


def _notes(estimator: Estimator) -> tuple[str, ...]:
    said = [*estimator.tuning.notes, *estimator.notes]
    if estimator.wild:
        said.append(
            f"{estimator.wild} values of inputs were {WILD:g} times as large as any recorded, and taken as missing; limits say what can be."
        )
    more = {
        Outcome.FAILED: "solves did not converge; the estimates there are predictions",
        Outcome.RESTARTED: "gaps, after which the states started anew",
        Outcome.LATE: "samples came too late or twice and were left out",
        Outcome.FILLED: "samples came late and took their places",
    }
    said += [f"{estimator.counts[outcome]} {words}." for outcome, words in more.items() if estimator.counts[outcome]]
    return tuple(said)
