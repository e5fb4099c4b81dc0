"""Lags that no output shows, such as a thrust or a current behind its command, along trajectories that follow the samples.

A lag l has a balance of first order to itself, F_l(l', l, v, p) = 0, moved by v, which is recorded or followed. So it is simulated along
the followed samples from where it would rest, by the implicit midpoint rule, with its slope S = dl/dp:

    F_l((l+ - l)/h, m, v(t + h/2), p) = 0,        m = (l + l+)/2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae
from backsight.ocp.follow import Followed
from backsight.ocp.passing import passing_through
from backsight.ocp.polynomials import Array

RESTING, AHEAD = 20, 4  # steps of Newton's method: to where a lag rests, and from instant to instant


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


@dataclass(frozen=True, kw_only=True)
class Run:
    """Lags in the middle between the instants of a horizon, m and (l+ - l)/h (n, M), with their slopes in free parameters (n, M, np)."""

    times: Array
    lag: Array
    rate: Array
    lag_slope: Array
    rate_slope: Array


@dataclass(frozen=True)
class Lags:
    """The unseen lags of a model, state -> row, along followed trajectories; free: indices of the parameters that slopes are taken in."""

    dae: Dae
    rows: dict[int, int]
    free: tuple[int, ...] = ()

    def along(self, followed: Followed, number: int, times: Array) -> tuple[Array, ...]:
        """x', x, z, u and t of horizon `number`, as the model's functions take them."""
        horizon = followed.horizons[number]
        return (*followed.at(number, times), horizon.input_at(times), horizon.clock + times[None, :])

    def run(self, followed: Followed, number: int, parameters: Array) -> Run:
        """The lags along horizon `number`, between its samples and the steps of its inputs."""
        instants, n = followed.horizons[number].breaks, len(self.rows)
        h, times = np.diff(instants), (instants[1:] + instants[:-1]) / 2
        arguments = self.along(followed, number, times)
        first = self._resting([a[:, :1] for a in arguments], parameters)
        p = np.repeat(parameters[:, None], len(times), axis=1)
        after = np.asarray(self._steps(len(times))(first, *arguments, p, h[None, :]), dtype=np.float64)
        both = np.hstack([first[:, None], after])
        lag, S = both[:n], both[2 * n :].reshape(len(self.free), n, len(instants)).transpose(1, 2, 0)
        return Run(
            times=times,
            lag=after[n : 2 * n],
            rate=np.diff(lag) / h,
            lag_slope=(S[:, 1:] + S[:, :-1]) / 2,
            rate_slope=np.diff(S, axis=1) / h[:, None],
        )

    def _resting(self, arguments: list[Array], parameters: Array) -> Array:
        """[l; l; dl/dp] where the balances let the lags rest at once, or else where their states start."""
        dx, x, z, u, t = arguments
        start = np.array([self.dae.states[i].start or self.dae.states[i].nominal for i in self.rows])
        x[list(self.rows), 0], dx = start, 0 * dx
        for _ in range(RESTING):
            lag, S = (np.asarray(a, dtype=np.float64) for a in self._rest(dx, x, z, u, t, parameters))
            x[list(self.rows)] = lag
        if not (np.isfinite(lag).all() and np.isfinite(S).all()):
            lag, S = start[:, None], np.zeros(S.shape)
        return np.concatenate([lag.ravel(), lag.ravel(), S.ravel(order="F")])

    @cached_property
    def symbols(self) -> tuple[Any, Any, Any]:
        """l', l and the free parameters, among the model's symbols."""
        dae, lags = self.dae, list(self.rows)
        return ca.vertcat(*(dae.dx[i] for i in lags)), ca.vertcat(*(dae.x[i] for i in lags)), ca.vertcat(*(dae.p[i] for i in self.free))

    @cached_property
    def _own(self) -> Any:
        return self.dae.undisturbed(self.dae.residual[list(self.rows.values())])

    @cached_property
    def _rest(self) -> Any:
        """(x', x, z, u, t, p) -> one Newton step of l towards rest, and the slope of where it rests."""
        dae, (_, lag, p) = self.dae, self.symbols
        by_lag = ca.jacobian(self._own, lag)
        answers = [lag - ca.solve(by_lag, self._own), -ca.solve(by_lag, ca.jacobian(self._own, p))]
        return ca.Function("rest", [dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p], [ca.densify(a) for a in answers])

    @cached_property
    def _steps(self) -> Callable[[int], Any]:
        """How many of them -> steps in a row, each from where the last one ended."""
        return cache(self._step.mapaccum)

    @cached_property
    def _step(self) -> Any:
        """([l; m before; S], x', x, z, u, t, p, h) -> [l+; m; S+]."""
        dae, (rate, lag, p), n = self.dae, self.symbols, len(self.rows)
        before, h, m = ca.SX.sym("l", n), ca.SX.sym("h"), ca.SX.sym("m", n)
        S, guess = ca.SX.sym("S", n, len(self.free)), ca.SX.sym("m_before", n)
        F = ca.substitute(self._own, ca.vertcat(rate, lag), ca.vertcat(2 * (m - before) / h, m))
        others = [before, dae.dx, dae.x, dae.z, dae.u, dae.t, dae.p, h]
        by_m = ca.jacobian(F, m)
        newton = ca.Function("newton", [m, *others], [m - ca.solve(by_m, F)])
        slope = ca.Function("slope", [m, S, *others], [-ca.solve(by_m, ca.jacobian(F, before) @ S + ca.jacobian(F, p))])
        middle = guess
        for _ in range(AHEAD):
            middle = newton(middle, *others)
        after = ca.vertcat(2 * middle - before, middle, ca.vec(2 * slope(middle, S, *others) - S))
        return ca.Function("step", [ca.vertcat(before, guess, ca.vec(S)), *others[1:]], [ca.densify(after)])


def simulated(lags: Lags, followed: Followed, parameters: Array) -> Followed:
    """The followed trajectories with the lags moved by their balances; left as they are where these have no finite answer."""
    runs = [lags.run(followed, number, parameters) for number in range(len(followed.horizons))]
    if not all(np.isfinite(run.lag).all() for run in runs):
        return followed

    def curve(number: int, times: Array) -> tuple[Array, Array]:
        _, states, z = followed.at(number, times)
        states[list(lags.rows)] = [np.interp(times, runs[number].times, row) for row in runs[number].lag]
        return states, z

    t = followed.transcription
    return replace(followed, decisions=np.concatenate([passing_through(t, curve), followed.decisions[t.nlp.trajectory_size :]]))
