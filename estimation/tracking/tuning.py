"""What an estimator is set to before its first sample: the weights and widths that a study leaves open, and how fine its stages are.

They are found as filters are tuned, off-line on a recording: by smoothing the first rows of the fitted ones. Only W, V, the widths of
friction laws and the mesh come from there; parameters and states start from what the problem says of them and are found on-line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from backsight.models.errors import InputError
from backsight.ocp import Solution
from backsight.ocp.follow import Followed
from backsight.ocp.moving.prediction import Prediction
from backsight.ocp.moving.stage import Stage

from ..problem import Problem
from ..recordings.gaps import gap_limit
from ..recordings.recording import Recording
from ..smoothing.rest import FrictionLaw, friction_laws
from ..smoothing.robust import CORNER
from ..smoothing.smoother import smooth

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ROWS = 5000  # of a recording, at most, that are smoothed
GROSS = 4.0  # deviations from which on a sample is suspected of being wrong, unless its output has a loss of its own
FINEST = 16  # stages between two samples, at most
EXACT = 0.1  # of the noise: what the stages may be wrong by from sample to sample
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
    """The settings for a problem. Raises InputError where the leading rows cannot be smoothed."""
    fitted = [r for r in problem.recordings if r.role == "fit"]
    answer = smooth(replace(problem, recordings=[_robust(_leading(r, ROWS // len(fitted))) for r in fitted]), progress=progress)
    solution = answer.solution
    if solution is None or not answer.solver.converged:
        raise InputError(
            f"{fitted[0].name}: its first rows cannot be smoothed ({answer.solver.status}), and the weights left open cannot be found; "
            "give better guesses, or W of every place and V of every output."
        )
    t = solution.transcription
    widths = {
        p.name: float(solution.parameters[i]) for i, p in enumerate(t.dae.parameters) if p.smoothing and p.name not in problem.parameters
    }
    known = {p.name for p in problem.dae.parameters}
    widths = {name: value for name, value in widths.items() if name in known}
    settled = replace(problem, weights=answer.weights, parameters={**problem.parameters, **widths})
    posed, soft = settled.posed, {t.dae.places[k].name for k in t.soft}
    noise, corner = np.full(len(posed.dae.outputs), np.inf), np.full(len(posed.dae.outputs), GROSS)
    for i, q in enumerate(posed.dae.outputs):
        stds = [answer.weights.noise(q.name, r.name) or r.output_std.get(q.name) for r in fitted if q.name in r.outputs]
        noise[i] = next((std for std in stds if std), np.inf)
        if any(r.output_loss.get(q.name) == "huber" for r in fitted):
            corner[i] = CORNER
    found = of_weights(
        settled,
        widths=widths,
        force_std={name: std for name, std in posed.weights.W.items() if name in soft},
        noise=noise,
        corner=corner,
        stages=1,
        sampling=fitted[0].sampling,
        gap=gap_limit(fitted[0]),
        notes=tuple(note for note in answer.notes if note.startswith(("W of", "V of"))),
    )
    # a force that enters a reading at once is averaged over the stage that begins with it (`ocp/pieces.py`)
    at_once = ca.jacobian_sparsity(posed.dae.output, ca.vertcat(posed.dae.dx, posed.dae.z, posed.dae.w)).nnz() > 0
    return found if at_once else replace(found, stages=_stages(found, solution))


def of_weights(settled: Problem, *, force_std: Mapping[str, float], **facts: Any) -> Tuning:
    """The settings for a problem with all weights and widths; force_std: place of the posed problem -> std; facts: the other fields."""
    posed = settled.posed
    index = {p.name: k for k, p in enumerate(posed.dae.places)}
    numbered = {index[name]: std for name, std in force_std.items() if name in index}
    return Tuning(asked=settled, problem=posed, force_std=numbered, laws=friction_laws(posed), **facts)


def _stages(tuning: Tuning, solution: Solution) -> int:
    """Stages between two samples with which none of the outputs is wrong by more than EXACT of its noise from one to the next.

    Judged where the smoothed trajectory of the first recording goes, against twice as many.
    """
    dae, horizon, sampling = tuning.problem.dae, solution.transcription.horizons[0], tuning.sampling
    stage = Stage(dae, (), solution.parameters, tuple(sorted(tuning.force_std)), 2)
    predicted, h = Prediction(stage), ca.Function("h", [dae.x, dae.u, dae.p, dae.t], [dae.undisturbed(dae.output)])
    times = np.linspace(horizon.time[0], horizon.time[-1], LOOKED_AT + 2)[1:-1]
    followed = Followed(transcription=solution.transcription, horizons=solution.transcription.horizons, decisions=solution.solved.decisions)
    x, u = followed.at(0, times)[1], horizon.input_at(times)
    nothing = np.zeros(stage.numbers - 2 - 2 * len(dae.inputs))

    def ends(count: int) -> Array:
        found = []
        for state, held, time in zip(x.T, u.T, times, strict=True):
            now = state
            for k in range(count):
                d = np.concatenate([[sampling / count, time + k * sampling / count], held, held, nothing])
                now = predicted(now, np.empty(0), d)[0]
            found.append(np.asarray(h(now, held, solution.parameters, time + sampling)).ravel())
        return np.array(found)

    count, coarse = 1, ends(1)
    while count < FINEST:
        fine = ends(2 * count)
        if np.quantile(np.abs(fine - coarse) / tuning.noise, FEW, axis=0).max(initial=0.0) <= EXACT:
            break
        count, coarse = 2 * count, fine
    return count


def _leading(recording: Recording, rows: int) -> Recording:
    """Its first rows."""
    if len(recording.time) <= rows:
        return recording
    inputs = {name: u[:rows] for name, u in recording.inputs.items()}
    return replace(recording, time=recording.time[:rows], inputs=inputs, outputs={name: y[:rows] for name, y in recording.outputs.items()})


def _robust(recording: Recording) -> Recording:
    """Gross errors are looked for in outputs of which nobody said that they have none."""
    loss = {name: "auto" if given == "square" else given for name, given in recording.output_loss.items()}
    return replace(recording, output_loss=loss)
