"""What no output shows, driven by what is followed: the thrust of a rotor behind its command, the bit at the end of a soft string.

The unseen states l have balances to themselves, F_l(l', l, v, p) = 0, moved by v, which is recorded or followed. So they are simulated
along the followed samples from where they would rest, with their slopes S = dl/dp, by

    F_l((l+ - l)/h, m, v(t + h/2), p) = 0,        m = l + theta (l+ - l)

theta = 1/2 is the implicit midpoint rule. A body that stops in a friction law would ring by it, so there it is a little more. Newton's
method goes from a law's rest to where it slides: from there it climbs the rounded sign without leaping from side to side of it. Past the
peak of a breakaway its few steps may not suffice; what is not solved then is a start all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from backsight.models import Dae
from backsight.ocp.called import Called
from backsight.ocp.follow import Followed
from backsight.ocp.passing import passing_through
from backsight.ocp.polynomials import Array

RESTING, AHEAD, SLIDING = 20, 4, 8  # steps of Newton's method: to rest; from instant to instant; the same in friction
MIDDLE, DAMPED = 0.5, 0.55  # theta; in friction


def lags_of(dae: Dae, unseen: set[str]) -> dict[int, int]:
    """Unseen states of first order that nothing unseen moves but each other, and that rest somewhere: state -> its row of the residual."""
    moved = {i for i, _, _ in dae.kinematics} | {j for _, j, _ in dae.kinematics}
    hidden = {i for i, q in enumerate(dae.states) if q.name in unseen}
    found, of = dict[int, int](), dict[int, set[int]]()
    for row in range(dae.residual.shape[0]):
        rates, states = (set(ca.jacobian_sparsity(dae.residual[row], s).get_col()) for s in (dae.dx, dae.x))
        if len(rates) == 1 and rates <= (hidden & states) - moved:
            found[min(rates)], of[min(rates)] = row, states & hidden
    while alien := [i for i in found if not of[i] <= found.keys()]:
        for i in alien:
            del found[i]
    return found


def own_rows(dae: Dae, unseen: set[str]) -> dict[int, int]:
    """Rows of the residual with rates of unseen states only, one for each: state -> row; none where these are not as many."""
    hidden = [i for i, q in enumerate(dae.states) if q.name in unseen]
    rates = [set(ca.jacobian_sparsity(dae.residual[r], dae.dx).get_col()) for r in range(dae.residual.shape[0])]
    own = [r for r, there in enumerate(rates) if there and there <= set(hidden)]
    pattern = csr_matrix([[i in rates[r] for r in own] for i in hidden], shape=(len(hidden), len(own)), dtype=bool)
    row = maximum_bipartite_matching(pattern, perm_type="column")
    if len(own) != len(hidden) or (row < 0).any() or dae.algebraics:
        return {}
    return {i: own[k] for i, k in zip(hidden, row, strict=True)}


def stopping(dae: Dae, rows: Mapping[int, int], velocities: Sequence[str]) -> tuple[str, ...]:
    """Those of the velocities that the unseen states of `rows` can make zero, each independently of the others."""
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t]
    rng, state, found = np.random.default_rng(0), ca.vertcat(*(dae.x[i] for i in rows)), list[str]()
    somewhere = [rng.uniform(0.5, 1.5, a.shape) for a in arguments]
    for name in velocities if rows else ():
        A = ca.jacobian(ca.vertcat(*(dae.variables[v] for v in (*found, name))), state)
        if np.linalg.matrix_rank(np.asarray(ca.Function("A", arguments, [ca.densify(A)])(*somewhere))) > len(found):
            found.append(name)
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Run:
    """Unseen states between the instants of a horizon, m and (l+ - l)/h (n, M), with their slopes in free parameters (n, M, np)."""

    times: Array
    state: Array
    rate: Array
    state_slope: Array
    rate_slope: Array


@dataclass(frozen=True)
class Driven:
    """Unseen states of a model, state -> row, along followed trajectories.

    free: indices of the parameters that slopes are taken in; velocities: names of those of friction laws that may hold them.
    """

    dae: Dae
    rows: dict[int, int]
    free: tuple[int, ...] = ()
    velocities: tuple[str, ...] = ()

    def instants(self, followed: Followed, number: int) -> Array:
        """The samples of horizon `number` and the steps of its inputs between them."""
        horizon = followed.horizons[number]
        ends = horizon.mesh.knots[[0, -1]]
        inside = horizon.breaks[(horizon.breaks > ends[0]) & (horizon.breaks < ends[1])]
        return np.concatenate([ends[:1], inside, ends[1:]])

    def along(self, followed: Followed, number: int, times: Array) -> tuple[Array, ...]:
        """x', x, z, u and t of horizon `number`, as the model's functions take them."""
        horizon = followed.horizons[number]
        return (*followed.at(number, times), horizon.input_at(times), horizon.clock + times[None, :])

    def filled(self, along: tuple[Array, ...], state: Array, rate: Array) -> tuple[Array, ...]:
        """What `along` gives, with these unseen states and their rates, (n, M)."""
        (dx, x, *others), own = along, list(self.rows)
        dx, x = dx.copy(), x.copy()
        dx[own], x[own] = rate, state
        return dx, x, *others

    def run(self, followed: Followed, number: int, parameters: Array, first: Array | None = None) -> Run:
        """The unseen states along horizon `number`, between its samples and the steps of its inputs; first (n,): where they start."""
        instants = self.instants(followed, number)
        return self.go(instants, self.along(followed, number, (instants[1:] + instants[:-1]) / 2), parameters, first)

    def go(self, instants: Array, along: tuple[Array, ...], parameters: Array, first: Array | None = None) -> Run:
        """The unseen states from instant to instant (M + 1,), driven by x', x, z, u and t in the middles (.., M).

        first (n,): where they start; by itself where they rest.
        """
        n, h, times, theta = len(self.rows), np.diff(instants), (instants[1:] + instants[:-1]) / 2, self._theta
        if first is None:
            first = self._resting([a[:, :1] for a in along], parameters)
        else:
            first = np.concatenate([first, first, np.zeros(n * len(self.free))])
        (after,) = self._steps(len(times))(first, *along, parameters[:, None], h[None, :])
        both = np.hstack([first[:, None], after])
        S = both[2 * n :].reshape(len(self.free), n, len(instants)).transpose(1, 2, 0)
        return Run(
            times=times,
            state=both[n : 2 * n, 1:],
            rate=np.diff(both[:n]) / h,
            state_slope=S[:, :-1] + theta * np.diff(S, axis=1),
            rate_slope=np.diff(S, axis=1) / h[:, None],
        )

    def _resting(self, arguments: list[Array], parameters: Array) -> Array:
        """[l; l; dl/dp] where the balances let l rest at once, or else where the states start."""
        dx, x, z, u, t = (a.copy() for a in arguments)
        start = self.starts
        x[list(self.rows), 0], dx = start, 0 * dx
        for _ in range(RESTING):
            before = x[list(self.rows)]
            state, S = (np.asarray(a, dtype=np.float64) for a in self._rest(dx, x, z, u, t, parameters))
            x[list(self.rows)] = state
            if np.allclose(state, before, rtol=1e-12, atol=0.0):
                break
        if not (np.isfinite(state).all() and np.isfinite(S).all()):
            state, S = start[:, None], np.zeros(S.shape)
        return np.concatenate([state.ravel(), state.ravel(), S.ravel(order="F")])

    def resting(self, along: tuple[Array, ...], parameters: Array) -> Array:
        """Where they rest at the first instant, or else where they are declared to start, (n,)."""
        return self._resting([a[:, :1] for a in along], parameters)[: len(self.rows)]

    @property
    def starts(self) -> Array:
        """Where they are declared to start, or else their nominal values, (n,)."""
        return np.array([self.dae.states[i].start or self.dae.states[i].nominal for i in self.rows])

    @property
    def _theta(self) -> float:
        return DAMPED if self.velocities else MIDDLE

    @cached_property
    def symbols(self) -> tuple[Any, Any, Any]:
        """l', l and the free parameters, among the model's symbols."""
        dae, own = self.dae, list(self.rows)
        return ca.vertcat(*(dae.dx[i] for i in own)), ca.vertcat(*(dae.x[i] for i in own)), ca.vertcat(*(dae.p[i] for i in self.free))

    @cached_property
    def _own(self) -> Any:
        return self.dae.undisturbed(self.dae.residual[list(self.rows.values())])

    @cached_property
    def _rest(self) -> Any:
        """(x', x, z, u, t, p) -> one Newton step of l towards rest, and the slope of where it rests."""
        dae, (_, state, p) = self.dae, self.symbols
        by_state = ca.jacobian(self._own, state)
        answers = [state - ca.solve(by_state, self._own), -ca.solve(by_state, ca.jacobian(self._own, p))]
        return ca.Function("rest", [dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p], [ca.densify(a) for a in answers])

    @cached_property
    def _steps(self) -> Callable[[int], Called]:
        """How many of them -> steps in a row, each from where the last one ended."""
        return cache(lambda count: Called(self._step.mapaccum(count)))

    @cached_property
    def _step(self) -> Any:
        """([l; m before; S], x', x, z, u, t, p, h) -> [l+; m; S+]."""
        dae, (rate, state, p), n, theta = self.dae, self.symbols, len(self.rows), self._theta
        before, h, m = ca.SX.sym("l", n), ca.SX.sym("h"), ca.SX.sym("m", n)
        S, guess = ca.SX.sym("S", n, len(self.free)), ca.SX.sym("m_before", n)
        F = ca.substitute(self._own, ca.vertcat(rate, state), ca.vertcat((m - before) / (theta * h), m))
        others = [before, dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p, h]
        by_m = ca.jacobian(F, m)
        newton = ca.Function("newton", [m, *others], [m - ca.solve(by_m, F)])
        slope = ca.Function("slope", [m, S, *others], [-ca.solve(by_m, ca.jacobian(F, before) @ S + ca.jacobian(F, p))])
        middle = ca.substitute(self._stopped, state, guess)
        for _ in range(SLIDING if self.velocities else AHEAD):
            middle = newton(middle, *others)
        S_after = S + (slope(middle, S, *others) - S) / theta
        after = ca.vertcat(before + (middle - before) / theta, middle, ca.vec(S_after))
        return ca.Function("step", [ca.vertcat(before, guess, ca.vec(S)), *others[1:]], [ca.densify(after)])

    @cached_property
    def _stopped(self) -> Any:
        """l moved as little as makes the laws' velocities zero."""
        _, state, _ = self.symbols
        v = ca.vertcat(*(self.dae.variables[name] for name in self.velocities))
        A = ca.jacobian(v, state)
        return state - A.T @ ca.solve(A @ A.T, v) if self.velocities else state


def simulated(driven: Driven, followed: Followed, parameters: Array, firsts: Sequence[Array | None] | None = None) -> Followed:
    """The followed trajectories with the unseen moved by their balances; left as they are where these have no finite answer.

    firsts: where they start in every recording, each (n,) or None.
    """
    firsts = firsts or [None] * len(followed.horizons)
    runs = [driven.run(followed, number, parameters, first) for number, first in enumerate(firsts)]
    if not all(np.isfinite(run.state).all() for run in runs):
        return followed

    def curve(number: int, times: Array) -> tuple[Array, Array]:
        _, states, z = followed.at(number, times)
        states[list(driven.rows)] = [np.interp(times, runs[number].times, row) for row in runs[number].state]
        return states, z

    t = followed.transcription
    return replace(followed, decisions=np.concatenate([passing_through(t, curve), followed.decisions[t.nlp.trajectory_size :]]))
