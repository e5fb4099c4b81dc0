"""What a problem supposes beyond its model, put into the model: a problem that knows white forces and constant parameters only.

    Free(per_recording)    by_case(parameter, recordings)    a parameter `<name> [<recording>]` each
    weights.tau            coloured(place)                   start: the stationary distribution
    weights.V of an input  measured_input(input)             density std^2 dt, dt the time that a recorded value acts
    Free(drift)            drifting(parameter)               density drift^2; guess, std and bounds are those of the state
    W of kinematics:...    relaxed_kinematics(state)

In the posed problem places and parameters of the model keep their indices, and states their order (`models/augmentation/`); states that
nothing depends on are left out (`models/quadratures.py`), and where a machine stands is given where nothing tells it (`models/gauges.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from backsight.models import Dae
from backsight.models.augmentation import by_case, coloured, drifting, measured_input, relaxed_kinematics, stationary_std, white_std
from backsight.models.augmentation.parameters import case_name
from backsight.models.gauges import Gauges
from backsight.models.quadratures import Ignorable, ignorable, without_ignorable

if TYPE_CHECKING:
    from backsight.ocp import Horizon, Transcription

    from .problem import Free, Problem
    from .recordings.recording import Recording

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

KINEMATICS, INPUT, PARAMETER, CASE = "kinematics:", "input:", "parameter:", "case:"
PINNED = 1e-3  # of its nominal size: std of a position that is given since nothing else tells it


def relaxable(dae: Dae) -> list[str]:
    """The places that W may name beside those of the model."""
    return [f"{KINEMATICS}{dae.states[i].name}" for i, _, _ in dae.kinematics]


def noisy_inputs(problem: Problem) -> dict[str, float]:
    """Input -> std of its recorded values, where it has one. A name that is also an output's means the output."""
    outputs = {q.name for q in problem.dae.outputs}
    return {q.name: problem.weights.V[q.name] for q in problem.dae.inputs if q.name in problem.weights.V and q.name not in outputs}


def lean(problem: Problem) -> Problem:
    """The problem without states that nothing depends on and of which nothing is known; itself where it has none."""
    dae = without_ignorable(problem.dae, {*problem.initial, *problem.bounds})
    return problem if dae is problem.dae else replace(problem, model=dae)


def standing(problem: Problem) -> Problem:
    """The problem with what speeds say nothing of given: where the machine stands as a whole, at the start of every piece.

    Itself where outputs, bounds, or what is known of the start tell it.
    """
    from .problem import Known

    bounded = {name for name, bounds in problem.bounds.items() if np.any(np.isfinite(bounds))}
    found, told, shifts = dict[tuple[str, int], dict[str, Known]](), dict[tuple[frozenset[str], frozenset[str]], list[int]](), None
    for piece in problem.fitted:
        case = frozenset(piece.outputs), frozenset(problem.known_at(piece)) | bounded
        if case not in told:
            shifts = shifts or Gauges(problem.dae, problem.values)
            told[case] = shifts.open(*case)
        if told[case]:
            open_ones = (problem.dae.states[i] for i in told[case])
            found[piece.name, piece.part] = {q.name: Known(q.start, PINNED * q.nominal) for q in open_ones}
    return replace(problem, stands=found) if found else problem


def left_out(problem: Problem) -> tuple[Ignorable, ...]:
    """The states of the problem's model that `lean` leaves out."""
    return ignorable(problem.dae, {*problem.initial, *problem.bounds})


def split(problem: Problem) -> Problem:
    """The problem in which a parameter that every recording has of its own is that many parameters, told apart by inputs."""
    own = own_parameters(problem)
    if not own:
        return problem
    dae, recordings = problem.dae, [r for r in problem.recordings if r.role == "fit"]
    parameters = dict(problem.parameters)
    for name, names in own.items():
        dae = by_case(dae, name, [r.name for r in recordings])
        each = replace(problem.varying[name], per_recording=False)
        parameters |= {name: each.guess} | dict.fromkeys(names, each)
    return replace(
        problem, model=dae, parameters=parameters, recordings=[_switched(r, [other.name for other in recordings]) for r in recordings]
    )


def plain(problem: Problem) -> Problem:
    """A problem that is split, with white forces, inputs as recorded, no drift and exact kinematics; itself where it has no others."""
    inputs, drifts = noisy_inputs(problem), problem.varying
    places = {p.name for p in problem.dae.places}
    if not (problem.weights.tau or inputs or drifts or problem.weights.W.keys() - places):
        return problem
    weights = replace(
        problem.weights,
        W={name: _white(problem, name) for name in problem.weights.W if name in places},
        V={name: std for name, std in problem.weights.V.items() if name not in inputs},
        tau={},
        kind={},
    )
    constant = {name: replace(free, drift=None) for name, free in drifts.items()}
    return replace(problem, model=problem.dae, weights=weights, parameters={**problem.parameters, **constant})


def posed(problem: Problem, simple: Problem) -> Problem:
    """A problem that is split, with all that it supposes in its model: as white forces at places, initial states and bounds.

    simple: the same as `plain` makes it, from which the rest is taken.
    """
    from .problem import Known

    if simple is problem:
        return problem
    inputs, weights = noisy_inputs(problem), problem.weights
    dae, W = problem.dae, dict(weights.W)
    initial, bounds = dict(problem.initial), dict(problem.bounds)
    for place in sorted(weights.W.keys() - {p.name for p in dae.places}):
        dae = relaxed_kinematics(dae, place.removeprefix(KINEMATICS))
    for place, tau in weights.tau.items():
        kind = weights.kind.get(place, "ou")
        dae = coloured(dae, place, tau, kind)
        initial |= {state: Known(0.0, std, always=True) for state, std in stationary_std(place, W[place], tau, kind).items()}
    for name, std in inputs.items():
        dae = measured_input(dae, name)
        W[f"{INPUT}{name}"] = std * float(np.sqrt(problem.fitted[0].input_sampling))
    info = {p.name: p for p in dae.parameters}
    for name, free in problem.varying.items():
        dae = drifting(dae, name)
        W[f"{PARAMETER}{name}"] = float(free.drift or 0.0)
        bounds[name] = (max(free.min, info[name].minimum), min(free.max, info[name].maximum))
        if free.std is not None:
            initial[name] = Known(free.guess, free.std)
    guesses: dict[str, Free | float] = {name: free.guess for name, free in problem.varying.items()}
    return replace(
        simple,
        model=dae,
        weights=replace(simple.weights, W=W),
        parameters={**problem.parameters, **guesses},
        initial=initial,
        bounds=bounds,
    )


def input_spread(problem: Problem, transcription: Transcription) -> Array:
    """Factors on the soft places' stds in a posed problem, (n_soft, N): an input that is off is so for as long as its value acts, dt_k.

    Its density std^2 dt_k has the mean (int dt_k dt)/h over an interval, to the std^2 dt that W stands for.
    """
    out = np.ones((len(transcription.soft), transcription.offsets[-1]))
    rows = [i for i, k in enumerate(transcription.soft) if transcription.dae.places[k].name.startswith(INPUT)]
    for number, horizon in enumerate(transcription.horizons):
        part, knots = slice(transcription.offsets[number], transcription.offsets[number + 1]), horizon.mesh.knots
        edges = np.union1d(spans(horizon), knots[-1])
        integral = np.concatenate([[0.0], np.cumsum(np.diff(edges) ** 2)])
        lasting = np.diff(np.interp(knots, edges, integral)) / horizon.mesh.steps
        out[rows, part] = np.sqrt(lasting / problem.fitted[0].input_sampling)
    return out


def spans(horizon: Horizon) -> Array:
    """Ends of the spans in which the recorded inputs act [s], each until the next one; where they run straight, half of the way."""
    time = horizon.changes
    return time if horizon.hold == "zero" else np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])


def own_parameters(problem: Problem) -> dict[str, list[str]]:
    """Parameter that every recording has of its own -> what it is called in each."""
    recordings = [r.name for r in problem.recordings if r.role == "fit"]
    return {name: [case_name(name, r) for r in recordings] for name, free in problem.varying.items() if free.per_recording}


def _white(problem: Problem, place: str) -> float:
    """W of a place; of one with a coloured force that of the white one which acts alike on what is slow."""
    weights = problem.weights
    tau, std = weights.tau.get(place), weights.W[place]
    return std if tau is None else white_std(std, tau, weights.kind.get(place, "ou"))


def _switched(recording: Recording, names: list[str]) -> Recording:
    own = {f"{CASE}{name}": np.full(len(recording.time), float(name == recording.name)) for name in names}
    return replace(recording, inputs={**recording.inputs, **own})
