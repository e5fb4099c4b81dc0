"""The mesh of a smoothing run: fine enough for the smoother's own bandwidth and for the steps of the input, and no finer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backsight.ocp import Horizon, Mesh
from backsight.ocp.follow import MET, Followed, follow
from backsight.ocp.linear import Linear, direct_share, driven_outputs, fastest_rate, left_out_of_outputs, linearise, without_followers
from backsight.ocp.pieces import direct

from ..problem import Problem
from ..recordings.outliers import screened
from .families import UNDECIDED
from .horizons import make_horizon, sample_density, sampling_interval

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

RESOLUTION = 0.8  # mesh step times the fastest mode of the smoother
LONGEST = 5.0  # mesh step over the sampling interval, at most
FINEST = 0.5  # and at least, where nobody says otherwise
FOLLOWED = (5, 2, 1)  # sampling intervals in one of the mesh on which samples are followed: whole ones, for an input steps at samples
STEPS_UNSEEN = 0.02  # of an output's noise: what a step of the input may move between two knots without a knot of its own
STEPS_FOLLOWED = 1.0  # the same where samples are but followed
LOOKED_AT = 40  # places of a recording where the model is linearised
DIRECT = 0.02  # share of a reading's noise that may be a force that enters it at once before the mesh has its knots at the samples
FELT = 0.9  # of the places stay below what is felt at the others: a body that mostly sticks feels nothing there
UNFELT = 0.02  # of what all samples together resolve: residual forces that move every output by less are none


@dataclass(frozen=True, kw_only=True)
class Meshed:
    """Horizons on their meshes; rigid: whether the weights W leave the residual forces no room.

    least_std: place -> std of a residual force that moves some output, or adds to its noise, by no more than all its samples together
    resolve: no smaller one can be told from none.
    """

    horizons: list[Horizon]
    rigid: bool
    least_std: dict[int, float]


def follow_closely(problem: Problem, stds: list[dict[str, float]], step: float | None) -> Followed:
    """Splines through the samples on the coarsest mesh on which they meet them, of LONGEST sampling intervals at most and one at least.

    A given step [s] is taken as it is. On this mesh parameters and weights are found before the mesh that they ask for. So it has
    knots where the held input steps, if an output notices: inside an interval a balance that is a mean over it would read the step
    as a force, and the parameters would bend to explain it.
    """
    for count in FOLLOWED:
        horizons = [
            make_horizon(problem.dae, screened(r), std, problem.known_at(r), step or count * sampling_interval(r))
            for r, std in zip(problem.fitted, stds, strict=True)
        ]
        followed = follow(problem.dae, horizons, problem.values)
        if step is None and followed.mean_square <= MET:
            split = _stepping_at_knots(problem, followed, stds)
            followed = followed if split is None else follow(problem.dae, split, problem.values)
        if step or followed.mean_square <= MET:
            break
    return followed


def _stepping_at_knots(problem: Problem, followed: Followed, stds: list[dict[str, float]]) -> list[Horizon] | None:
    """The horizons with knots at the input's steps that an output notices; None where there are none."""
    out = []
    for number, (horizon, table) in enumerate(zip(followed.horizons, stds, strict=True)):
        times = np.linspace(horizon.time[0], horizon.time[-1], LOOKED_AT + 2)[1:-1]
        dx, x, z = followed.at(number, times)
        places = linearise(problem.dae, dx, x, z, horizon.input_at(times), horizon.clock + times, problem.values, ())
        out.append(_split_at_steps(problem, horizon, places, table, 2, STEPS_FOLLOWED))
    return out if any(h.mesh.count > f.mesh.count for h, f in zip(out, followed.horizons, strict=True)) else None


def _split_at_steps(problem: Problem, horizon: Horizon, places: Linear, table: dict[str, float], degree: int, unseen: float) -> Horizon:
    """A knot at every step of the held input that moves an output by more than `unseen` of its noise between two knots."""
    noise = np.array([table.get(q.name, np.inf) for q in problem.dae.outputs])
    for _ in range(int(LONGEST)) if horizon.hold == "zero" else ():
        moved = left_out_of_outputs(places, horizon.unresolved_step(degree), horizon.unresolved_impulse(degree), horizon.mesh.steps)
        noticed = np.max(moved / noise[:, None], axis=0, initial=0.0) > unseen
        split = horizon.split_at_steps(noticed)
        if split.mesh.count == horizon.mesh.count:
            break
        horizon = split
    return horizon


def mesh(
    problem: Problem,
    followed: Followed,
    stds: list[dict[str, float]],
    force_std: dict[int, float],
    parameters: Array,
    degree: int,
    step: float | None,
    finest: float,
) -> Meshed:
    """Meshes for all fitted recordings, of steps of `finest` sampling intervals at least, but for steps of the input.

    A given step [s] is taken as it is. Else: step * (fastest mode of the smoother) <= RESOLUTION at the given weights, but for modes of
    states that only follow the rest; knots where the input steps, as far as an output could notice.
    """
    soft = sorted(force_std)
    std = np.array([force_std[k] for k in soft])
    horizons, rigid, least = [], bool(soft), np.full(len(soft), np.inf)
    for number, (recording, table) in enumerate(zip(problem.fitted, stds, strict=True)):
        horizon = followed.horizons[number]
        times = np.linspace(horizon.time[0], horizon.time[-1], LOOKED_AT + 2)[1:-1]
        dx, x, z = followed.at(number, times)
        places = linearise(problem.dae, dx, x, z, horizon.input_at(times), horizon.clock + times, parameters, soft)
        density = sample_density(problem.dae, recording, table)
        dt, rate = sampling_interval(recording), fastest_rate(without_followers(places), std, density)
        span = float(recording.time[-1] - recording.time[0])
        resolved = np.sqrt(density / span)  # what the mean of all samples of an output tells
        # of a force of std one, over what can be felt
        felt = np.max(driven_outputs(places, span, FELT) / resolved[:, None], axis=0)
        felt = np.maximum(felt, _felt_as_noise(places, density, len(recording.time)))
        rigid_here = bool(np.all(felt * std < UNFELT))
        least = np.minimum(least, np.where(felt > 0, 1.0 / np.where(felt > 0, felt, 1.0), least))
        at_once = direct_share(places, std, density) > DIRECT
        longest = 1.0 if rigid_here else LONGEST
        own = float(np.clip(RESOLUTION / rate if rate > 0 else np.inf, finest * dt, longest * dt))
        made = make_horizon(problem.dae, recording, table, problem.known_at(recording), step or own)
        if at_once and step is None:
            made = replace(made, mesh=_at_readings(problem, horizon, soft, LONGEST * own))
        horizons.append(made if step else _split_at_steps(problem, made, places, table, degree, STEPS_UNSEEN))
        rigid &= rigid_here
    return Meshed(horizons=horizons, rigid=rigid, least_std={k: float(s) for k, s in zip(soft, least, strict=True) if np.isfinite(s)})


def _at_readings(problem: Problem, horizon: Horizon, soft: Sequence[int], longest: float) -> Mesh:
    """Knots where outputs are read that white forces enter at once, unless these are further apart than `longest` [s]: then in all rows.

    A reading and the motion share such a force where it is the mean over one interval (`ocp/pieces.py`).
    """
    rows = sorted(set(direct(problem.dae, soft)[1].sparsity().row()))
    read = np.any(np.isfinite(horizon.target[:, rows]), axis=1)
    read[[0, -1]] = True
    knots = horizon.time[read]
    return Mesh(knots if np.max(np.diff(knots)) <= longest else horizon.time)


def _felt_as_noise(places: Linear, density: Array, samples: int) -> Array:
    """What a residual force of std one that enters a reading at once adds to its noise, over what n samples tell of that, (n_soft,).

    A force of std s adds s^2 D^2 to the density R of the noise, of which n samples tell the share sqrt(2/n), and UNDECIDED of that is
    nothing: felt where (s felt)^2 > 1.
    """
    entering = np.median(places.D**2, axis=0) / density[:, None]
    return np.asarray(np.sqrt(np.max(entering, axis=0, initial=0.0) / (UNDECIDED * np.sqrt(2.0 / samples))), dtype=np.float64)
