"""A start for what no output shows: a load behind a shaft, a current, a second angle.

Samples cannot be followed where there are none. Often the balances of what is seen tell it all the same: the torque of a shaft is what a
seen inertia cannot explain, the twist that torque over a stiffness, and the speed of the load follows from the twist. Where every unseen
state is told so (`telling_places`), these balances need no better start than that. Elsewhere the model says how the unseen states go
with the seen ones, at the first guesses of the parameters: a smoothing problem with the parameters held and little room for residual
forces. A friction law would hold an unseen body that starts at rest, so its sign is rounded generously at first and sharpened from solve
to solve.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import structural_rank

from backsight.ocp import Options, ParameterPrior, Solver, transcribe
from backsight.ocp.follow import Followed
from backsight.ocp.linear import driven_outputs, linearise
from backsight.ocp.passing import passing_through
from backsight.ocp.polynomials import Array
from backsight.ocp.scaling import scaled

from ..problem import Problem
from .along import forces
from .initial_guess import start_decisions
from .rest import FrictionLaw, rms_velocity

ROUNDED = (1e3, 1.0, 0.3, 0.1)  # widths of the friction laws over the rms of their velocities, from solve to solve
TOLD = 0.01  # of the outputs' own variation: what residual forces may move them in a tenth of the record
NEWTON_STEPS = 20
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


def telling_places(problem: Problem) -> frozenset[int]:
    """Places whose balances together tell every unseen state, whatever the free parameters are; none where some stay untold.

    They are balances of what is seen, and a guess must not matter there but for the size of what is unseen: dF/dp = 0 for every free p
    where the unseen states are zero. With the equations that hold exactly they must determine all unseen states and algebraic variables:
    the pattern of these has full structural rank (an unseen state counts where its rate does; a telling balance is solved for it along
    the whole trajectory).
    """
    dae = problem.dae
    names = set(unseen_states(problem))
    unseen = [i for i, q in enumerate(dae.states) if q.name in names]
    if not unseen or not problem.free:
        return frozenset()
    hidden = ca.vertcat(*(s[i] for s in (dae.x, dae.dx) for i in unseen))
    guesses = ca.vertcat(*(dae.p[i] for i in problem.free))
    bent = ca.substitute(ca.jacobian(dae.residual, guesses), hidden, ca.SX.zeros(hidden.shape[0]))
    own = _moving_unseen(problem)
    sure = [ca.simplify(ca.densify(bent[r, :])).is_zero() for r in range(bent.shape[0])]
    certain = [r for r, e in enumerate(dae.equations) if e.place is None or (e.place not in own and sure[r])]
    pattern = np.zeros((len(certain), len(unseen) + dae.z.shape[0]), dtype=bool)
    for row, r in enumerate(certain):
        for symbols in (dae.x, dae.dx):
            columns = set(ca.jacobian_sparsity(dae.residual[r], symbols).get_col())
            pattern[row, : len(unseen)] |= np.isin(unseen, list(columns))
        pattern[row, len(unseen) + np.array(ca.jacobian_sparsity(dae.residual[r], dae.z).get_col(), dtype=np.int64)] = True
    if structural_rank(csr_matrix(pattern)) < pattern.shape[1]:
        return frozenset()
    return frozenset(int(place) for r in certain if (place := dae.equations[r].place) is not None)


def complete(problem: Problem, followed: Followed, laws: tuple[FrictionLaw, ...], start: Array) -> Followed:
    """The followed trajectories with the unseen states moved as the model, at parameters start (np_all,), moves them."""
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    followed = _settled(problem, followed, start)
    own = _moving_unseen(problem)
    for rounded in ROUNDED:
        parameters = start.copy()
        for law in laws:
            parameters[law.width] = rounded * (rms_velocity(problem, law, followed, parameters) or 1.0)
        # what moves what is seen may be anything yet: only the unseen is to go as the model says
        loose = forces(problem, followed, parameters)
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


def _settled(problem: Problem, followed: Followed, parameters: Array) -> Followed:
    """Followed trajectories with every unseen state of first order where its own balance lets it rest at that instant.

    A lag is then near its input, and not at zero, where a law may be singular (a thrust has no slope at rest).
    """
    dae, t = problem.dae, followed.transcription
    unseen, alone = set(unseen_states(problem)), {}
    moved = {i for i, _, _ in dae.kinematics} | {j for _, j, _ in dae.kinematics}
    for row, equation in enumerate(dae.equations):
        rates = set(ca.jacobian_sparsity(dae.residual[row], dae.dx).get_col())
        if equation.place is not None and len(rates) == 1 and not rates & moved and dae.states[min(rates)].name in unseen:
            alone[min(rates)] = row
    if not alone:
        return followed
    x, F = ca.vertcat(*(dae.x[i] for i in alone)), dae.residual[list(alone.values())]
    here = ca.substitute(F, ca.vertcat(dae.dx, dae.w), ca.SX.zeros(dae.dx.shape[0] + dae.w.shape[0]))
    step = ca.Function("step", [dae.x, dae.z, dae.u, dae.p, dae.t], [x - ca.solve(ca.jacobian(here, x), here)])
    first = np.array([dae.states[i].start or dae.states[i].nominal for i in alone])

    def curve(number: int, times: Array) -> tuple[Array, Array]:
        _, states, z = followed.at(number, times)
        horizon, now = followed.horizons[number], np.repeat(first[:, None], len(times), axis=1)
        for _ in range(NEWTON_STEPS):
            states[list(alone)] = now
            now = np.asarray(step.map(len(times))(states, z, horizon.input_at(times), parameters, horizon.clock + times[None, :]))
        usable = np.isfinite(now).all(axis=0)
        states[list(alone)] = np.where(usable, now, first[:, None])
        return states, z

    return replace(followed, decisions=np.concatenate([passing_through(t, curve), followed.decisions[t.nlp.trajectory_size :]]))


def _moving_unseen(problem: Problem) -> set[int]:
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
