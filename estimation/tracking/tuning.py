"""What an estimator is set to before its first sample: the weights and widths that a study leaves open, and how fine its stages are.

They are found as filters are tuned, off-line on a recording: by smoothing the first rows of the fitted ones; where W of all places and V
of all outputs are given, trajectories through the samples tell the rest. Only W, V, the widths of friction laws and the mesh come from
there; parameters and states start from what the problem says of them and are found on-line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from backsight.models.errors import InputError
from backsight.ocp.follow import Followed
from backsight.ocp.horizon import Horizon
from backsight.ocp.moving.prediction import Prediction
from backsight.ocp.moving.stage import Stage

from ..problem import Problem, Weights
from ..recordings.gaps import gap_limit
from ..recordings.recording import Recording
from ..recordings.split import rows_of
from ..smoothing.horizons import output_stds
from ..smoothing.lifted import lifted, measured_by
from ..smoothing.meshing import follow_closely
from ..smoothing.rest import FrictionLaw, friction_laws, smoothing_widths
from ..smoothing.robust import CORNER
from ..smoothing.smoother import smooth
from ..smoothing.unseen import complete, moving_unseen, unseen_states

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ROWS = 5000  # of a recording, at most, that are smoothed
GROSS = 4.0  # deviations from which on a sample is suspected of being wrong, unless its output has a loss of its own
FINEST = 16  # stages between two samples, at most
EXACT = 0.1  # of the noise: what the stages may be wrong by from sample to sample
SUDDEN = 10.0  # times the usual change of an input from row to row: no noise of a control
AT_JUMPS = 0.5  # of the noise, where an input jumps: for once it adds a quarter to a prediction's mean square error
LOOKED_AT, FEW = 40, 0.9  # places of a recording where that is judged, and the share of them where it holds: not where bodies turn round


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Settings of an estimator for a problem as it is posed (`Problem.posed`).

    asked: with all weights and widths; problem: the same as it is posed. force_std: place number -> std [unit * sqrt(s)]; noise, corner:
    (ny,) of every output, std inf where it is not measured, and where Huber's loss begins [deviations]. laws: friction laws with a
    rounded sign; widths: those of them that were found. stages: between two samples. sampling, gap: the usual interval between rows [s],
    and from where on rows stand apart. notes: what was found, in words.
    """

    asked: Problem
    problem: Problem
    force_std: dict[int, float]
    noise: Array
    corner: Array
    laws: tuple[FrictionLaw, ...]
    widths: dict[str, float]
    stages: int
    sampling: float
    gap: float
    notes: tuple[str, ...] = ()


def tuned(problem: Problem, progress: Callable[[str], None]) -> Tuning:
    """The settings for a problem. Raises InputError where the leading rows cannot be smoothed and are needed for what it leaves open."""
    fitted = [r for r in problem.recordings if r.role == "fit"]
    leading = replace(problem, recordings=[_robust(_leading(r, ROWS // len(fitted))) for r in fitted])
    return _settled(problem, _along(leading) if _told(problem) else _smoothed(leading, progress))


@dataclass(frozen=True, kw_only=True)
class _Found:
    """Of the leading rows: all weights, places that have a residual force, parameters (np_all,) with widths, trajectories, and notes."""

    weights: Weights
    soft: set[str]
    parameters: Array
    followed: Followed
    notes: tuple[str, ...] = ()


def _told(problem: Problem) -> bool:
    """Whether the problem has W of every place and the noise of every output."""
    plain = problem.plain
    places = {plain.dae.places[e.place].name for e in plain.dae.equations if e.place is not None}
    noises = [problem.weights.noise(q, r) for r in problem.recordings if r.role == "fit" for q in r.outputs]
    return places <= set(problem.weights.W) and all(noises)


def _along(problem: Problem) -> _Found:
    """Without smoothing: trajectories through the samples, which the model completes at the guesses."""
    plain, posed = problem.plain, problem.posed
    followed, parameters, laws = follow_closely(plain, output_stds(plain)[0], None), plain.values, friction_laws(plain)
    if unseen_states(plain):
        followed, parameters, _ = complete(plain, followed, laws, parameters)
    for index, width in smoothing_widths(plain, laws, followed, moving_unseen(plain)).items():
        parameters[index] = width
    return _Found(
        weights=problem.weights,
        soft=set(posed.weights.W),
        parameters=measured_by(posed, parameters, parameters),
        followed=lifted(posed, plain, followed, parameters),
    )


def _smoothed(problem: Problem, progress: Callable[[str], None]) -> _Found:
    """What smoothing finds."""
    answer = smooth(problem, progress=progress)
    solution = answer.solution
    if solution is None or not answer.solver.converged:
        raise InputError(
            f"{problem.recordings[0].name}: its first rows cannot be smoothed ({answer.solver.status}), and the weights left open cannot "
            "be found; give better guesses, or W of every place and V of every output."
        )
    t = solution.transcription
    return _Found(
        weights=answer.weights,
        soft={t.dae.places[k].name for k in t.soft},
        parameters=solution.parameters,
        followed=Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions),
        notes=tuple(note for note in answer.notes if note.startswith(("W of", "V of"))),
    )


def _settled(problem: Problem, found: _Found) -> Tuning:
    """The settings from what was found."""
    infos = enumerate(problem.dae.parameters)
    widths = {p.name: float(found.parameters[i]) for i, p in infos if p.smoothing and p.name not in problem.parameters}
    settled = replace(problem, weights=found.weights, parameters={**problem.parameters, **widths})
    posed, fitted = settled.posed, [r for r in problem.recordings if r.role == "fit"]
    noise, corner = np.full(len(posed.dae.outputs), np.inf), np.full(len(posed.dae.outputs), GROSS)
    for i, q in enumerate(posed.dae.outputs):
        stds = [found.weights.noise(q.name, r) for r in fitted if q.name in r.outputs]
        noise[i] = next((std for std in stds if std), np.inf)
        if any(r.output_loss.get(q.name) == "huber" for r in fitted):
            corner[i] = CORNER
    tuning = of_weights(
        settled,
        widths=widths,
        force_std={name: std for name, std in posed.weights.W.items() if name in found.soft},
        noise=noise,
        corner=corner,
        stages=1,
        sampling=fitted[0].sampling,
        gap=gap_limit(fitted[0]),
        notes=found.notes,
    )
    # a force that enters a reading at once is averaged over the stage that begins with it (`ocp/pieces.py`)
    at_once = ca.jacobian_sparsity(posed.dae.output, ca.vertcat(posed.dae.dx, posed.dae.z, posed.dae.w)).nnz() > 0
    return tuning if at_once else replace(tuning, stages=_stages(tuning, found))


def of_weights(settled: Problem, *, force_std: Mapping[str, float], **facts: Any) -> Tuning:
    """The settings for a problem with all weights and widths; force_std: place of the posed problem -> std; facts: the other fields."""
    posed = settled.posed
    index = {p.name: k for k, p in enumerate(posed.dae.places)}
    numbered = {index[name]: std for name, std in force_std.items() if name in index}
    return Tuning(asked=settled, problem=posed, force_std=numbered, laws=friction_laws(posed), **facts)


def _stages(tuning: Tuning, found: _Found) -> int:
    """Stages between two samples with which none of the outputs is wrong by more than EXACT of its noise from one to the next.

    Judged where the trajectory of the first recording goes, against twice as many; where the inputs jump, AT_JUMPS is good enough.
    There fast lags (a current, a valve) are far from rest, and nowhere else.
    """
    dae, horizon, sampling = tuning.problem.dae, found.followed.horizons[0], tuning.sampling
    stage = Stage(dae, (), found.parameters, tuple(sorted(tuning.force_std)), 2)
    predicted, h = Prediction(stage), ca.Function("h", [dae.x, dae.u, dae.p, dae.t], [dae.undisturbed(dae.output)])
    usual = np.linspace(horizon.time[0], horizon.time[-1], LOOKED_AT + 2)[1:-1]
    times = np.concatenate([usual, _jumps(horizon)])
    x, u = found.followed.at(0, times)[1], horizon.input_at(times)
    rest = np.ones(stage.numbers - 2 - 2 * len(dae.inputs))  # nothing of it says how the balances go on, but a scale of zero is none

    def ends(count: int) -> Array:
        reached = []
        for state, held, time in zip(x.T, u.T, times, strict=True):
            now = state
            for k in range(count):
                d = np.concatenate([[sampling / count, time + k * sampling / count], held, held, rest])
                now = predicted(now, np.empty(0), d, stage.at_rest)[0]
            reached.append(np.asarray(h(now, held, found.parameters, time + sampling)).ravel())
        return np.array(reached)

    count, coarse = 1, ends(1)
    while count < FINEST:
        fine = ends(2 * count)
        error = np.abs(fine - coarse) / tuning.noise
        parts = (error[:LOOKED_AT], EXACT), (error[LOOKED_AT:], AT_JUMPS)
        if all(np.quantile(e, FEW, axis=0).max(initial=0.0) <= bound for e, bound in parts if len(e)):
            break
        count, coarse = 2 * count, fine
    return count


def _jumps(horizon: Horizon) -> Array:
    """Times at which a held input jumps as it usually does not, at most LOOKED_AT of them."""
    if horizon.hold != "zero":
        return np.empty(0)
    size = np.abs(np.diff(horizon.inputs, axis=0))
    times = horizon.changes[1:][(size > SUDDEN * np.median(size, axis=0)).any(axis=1)]
    times = times[(times > horizon.time[0]) & (times < horizon.time[-1])]
    return np.asarray(times[:: len(times) // LOOKED_AT + 1])


def _leading(recording: Recording, rows: int) -> Recording:
    """Its first rows."""
    if len(recording.time) <= rows:
        return recording
    return rows_of(recording, slice(0, rows))


def _robust(recording: Recording) -> Recording:
    """Gross errors are looked for in outputs of which nobody said that they have none."""
    loss = {name: "auto" if given == "square" else given for name, given in recording.output_loss.items()}
    return replace(recording, output_loss=loss)
