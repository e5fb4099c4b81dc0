"""What the fitted model says about recordings that it has not seen.

A smoother would bend its residual forces to any recording, so its residuals prove nothing. A prediction has parameters from the fit,
inputs, and a start:

    over the whole recording    simulated from the start that the smoothed first HEAD of it tells
    over windows                simulated from the state that the HEAD before each window tells; no later sample is used

Where the model does not forget its state (a free integrator), an error of the start or of a constant force adds up over the whole
recording; the windows are then the better measure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import scipy.linalg

from backsight.models import Dae, ModelError, Quantity, SolveError, Trajectory
from backsight.models.augmentation.parameters import case_name
from backsight.ocp.linear import linearise

from ..problem import Free, Problem
from ..recordings.drive import run as run_under_inputs
from ..recordings.recording import Recording
from ..results import Prediction, Smoothing
from ..validation.fit import output_fit
from ..wording import listed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

HEAD = 0.1  # of a recording
WINDOW = 0.05  # of a recording
WINDOWS = 10
LEAST_ROWS = 20  # of a head
REMEMBERED = 0.1  # of an output's first displacement, half a recording later: a model that keeps more does not forget


def predict(problem: Problem, result: Smoothing, smooth: Callable[[Problem], Smoothing]) -> tuple[dict[str, Prediction], tuple[str, ...]]:
    """Predictions of the held-out recordings with the parameters and weights of `result`, and notes on them.

    smooth: smooths the heads, with all parameters and weights fixed. A recording that cannot be predicted has a note and no prediction.
    """
    found, notes = {}, []
    for recording in problem.recordings:
        if recording.role != "held_out":
            continue
        try:
            prediction, run = _prediction(problem, result, recording, smooth)
            found[recording.name] = prediction
            notes.append(_sentence(result, recording, prediction, remembering(problem.dae, result, recording, run)))
        except (ModelError, SolveError) as error:
            notes.append(f"Held out: {recording.name} could not be predicted: {error}.")
    return found, tuple(notes)


def _prediction(
    problem: Problem, result: Smoothing, recording: Recording, smooth: Callable[[Problem], Smoothing]
) -> tuple[Prediction, Trajectory]:
    n = len(recording.time)
    head = min(n, max(LEAST_ROWS, round(HEAD * n)))
    window = round(WINDOW * n)
    last = n - 1 - window  # row from which the last window runs
    starts = sorted({int(k) for k in np.linspace(head - 1, last, WINDOWS)}) if window > 1 and last > head else []
    heads = {k: slice(k - head + 1, k + 1) for k in (head - 1, *starts)}
    states, own = _states(problem, result, recording, heads, smooth)
    first = {q.name: problem.known_exactly.get(q.name, float(states[head - 1][q.name].iloc[0])) for q in problem.dae.states}
    run = _simulated(problem, result, recording, slice(0, n), first, own[head - 1])
    columns: dict[str, Array] = {"t_s": recording.time}
    for q in problem.dae.outputs:
        columns[q.name] = run.outputs[q.name]
        if q.name in recording.outputs:
            columns[f"{q.name}.measured"] = recording.outputs[q.name]
    columns.update({q.name: run.states[q.name] for q in problem.dae.states if q.name not in columns})
    square, count = dict.fromkeys(recording.outputs, 0.0), dict.fromkeys(recording.outputs, 0)
    for k in starts:
        rows = slice(k, k + window + 1)
        start = {q.name: float(states[k][q.name].iloc[-1]) for q in problem.dae.states}
        ahead = _simulated(problem, result, recording, rows, start, own[k])
        for name, y in recording.outputs.items():
            error = (y[rows] - ahead.outputs[name])[1:]
            square[name] += float(np.nansum(error**2))
            count[name] += int(np.isfinite(error).sum())
    prediction = Prediction(
        estimates=pd.DataFrame(columns),
        fit={name: output_fit(y, run.outputs[name]) for name, y in recording.outputs.items()},
        start_s=float(recording.time[head - 1] - recording.time[0]),
        window_s=float(np.median(recording.time[window:] - recording.time[:-window])) if starts else None,
        window_rms={name: float(np.sqrt(square[name] / count[name])) for name in square if count[name]},
    )
    return prediction, run


def _states(
    problem: Problem, result: Smoothing, recording: Recording, heads: dict[int, slice], smooth: Callable[[Problem], Smoothing]
) -> tuple[dict[int, pd.DataFrame], dict[int, dict[str, float]]]:
    """The smoothed rows of every head, all in one problem; and the parameters that vary as each head tells them, at its end."""
    pieces = {}
    for k, rows in heads.items():
        outputs = {name: y[rows] for name, y in recording.outputs.items() if np.isfinite(y[rows]).any()}
        if not outputs:
            raise ModelError(f"no output has a value in {recording.time[rows][0]:.9g} .. {recording.time[rows][-1]:.9g} s")
        inputs = {name: u[rows] for name, u in recording.inputs.items()}
        pieces[k] = replace(recording, name=str(k), time=recording.time[rows], inputs=inputs, outputs=outputs, role="fit")
    varying = _of_heads(problem, result)
    parameters: dict[str, Free | float] = {p.name: varying.get(p.name, result.value(p.name)) for p in problem.dae.parameters}
    fixed = Problem(
        model=problem.dae, recordings=list(pieces.values()), parameters=parameters, weights=result.weights, bounds=problem.bounds
    )
    smoothed = smooth(fixed)
    if not smoothed.solver.converged:
        raise SolveError(f"its start was not found: {smoothed.solver.status.rstrip('.')}")
    tables = {k: smoothed.estimates[str(k)] for k in pieces}
    own = {
        k: {
            name: float(table[name].iloc[-1]) if free.drift is not None else smoothed.parameters[case_name(name, str(k))].value
            for name, free in varying.items()
        }
        for k, table in tables.items()
    }
    return tables, own


def _of_heads(problem: Problem, result: Smoothing) -> dict[str, Free]:
    """What a head may suppose of a parameter that varies: that it is one more of the values that were found, in time or of a recording."""
    found = {}
    for name, free in problem.varying.items():
        if free.drift is not None:
            value = np.concatenate([table[name].to_numpy() for table in result.estimates.values()])
            std = np.concatenate([table[f"{name}.std"].to_numpy() for table in result.estimates.values()])
        else:
            own = [p for n, p in result.parameters.items() if n.startswith(f"{name} [")]
            value, std = np.array([p.value for p in own]), np.array([p.std if p.std is not None else np.nan for p in own])
        spread = float(np.sqrt(np.nanvar(value) + np.nanmean(std) ** 2)) if np.isfinite(std).any() else np.nan
        known = spread if len(result.estimates) > 1 or free.drift is not None else np.nan
        guess = float(np.clip(np.nanmean(value), free.min, free.max))
        found[name] = replace(free, guess=guess, std=known if np.isfinite(known) and known > 0 else free.std)
    return found


def _simulated(
    problem: Problem, result: Smoothing, recording: Recording, rows: slice, start: dict[str, float], own: Mapping[str, float]
) -> Trajectory:
    rounded = {p.name for p in problem.dae.parameters if p.smoothing and p.name not in problem.parameters}
    outputs = {name: y[rows] for name, y in recording.outputs.items() if np.isfinite(y[rows]).any()}
    inputs = {name: u[rows] for name, u in recording.inputs.items()}
    return run_under_inputs(
        problem.dae,
        replace(recording, time=recording.time[rows], inputs=inputs, outputs=outputs, gap=None),
        {p.name: own.get(p.name, result.value(p.name)) for p in problem.dae.parameters if p.name not in rounded},
        start,
    )


def _sentence(result: Smoothing, recording: Recording, prediction: Prediction, kept: list[str]) -> str:
    said = []
    for name, fit in prediction.fit.items():
        unit = result.units[name]
        percent = f" (fit {fit.fit_percent:.2f} %)" if fit.fit_percent is not None else ""
        ahead = f", {prediction.window_rms[name]:.3g} {unit} over {prediction.window_s:.3g} s" if name in prediction.window_rms else ""
        said.append(f"{name} to {fit.rms:.3g} {unit} rms{percent}{ahead}")
    what = f": {'; '.join(said)}" if said else ""
    drift = (
        f" {listed(kept)}: the model does not forget its state there, so errors of the start and of constant forces add up over the whole "
        "recording; short windows say more."
        if kept
        else ""
    )
    start = f"simulated under its inputs from the start that its first {prediction.start_s:.3g} s tell"
    return f"Held out: {recording.name}, {start}{what}.{drift}"


def remembering(dae: Dae, result: Smoothing, recording: Recording, run: Trajectory) -> list[str]:
    """Measured outputs in which a displacement of the state is still felt after half the recording: |C e^(A T/2)| against |C|.

    Linearised in the middle of the simulated recording, every state in units of its own variation there.
    """
    k = len(run.t) // 2

    def there(quantities: Sequence[Quantity], values: Mapping[str, Array]) -> Array:
        return np.array([float(values[q.name][k]) for q in quantities]).reshape(len(quantities), 1)

    linear = linearise(
        dae,
        there(dae.states, run.derivatives),
        there(dae.states, run.states),
        there(dae.algebraics, run.algebraics),
        there(dae.inputs, recording.inputs),
        run.t[k : k + 1],
        np.array([result.value(p.name) for p in dae.parameters]),
        (),
    )
    A, C = linear.A[0], linear.C[0]
    # what grows is felt anyhow, and must not overflow
    span = min(float(run.t[-1] - run.t[0]) / 2, 10.0 / max(float(np.linalg.eigvals(A).real.max()), 1e-12))
    unit = np.array([float(np.std(run.states[q.name])) or 1.0 for q in dae.states])
    size, kept = (np.linalg.norm(M * unit, axis=1) for M in (C, C @ scipy.linalg.expm(A * span)))
    return [
        q.name for q, now, then in zip(dae.outputs, size, kept, strict=True) if q.name in recording.outputs and then > REMEMBERED * now > 0
    ]
