"""A start for what no output shows: a load behind a shaft, a current, a second angle.

Samples cannot be followed where there are none. There the model says how the unseen states go with the seen ones, at the first guesses
of the parameters: a smoothing problem with the parameters held and little room for residual forces. A friction law would hold an unseen
body that starts at rest, so its sign is rounded generously at first and sharpened from solve to solve. Lags (`driven.py`) are simulated
instead; where there is nothing else to complete, the parameters come with them (`driven_fit.py`). So is a part that sticks and slips, whose
parameters are searched for (`driven_search.py`).
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from backsight.ocp import Options, ParameterPrior, Solver, transcribe
from backsight.ocp.follow import Followed
from backsight.ocp.linear import driven_outputs, linearise
from backsight.ocp.polynomials import Array
from backsight.ocp.scaling import scaled

from ..problem import Problem
from .along import forces
from .common_factor import KnownForces
from .driven import Driven, lags_of, own_rows, simulated, stopping
from .driven_fit import Seen, fitted, known_start, known_std
from .driven_search import searched
from .initial_guess import start_decisions
from .rest import ROUNDING, FrictionLaw, left_alone, rounded

ROUNDED = (1e3, 1.0, 0.3, 0.1)  # widths of the friction laws over the rms of their velocities, from solve to solve
TOLD = 0.01  # of the outputs' own variation: what residual forces may move them in a tenth of the record
STARTS = 8  # of the fit of a body that nothing shows, at most: its resonance has to be met
LOOKED_AT = 20  # places of a recording where the model is linearised
OPTIONS = Options(tolerance=1e-3, gauss_newton_iterations=20, max_passes=1)  # of a start: what comes after moves it again


def unseen_states(problem: Problem) -> list[str]:
    """States that no recorded output looks at, and that are neither velocity nor position of one that is looked at."""
    dae = problem.dae
    recorded = {name for r in problem.fitted for name in r.outputs}
    output = ca.vertcat(*(dae.output[i] for i, q in enumerate(dae.outputs) if q.name in recorded))
    seen = {i for symbols in (dae.x, dae.dx) for i in ca.jacobian_sparsity(output, symbols).get_col()}
    seen |= {j for i, j, _ in dae.kinematics if i in seen} | {i for i, j, _ in dae.kinematics if j in seen}
    return [q.name for i, q in enumerate(dae.states) if i not in seen]


def complete(problem: Problem, followed: Followed, laws: tuple[FrictionLaw, ...], start: Array) -> tuple[Followed, Array, float]:
    """The followed trajectories with the unseen states moved as the model moves them, at which parameters (np_all,), and how well.

    Lags, and bodies driven by what is seen, bring parameters along with which they balance that; then the share of its forces that a
    balance leaves over at most. Else parameters are those given, and nobody knows: 1. Free parameters have a std about their guesses.
    """
    rows, driven = lags_of(problem.dae, set(unseen_states(problem))), driven_rows(problem, laws)
    if driven and problem.free:
        gently = rounded(problem, left_alone(problem, laws), followed, start, ROUNDED[-1])
        parameters, share = fitted(problem, driven, followed, gently, 1 if driven == rows else STARTS)
        return simulated(Driven(problem.dae, driven), followed, parameters), parameters, share
    return _completed(problem, simulated(Driven(problem.dae, rows), followed, start) if rows else followed, laws, start), start, 1.0


def of_the_right_size(problem: Problem, followed: Followed, laws: tuple[FrictionLaw, ...], start: Array) -> tuple[Problem, Array]:
    """The problem and start (np_all,) with guesses that are off by decades together brought near (`common_factor.py`).

    A parameter with a std is known, and stays.
    """
    rows = driven_rows(problem, laws)
    guessed = tuple(i for i, std in zip(problem.free, known_std(problem, list(problem.free)), strict=True) if np.isinf(std))
    known = KnownForces(problem, rows, followed, guessed)
    factor = known.factor(start) if rows else 1.0
    return (problem, start) if factor == 1.0 else known.multiplied(start, factor)


def driven_rows(problem: Problem, laws: tuple[FrictionLaw, ...]) -> dict[int, int]:
    """All unseen states, state -> its row of the residual, where they are lags or driven by what is seen and no law can hold them."""
    unseen = set(unseen_states(problem))
    rows = lags_of(problem.dae, unseen)
    if problem.dae.algebraics:
        return {}
    if len(rows) == len(unseen):
        return rows
    return {} if sticking(problem, laws) else own_rows(problem.dae, unseen)


def _completed(problem: Problem, followed: Followed, laws: tuple[FrictionLaw, ...], start: Array) -> Followed:
    """A smoothing problem with the parameters held and little room for the residual forces of the unseen."""
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    own = moving_unseen(problem)
    for share in ROUNDED:
        parameters = rounded(problem, laws, followed, start, share)
        # what moves what is seen may be anything yet: only the unseen is to go as the model says
        loose = forces(problem, followed, parameters, taut=True)
        room = np.sqrt(np.median(np.concatenate([h.mesh.steps for h in followed.horizons])))
        force_std = {k: std if k in own else room * loose[k] for k, std in _little_room(problem, followed, parameters).items()}
        t = transcribe(problem.dae, followed.horizons, free=(), prior=nothing, force_std=force_std, degree=2)
        solver, begin = Solver(t.nlp, OPTIONS), start_decisions(t, followed, parameters)
        unbounded = np.full(t.nlp.size, np.inf)
        solved = solver.solve(begin, scaled(solver, begin, t.nlp.values(parameters)), lower=-unbounded, upper=unbounded, newton=False)
        followed = Followed(transcription=t, horizons=followed.horizons, decisions=solved.decisions, mean_square=followed.mean_square)
        if not laws:
            break
    return followed


def sought(
    problem: Problem, followed: Followed, laws: tuple[FrictionLaw, ...], start: Array, say: Callable[[str], None]
) -> tuple[Followed, Array] | None:
    """The followed trajectories with the unseen states driven by them, at the parameters (np_all,) that balance what is seen best.

    None where no friction law can hold what is unseen, where that has no balances to itself, or all of them (a lag hides every body): the
    others are found without (`complete`); and where no try of the search ends anywhere. Free parameters have a std about their guesses;
    where none is only the start is sought.
    """
    part = sticking(problem, laws)
    if part is None or not Seen(problem, part, followed, start).rows:
        return None
    alone = left_alone(problem, laws)
    begun = rounded(problem, alone, simulated(part, followed, start), start, ROUNDING)
    parameters = searched(problem, part, followed, begun, say)
    if parameters is None:
        return None
    seen = Seen(problem, part, followed, start)

    def moved(parameters: Array) -> Followed:
        firsts = []
        for number, horizon in enumerate(followed.horizons):
            t = part.instants(followed, number)
            along = part.along(followed, number, (t[1:] + t[:-1]) / 2)
            told = seen.begun if problem.free else seen.shot  # at parameters that a search has found more fits than what is right
            firsts.append(told(t, along, parameters, known_start(horizon)[list(part.rows)]))
        return simulated(part, followed, parameters, firsts)

    parameters = rounded(problem, alone, moved(parameters), parameters, ROUNDING)
    return moved(parameters), parameters


def sticking(problem: Problem, laws: tuple[FrictionLaw, ...]) -> Driven | None:
    """The unseen states as a part that is driven by the seen ones and may come to rest in friction laws; None where there is none."""
    rows = own_rows(problem.dae, set(unseen_states(problem)))
    velocities = stopping(problem.dae, rows, [law.velocity for law in laws])
    return Driven(problem.dae, rows, velocities=velocities) if velocities else None


def moving_unseen(problem: Problem) -> set[int]:
    """Places whose balances accelerate unseen states only."""
    dae = problem.dae
    unseen = {i for i, q in enumerate(dae.states) if q.name in set(unseen_states(problem))}
    positions = {i for i, _, _ in dae.kinematics}
    found = set()
    for row, equation in enumerate(dae.equations):
        moved = set(ca.jacobian_sparsity(dae.residual[row], dae.dx).get_col()) - positions
        if equation.place is not None and moved and moved <= unseen:
            found.add(int(equation.place))
    return found


def _little_room(problem: Problem, followed: Followed, parameters: Array) -> dict[int, float]:
    """Standard deviations of the residual forces that hardly move the outputs by themselves: place -> [unit of the place * sqrt(s)]."""
    dae, places = problem.dae, range(len(problem.dae.places))
    moved = np.zeros(len(places))
    for number, horizon in enumerate(followed.horizons):
        times = np.linspace(horizon.time[0], horizon.time[-1], LOOKED_AT + 2)[1:-1]
        dx, x, z = followed.at(number, times)
        linear = linearise(dae, dx, x, z, horizon.input_at(times), horizon.clock + times, parameters, places)
        spread = np.array([np.nanstd(y) if np.isfinite(y).any() else np.nan for y in horizon.target.T])
        span = float(horizon.time[-1] - horizon.time[0])
        relative = driven_outputs(linear, span / 10)[spread > 0] / spread[spread > 0, None]
        moved = np.maximum(moved, np.max(relative, axis=0, initial=0.0))
    return {k: TOLD / m if m > 0 else 1.0 for k, m in zip(places, moved.tolist(), strict=True)}
