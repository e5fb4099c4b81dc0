"""The columns of estimates.csv for one piece of a recording, from the solution of the posed problem, under the user's own names."""

from __future__ import annotations

import numpy as np

from backsight.models.quadratures import integrated
from backsight.ocp import Solution
from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import legendre

from ..problem import Problem
from ..recordings.drive import drive_of
from ..recordings.recording import Recording
from ..supposed import left_out, noisy_inputs, spans

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def columns(problem: Problem, solution: Solution, number: int, recording: Recording) -> dict[str, Array]:
    """Horizon `number`: t_s, outputs with .measured and .std, then with .std the states, residual forces, what drifts, measured inputs.

    recording: the whole, of which the piece is a part.
    """
    piece, s = problem.fitted[number], solution.sampled(number)
    states = {q.name: (s.states[:, i], s.states_std[:, i]) for i, q in enumerate(problem.posed.dae.states)}
    states |= _left_out(problem, solution, number)
    out: dict[str, Array] = {"t_s": piece.time}
    for i, q in enumerate(problem.dae.outputs):
        out[q.name] = s.outputs[:, i]
        if q.name in recording.outputs:
            out[f"{q.name}.measured"] = piece.outputs.get(q.name, np.full(len(piece.time), np.nan))
        out[f"{q.name}.std"] = s.outputs_std[:, i]
    found = {q.name: states[q.name] for q in problem.dae.states}
    soft = solution.transcription.soft
    for k, place in enumerate(problem.posed.dae.places):
        name = f"residual.{place.name}"
        if name in states:
            found[name] = states[name]
        elif place.name not in places(problem):
            continue
        elif k in soft:
            found[name] = s.forces[:, soft.index(k)], s.forces_std[:, soft.index(k)]
        else:
            # so little freedom that the data cannot say anything about it: what is known is what was supposed
            step = solution.transcription.horizons[number].mesh.steps.mean()
            supposed = problem.weights.W.get(place.name, 0.0) / np.sqrt(step)
            found[name] = np.zeros(len(piece.time)), np.full(len(piece.time), supposed)
    found |= {name: states[name] for name, free in problem.varying.items() if free.drift is not None}
    found |= {name: _acting(problem, solution, number, name) for name in noisy_inputs(problem)}
    for name, (value, std) in found.items():
        out[name], out[f"{name}.std"] = value, std
    return out


def places(problem: Problem) -> dict[str, str]:
    """Places of residual forces that the user knows -> their units."""
    own = {p.name for p in problem.dae.places} | problem.weights.W.keys()
    return {p.name: p.unit for p in problem.posed.dae.places if p.name in own}


def _left_out(problem: Problem, solution: Solution, number: int) -> dict[str, tuple[Array, Array]]:
    """The states that nothing depends on, from a start of no meaning: how far they went is told, where they were is not."""
    gone = left_out(problem)
    if not gone:
        return {}
    t, dae, time = solution.transcription, problem.dae, solution.transcription.horizons[number].time
    both = np.interp(np.arange(2 * len(time) - 1) / 2, np.arange(len(time)), time)  # the samples, and the middle between them
    found = Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions).at(number, both)[1]
    rows = {q.name: row for q, row in zip(problem.posed.dae.states, found, strict=True)}
    x = np.array([rows.get(q.name, np.zeros(len(both))) for q in dae.states])
    values = integrated(dae, gone, time, x)
    return {dae.states[g.state].name: (value, np.full(len(time), np.inf)) for g, value in zip(gone, values, strict=True)}


def _acting(problem: Problem, solution: Solution, number: int, name: str) -> tuple[Array, Array]:
    """An input as it acted, and its standard deviation: the recorded values u_k plus the mean of what was wrong while each acted.

    The data take from that mean's variance std^2 what they take from the polynomials of degree K - 1 that the mesh resolves (read in the
    middle, which is exact for K = 2); where intervals are shorter than a recorded value lasts, it is the same in all of them, for
    what the data tell is smooth beside a sample. The last value acts after the end: only what was recorded is known of it.
    """
    t, piece = solution.transcription, problem.fitted[number]
    drive, std = drive_of(piece), noisy_inputs(problem)[name]
    recorded = drive.inputs[name]
    rows = np.clip(np.searchsorted(drive.time, piece.time, side="right") - 1, 0, len(drive.time) - 1)
    place = [p.name for p in t.dae.places].index(f"input:{name}")
    if place not in t.soft:
        return recorded[rows], np.full(len(rows), std)
    mesh, whole = t.horizons[number].mesh, spans(t.horizons[number])
    ends = np.maximum(whole, mesh.knots[0])  # what acts before the first row is not felt
    edges = np.union1d(ends, mesh.knots[(mesh.knots > ends[0]) & (mesh.knots < ends[-1])])
    middle = (edges[1:] + edges[:-1]) / 2
    owner, (interval, tau) = np.searchsorted(ends, middle) - 1, mesh.locate(middle)
    i = t.soft.index(place)
    value, variance = (part[:, i] for part in solution.forces.at(interval + t.offsets[number], tau))
    density = t.force_std_at(solution.values)[i, interval + t.offsets[number]] ** 2
    # a value that lasts longer than others in its interval has as much more of what the interval is off
    share = np.diff(edges) / np.diff(ends)[owner] * std**2 * np.diff(whole)[owner] / density
    supposed = density * np.sum(legendre(t.degree, tau) ** 2, axis=0) / mesh.steps[interval]

    def of_each(parts: Array) -> Array:
        return np.asarray(np.bincount(owner, weights=parts, minlength=len(recorded)), dtype=np.float64)

    told = of_each(share * np.sqrt(np.maximum(supposed - variance, 0.0))) ** 2
    return (recorded + of_each(share * value))[rows], np.sqrt(np.maximum(std**2 - told, 0.0))[rows]
