"""From recordings to horizons: the arrays in the model's order, on a mesh."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from backsight.models import Dae
from backsight.models.errors import InputError
from backsight.ocp import Horizon, mesh_over
from backsight.ocp.pieces import direct

from ..problem import Known, Problem
from ..recordings.drive import drive_of
from ..recordings.gaps import usual_interval
from ..recordings.noise import noise, varies
from ..recordings.outliers import screened
from ..recordings.rate import rate
from ..recordings.recording import Recording

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def output_stds(problem: Problem) -> tuple[list[dict[str, float]], list[set[str]]]:
    """Noise of every output of every fitted recording, and those of them that nobody gave, per recording.

    Given by the weights V, else by the recording, else estimated from the samples' differences; the model's own noise stands where they
    cannot tell. Samples that are all alike have the noise of the same output in other recordings, else the model's own: what a fit leaves
    over of them tells as little, and it counts as given.
    """
    supposed = {q.name: q.noise_std for q in problem.dae.outputs}
    whole = {r.name: r for r in problem.recordings if r.role == "fit"}
    given = {k: {name: problem.weights.noise(name, r) for name in r.outputs} for k, r in whole.items()}
    told = {
        k: {
            name: float(std or noise(r.time, r.outputs[name], supposed.get(name)).std)
            for name, std in given[k].items()
            if std or varies(r.outputs[name])
        }
        for k, r in whole.items()
    }
    tables, chosen = [], []
    for piece in problem.fitted:
        r, own = whole[piece.name], told[piece.name]
        alike = {name: _elsewhere(told.values(), name) or supposed.get(name) for name in piece.outputs if name not in own}
        known = own | {name: float(std) for name, std in alike.items() if std}
        tables.append({name: known.get(name) or noise(r.time, r.outputs[name]).std for name in piece.outputs})
        chosen.append({name for name in piece.outputs if given[piece.name][name] is None and not alike.get(name)})
    return tables, chosen


def _elsewhere(told: Iterable[Mapping[str, float]], name: str) -> float | None:
    """The rms of an output's noise over the recordings that tell it; None where none does."""
    stds = [own[name] for own in told if name in own]
    return float(np.sqrt(np.mean(np.square(stds)))) if stds else None


def check_varies(problem: Problem) -> None:
    """Raise InputError where neither the fitted samples of an output nor the model say anything of a noise that nobody gave."""
    for q in problem.dae.outputs:
        those = [r for r in problem.recordings if r.role == "fit" and q.name in r.outputs]
        if not those or q.noise_std is not None or any(problem.weights.noise(q.name, r) for r in those):
            continue
        known = [y[np.isfinite(y)] for y in (r.outputs[q.name] for r in those)]
        if max(y.size for y in known) > 1 and not any(varies(y) for y in known):
            value = next(y[0] for y in known if y.size)
            raise InputError(
                f"{those[0].name}: output {q.name} is {value:g} in all its samples, which say nothing of its noise; "
                "give its std, or leave it out"
            )


def shown_noise(problem: Problem) -> tuple[Array, Array]:
    """What of every output's noise its samples show beyond doubt [unit], 0 where they cannot tell or nothing is sampled; each (H, ny).

    With what they are rounded to, which is the least, and without; of a rough output nothing.
    """
    dae, at_once = problem.dae, rough(problem)
    whole = {recording.name: screened(recording) for recording in problem.recordings}  # outliers that a loss expects alternate as well
    least, white = (np.zeros((len(problem.fitted), len(problem.dae.outputs))) for _ in range(2))
    for row, piece in enumerate(problem.fitted):
        own = whole[piece.name]
        for i, q in enumerate(dae.outputs):
            if q.name in piece.outputs and q.name not in at_once and not piece.clock_std:  # what a clock does alternates, too
                told = noise(own.time, own.outputs[q.name])
                least[row, i], white[row, i] = told.least, told.white
    return least, white


def rough(problem: Problem) -> set[str]:
    """Outputs that read forces at once, such as accelerations: they are as rough as these, and show nothing of their noise."""
    dae = problem.dae
    at_once = {i for part in direct(dae, range(len(dae.places))) for i in part.sparsity().row()}
    return {q.name for i, q in enumerate(dae.outputs) if i in at_once}


def make_horizon(dae: Dae, recording: Recording, std: Mapping[str, float], initial: Mapping[str, Known], step: float) -> Horizon:
    """A piece of a recording on a mesh of about `step` [s]; initial: what is known of its start."""
    n = len(recording.time)
    target, target_std = np.full((n, len(dae.outputs)), np.nan), np.ones((n, len(dae.outputs)))
    for i, output in enumerate(dae.outputs):
        if output.name in recording.outputs:
            target[:, i] = recording.outputs[output.name]
            target_std[:, i] = np.hypot(std[output.name], recording.clock_std * rate(recording.time, target[:, i]))
    # times from the recording's own start: a clock that counts from 1970 would cost digits
    time = recording.time - recording.time[0]
    drive, (known, known_std) = drive_of(recording), _start(dae, initial)
    return Horizon(
        mesh=mesh_over(time, step),
        time=time,
        inputs=np.column_stack([drive.inputs[q.name] for q in dae.inputs]) if dae.inputs else np.empty((len(drive.time), 0)),
        target=target,
        target_std=target_std,
        initial=known,
        initial_std=known_std,
        clock=float(recording.time[0]),
        hold=recording.hold,
        drive_time=drive.time - recording.time[0] if recording.drive is not None else None,
    )


def sampling_interval(recording: Recording) -> float:
    """Time between rows [s]; where the rows of several clocks are joined, time in which each has had its turn."""
    return usual_interval(recording)


def sample_density(dae: Dae, recording: Recording, std: Mapping[str, float]) -> Array:
    """std^2 times the mean time between samples of every output [unit^2 s]; inf for one that is not there. Shape (ny,)."""
    out = np.full(len(dae.outputs), np.inf)
    span = float(recording.time[-1] - recording.time[0])
    for i, q in enumerate(dae.outputs):
        if q.name in recording.outputs:
            count = int(np.isfinite(recording.outputs[q.name]).sum())
            if count:
                out[i] = std[q.name] ** 2 * span / count
    return out


def beginning(horizon: Horizon, dae: Dae, initial: Mapping[str, Known]) -> Horizon:
    """The horizon of another model; initial: what is known of its start."""
    known, std = _start(dae, initial)
    return replace(horizon, initial=known, initial_std=std)


def _start(dae: Dae, initial: Mapping[str, Known]) -> tuple[Array, Array]:
    """Value and std of all states at the start; std inf: nothing is known."""
    known = [initial.get(q.name) for q in dae.states]
    return np.array([k.value if k else 0.0 for k in known]), np.array([k.std if k else np.inf for k in known])
